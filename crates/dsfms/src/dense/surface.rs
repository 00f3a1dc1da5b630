//! From depth maps to the mesh of what was seen.

use super::depth_map::{DepthMap, Said};
use super::error::DenseError;
use super::options::DenseOptions;
use super::tetrahedra::{Triangles, extract};
use super::volume::DistanceVolume;
use super::{clean, fit, handles, holes, rim};
use crate::camera::PosedFrame;
use crate::geometry::Point3;
use crate::mesh::Mesh;
use rayon::prelude::*;

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
///
/// # Errors
/// An option out of range, or no surface that is manifold.
pub fn surface(
    views: &[PosedFrame],
    maps: &[DepthMap],
    options: &DenseOptions,
) -> Result<DenseSurface, DenseError> {
    options.validate()?;
    let triangles = without_handles(views, maps, options);
    let none = |_| DenseError::NoSurface { frames: maps.len() };
    let mesh = Mesh::new(triangles.positions, triangles.faces).map_err(none)?;
    let support = mesh.positions.par_iter().map(|p| support(maps, p)).collect();
    Ok(DenseSurface { mesh, support })
}

/// The surface on the finest grid on which it has no handles. Tissue seen from one side has none;
/// those of a reconstruction are tunnels between noisy layers of depth. They are cut where they are
/// thin, or else close on a grid about as coarse as the noise. Of coarser grids that do not help
/// either, the one with fewest handles.
fn without_handles(views: &[PosedFrame], maps: &[DepthMap], options: &DenseOptions) -> Triangles {
    let given = options.voxel.is_some();
    let least = (options.min_support * maps.len() as f64) as f32;
    let mut options = options.clone();
    let mut best: Option<(usize, Triangles)> = None;
    for _ in 0..COARSER {
        let mut volume = DistanceVolume::fuse(views, maps, &options);
        fit::run(&mut volume, options.smoothness as f32);
        volume.spread_support(least, BEYOND);
        let mut triangles = extract(&volume, least);
        let coarser = volume.voxel * std::f64::consts::SQRT_2;
        drop(volume);
        let handles = tidy(&mut triangles, views, maps, &options);
        let empty = triangles.faces.is_empty();
        if !empty && best.as_ref().is_none_or(|(fewest, _)| handles < *fewest) {
            best = Some((handles, triangles));
        }
        if handles == 0 || empty || given {
            break;
        }
        options.voxel = Some(coarser);
        // Half would smooth over the same length of surface; what needs a coarser grid is noisier.
        options.smoothing = options.smoothing * 3 / 4;
    }
    best.map(|(_, triangles)| triangles).unwrap_or_default()
}

/// How far, in edges, the surface goes on beyond what depth supports, for the rim to be chosen
/// from.
const BEYOND: usize = 6;
/// Grids tried, at most: each has edges longer by √2 than the one before.
const COARSER: usize = 5;

/// One manifold piece without teeth, small holes and doubtful rim, smoothed; the handles that are
/// left.
fn tidy(
    triangles: &mut Triangles,
    views: &[PosedFrame],
    maps: &[DepthMap],
    options: &DenseOptions,
) -> usize {
    clean::drop_small(triangles, DUST);
    one_piece(triangles, options);
    holes::close_small(triangles, options.max_hole_edges);
    rim::peel(triangles, views, maps, options.peel_hidden);
    one_piece(triangles, options);
    holes::close_small(triangles, options.max_hole_edges);
    let mut handles = handles::handles(triangles);
    for _ in 0..CUTS {
        if handles == 0 || !handles::cut_one(triangles, options.max_hole_edges) {
            break;
        }
        one_piece(triangles, options);
        holes::close_small(triangles, options.max_hole_edges);
        handles = handles::handles(triangles);
    }
    clean::open(triangles, OPENING);
    one_piece(triangles, options);
    clean::smooth(triangles, options.smoothing);
    handles::handles(triangles)
}

/// Without teeth, one fan a vertex, no vertex unused.
fn one_piece(triangles: &mut Triangles, options: &DenseOptions) {
    clean::shave(triangles);
    clean::split_bow_ties(triangles);
    if options.largest_only {
        clean::keep_largest(triangles);
    }
    clean::compact(triangles);
}

/// Handles cut, at most.
const CUTS: usize = 40;

/// Which depth maps agree with a point, and how closely.
fn support(maps: &[DepthMap], point: &Point3) -> VertexSupport {
    let (mut frames, mut information, mut squares, mut weights) = (0, 0.0f64, 0.0f64, 0.0f64);
    for m in maps {
        let p = m.pose * point;
        let Some((i, Said::Agrees)) = m.compare(&p) else { continue };
        let (z, facing) = m.seen(i);
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
    use crate::camera::CameraModel;
    use crate::geometry::Isometry;
    use crate::image::Frame;

    const SIZE: [usize; 2] = [80, 60];
    /// Standard deviation of the depths.
    const SIGMA: f64 = 0.1;

    /// A wall at z = 50 as six frames measure it, side by side: errors of known standard deviation,
    /// alike over some pixels as those of smoothed depth maps are, and others in every frame.
    fn maps() -> Vec<DepthMap> {
        // Four waves of their own directions, whose variance is half their squared amplitude.
        let error = |u: f64, v: f64, i: usize| -> f64 {
            let wave = |k: usize| {
                let (turn, steep) = (2.4 * (4 * i + k) as f64, 0.15 + 0.05 * k as f64);
                (steep * (u * turn.cos() + v * turn.sin()) + 3.0 * turn).sin()
            };
            SIGMA * 0.5f64.sqrt() * (0..4).map(wave).sum::<f64>()
        };
        let map = |i: usize| {
            let depth = (0..SIZE[0] * SIZE[1]).map(|p| {
                let (u, v) = ((p % SIZE[0]) as f64, (p / SIZE[0]) as f64);
                (50.0 + error(u, v, i)) as f32
            });
            DepthMap {
                camera: CameraModel::pinhole(SIZE, [60.0; 2], [39.5, 29.5]),
                pose: Isometry::translation(2.0 * i as f64 - 5.0, 0.0, 0.0),
                depth: depth.collect(),
                normal: vec![[0.0, 0.0, -1.0]; SIZE[0] * SIZE[1]],
                sigma: vec![SIGMA as f32; SIZE[0] * SIZE[1]],
                confidence: vec![1.0; SIZE[0] * SIZE[1]],
            }
        };
        (0..6).map(map).collect()
    }

    #[test]
    fn expected_errors_are_those_of_known_noise() {
        let maps = maps();
        let frame = Frame { name: "f".into(), size: SIZE, rgb: vec![[90; 3]; SIZE[0] * SIZE[1]] };
        let views: Vec<PosedFrame> =
            maps.iter().map(|map| PosedFrame::new(&frame, &map.camera, map.pose)).collect();
        let options = DenseOptions { target_vertices: Some(3000), ..Default::default() };
        let found = surface(&views, &maps, &options).unwrap();
        let of_all = found.support.iter().zip(&found.mesh.positions).filter(|(s, _)| s.frames == 6);
        let ratios: Vec<f64> = of_all.map(|(s, p)| ((p.z - 50.0) / s.sigma).powi(2)).collect();
        let ratio = (ratios.iter().sum::<f64>() / ratios.len() as f64).sqrt();
        assert!(ratios.len() > 1000, "{}", ratios.len());
        assert!((0.5..2.0).contains(&ratio), "error over expected, rms: {ratio}");
    }
}
