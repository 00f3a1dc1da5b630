//! From depth maps to the mesh of what was seen.

use super::tetrahedra::{Triangles, extract};
use super::volume::Volume;
use super::{DenseError, DenseOptions, DepthMap, PosedFrame, clean, holes};
use crate::geometry::Point3;
use crate::mesh::{Mesh, Topology};
use rayon::prelude::*;
use std::sync::Arc;

/// Depths that differ by more than this fraction are not of the same surface.
const SAME_SURFACE: f64 = 0.01;
/// Half the width, in edges, of the necks at which the surface is cut.
const OPENING: usize = 5;
/// Pieces of fewer faces are dust.
const DUST: usize = 200;

/// An open surface in the world frame of the poses.
#[derive(Clone, Debug)]
pub struct DenseSurface {
    /// Manifold, consistently oriented; normals point towards the cameras.
    pub mesh: Mesh,
    /// What the frames say of each vertex.
    pub support: Vec<VertexSupport>,
}

/// How well a vertex is supported.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VertexSupport {
    /// Frames whose depth map agrees.
    pub frames: u32,
    /// Standard deviation expected of its position, length units: image noise of the depth maps
    /// averaged, and the scatter between them; infinity where no frame agrees (a closed hole).
    pub sigma: f64,
}

/// Fuse depth maps into signed distances and take their zero level where the frames support it.
///
/// `maps` are those of [`super::depth_maps`] for the same `views`, in the same order.
pub fn surface(
    views: &[PosedFrame],
    maps: &[DepthMap],
    options: &DenseOptions,
) -> Result<DenseSurface, DenseError> {
    options.validate()?;
    let triangles = without_handles(views, maps, options);
    let none = |_| DenseError::NoSurface { frames: maps.len() };
    let topology = Topology::new(triangles.positions.len(), triangles.faces).map_err(none)?;
    let positions = triangles.positions;
    let support = positions.par_iter().map(|p| support(maps, p)).collect();
    Ok(DenseSurface { mesh: Mesh { topology: Arc::new(topology), positions }, support })
}

/// The surface on the finest grid on which it has no handles. Tissue seen from one side has none;
/// those of a reconstruction are tunnels between noisy layers of depth, which close on a grid about
/// as coarse as the noise. Of coarser grids that do not help either, the one with fewest handles.
fn without_handles(views: &[PosedFrame], maps: &[DepthMap], options: &DenseOptions) -> Triangles {
    let given = options.voxel.is_some();
    let mut options = options.clone();
    let mut best: Option<(i64, Triangles)> = None;
    for _ in 0..COARSER {
        let volume = Volume::fuse(views, maps, &options);
        let mut triangles = extract(&volume, options.min_support as f32);
        let coarser = volume.voxel * std::f64::consts::SQRT_2;
        drop(volume);
        tidy(&mut triangles, &options);
        let handles = handles(&triangles);
        let empty = triangles.faces.is_empty();
        if !empty && best.as_ref().is_none_or(|(fewest, _)| handles < *fewest) {
            best = Some((handles, triangles));
        }
        if handles == 0 || empty || given {
            break;
        }
        options.voxel = Some(coarser);
        // The same length of surface in fewer edges.
        options.smoothing /= 2;
    }
    best.map(|(_, triangles)| triangles).unwrap_or_default()
}

/// Grids tried, at most: each has edges longer by √2 than the one before.
const COARSER: usize = 5;

/// Handles of a manifold surface, summed over its pieces: `2 c − χ = 2 g + b`.
fn handles(triangles: &Triangles) -> i64 {
    let mut edges: Vec<[u32; 2]> = triangles
        .faces
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[p, q]| [p.min(q), p.max(q)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let euler =
        triangles.positions.len() as i64 - edges.len() as i64 + triangles.faces.len() as i64;
    let boundaries = holes::boundary_loops(&triangles.faces).len() as i64;
    (2 * clean::pieces(triangles) as i64 - euler - boundaries) / 2
}

/// One manifold piece without teeth and small holes, smoothed.
fn tidy(triangles: &mut Triangles, options: &DenseOptions) {
    clean::drop_small(triangles, DUST);
    clean::shave(triangles);
    clean::split_bow_ties(triangles);
    if options.largest_only {
        clean::keep_largest(triangles);
    }
    clean::compact(triangles);
    holes::close_small(triangles, options.max_hole_edges);
    clean::open(triangles, OPENING);
    clean::shave(triangles);
    clean::split_bow_ties(triangles);
    if options.largest_only {
        clean::keep_largest(triangles);
    }
    clean::compact(triangles);
    clean::smooth(triangles, options.smoothing);
}

/// Which depth maps agree with a point, and how closely.
fn support(maps: &[DepthMap], point: &Point3) -> VertexSupport {
    let (mut frames, mut information, mut squares, mut weights) = (0, 0.0f64, 0.0f64, 0.0f64);
    for m in maps {
        let p = m.pose * point;
        let u = (m.camera.focal[0] * p.x / p.z + m.camera.centre[0]).round();
        let v = (m.camera.focal[1] * p.y / p.z + m.camera.centre[1]).round();
        let [w, h] = m.camera.size.map(|s| s as f64);
        if !(p.z > 0.0 && u >= 0.0 && v >= 0.0 && u < w && v < h) {
            continue;
        }
        let i = v as usize * m.camera.size[0] + u as usize;
        let z = m.depth[i] as f64;
        let facing = -m.normal[i][2] as f64;
        if z <= 0.0 || (z - p.z).abs() > SAME_SURFACE * p.z / facing.max(0.25) {
            continue;
        }
        // Across the surface, not along the sightline.
        let sigma = (m.sigma[i] as f64).max(1e-4 * z) * facing;
        frames += 1;
        information += 1.0 / (sigma * sigma);
        squares += ((z - p.z) * facing / sigma).powi(2);
        weights += 1.0;
    }
    if frames == 0 {
        return VertexSupport { frames, sigma: f64::INFINITY };
    }
    // Scatter beyond what the noise explains widens the error (Birge ratio).
    let ratio = (squares / weights).sqrt().max(1.0);
    VertexSupport { frames, sigma: ratio / information.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An `n × n` grid on a torus; the square at its start is left out where asked.
    fn torus(n: u32, open: bool) -> Triangles {
        let at = |x: u32, y: u32| (y % n) * n + x % n;
        let squares = (0..n * n).skip(usize::from(open)).map(|i| (i % n, i / n));
        let faces = squares.flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        Triangles { positions: vec![Point3::origin(); (n * n) as usize], faces: faces.collect() }
    }

    #[test]
    fn handles_by_hand() {
        assert_eq!(handles(&torus(5, false)), 1);
        assert_eq!(handles(&torus(5, true)), 1);
        let fan =
            Triangles { positions: vec![Point3::origin(); 4], faces: vec![[0, 1, 2], [0, 2, 3]] };
        assert_eq!(handles(&fan), 0);
    }
}
