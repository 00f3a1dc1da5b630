//! The zero level of the signed distances, by marching tetrahedra.
//!
//! Each cube of the grid is cut into six tetrahedra around its main diagonal (Kuhn), the same way
//! everywhere, so neighbouring cubes meet face to face and the surface has at most two triangles at
//! an edge, whatever the values are.

use super::grid::{BLOCK, EDGE};
use super::volume::DistanceVolume;
use crate::geometry::Point3;
use rayon::prelude::*;

/// The tetrahedra of a cube, positively oriented; bit k of a corner is its offset along axis k.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// Triangles of the zero level.
#[derive(Clone, Debug, Default)]
pub(super) struct Triangles {
    pub positions: Vec<Point3>,
    /// Counter-clockwise seen from the positive side.
    pub faces: Vec<[u32; 3]>,
}

/// An edge of the grid, from its lower to its upper corner: the place of a vertex.
type Key = (u64, u64);

/// The surface through all cubes whose eight corners have at least `min_support`.
pub(super) fn extract(volume: &DistanceVolume, min_support: f32) -> Triangles {
    let faces: Vec<[Key; 3]> = (0..volume.blocks.len())
        .into_par_iter()
        .flat_map_iter(|b| block_faces(volume, b, min_support))
        .collect();
    let mut keys: Vec<Key> = faces.iter().flatten().copied().collect();
    keys.par_sort_unstable();
    keys.dedup();
    let index = |key: &Key| keys.binary_search(key).unwrap_or_default() as u32;
    Triangles {
        positions: keys.par_iter().map(|key| crossing(volume, key)).collect(),
        faces: faces.par_iter().map(|face| [0, 1, 2].map(|i| index(&face[i]))).collect(),
    }
}

/// Where the distance is zero on a grid edge, kept off its ends so that no triangle collapses.
fn crossing(volume: &DistanceVolume, &(a, b): &Key) -> Point3 {
    let (da, db) = (volume.distance[a as usize], volume.distance[b as usize]);
    let t = ((da / (da - db)) as f64).clamp(0.02, 0.98);
    let place = |c: u64| volume.position(c as usize / BLOCK, c as usize % BLOCK);
    place(a) + t * (place(b) - place(a))
}

fn block_faces(volume: &DistanceVolume, b: usize, min_support: f32) -> Vec<[Key; 3]> {
    let neighbours: [Option<usize>; 8] = std::array::from_fn(|n| {
        let at = volume.blocks[b];
        volume.find([0, 1, 2].map(|k| at[k] + (n >> k & 1) as i32))
    });
    let mut faces = Vec::new();
    for g in 0..BLOCK {
        let Some(corners) = cube(&neighbours, g) else { continue };
        if corners.iter().any(|&c| volume.support[c as usize] < min_support) {
            continue;
        }
        let values = corners.map(|c| volume.distance[c as usize]);
        if values.iter().all(|&v| v < 0.0) || values.iter().all(|&v| v >= 0.0) {
            continue;
        }
        for tetrahedron in &TETRAHEDRA {
            cut(tetrahedron.map(|c| (corners[c], values[c])), &mut faces);
        }
    }
    faces
}

/// Grid points at the corners of the cube above grid point `g`; `None` where a block is missing.
fn cube(neighbours: &[Option<usize>; 8], g: usize) -> Option<[u64; 8]> {
    let local = [g % EDGE, g / EDGE % EDGE, g / (EDGE * EDGE)];
    let mut corners = [0; 8];
    for (c, corner) in corners.iter_mut().enumerate() {
        let at = [0, 1, 2].map(|k| local[k] + (c >> k & 1));
        let block = (0..3).map(|k| (at[k] / EDGE) << k).sum::<usize>();
        let [x, y, z] = at.map(|a| a % EDGE);
        *corner = (neighbours[block]? * BLOCK + (z * EDGE + y) * EDGE + x) as u64;
    }
    Some(corners)
}

/// The one or two triangles that part the negative from the other corners.
fn cut(t: [(u64, f32); 4], faces: &mut Vec<[Key; 3]>) {
    /// Even permutations that bring each corner to the front.
    const FIRST: [[usize; 4]; 4] = [[0, 1, 2, 3], [1, 0, 3, 2], [2, 0, 1, 3], [3, 0, 2, 1]];
    /// Even permutations that bring each pair to the front.
    const PAIRS: [[usize; 4]; 6] =
        [[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 2, 0], [2, 3, 0, 1]];
    let negative = |i: usize| t[i].1 < 0.0;
    let edge = |i: usize, j: usize| (t[i].0.min(t[j].0), t[i].0.max(t[j].0));
    match (0..4).filter(|&i| negative(i)).count() {
        1 => {
            if let Some([a, b, c, d]) = FIRST.into_iter().find(|p| negative(p[0])) {
                faces.push([edge(a, b), edge(a, c), edge(a, d)]);
            }
        }
        3 => {
            if let Some([a, b, c, d]) = FIRST.into_iter().find(|p| !negative(p[0])) {
                faces.push([edge(a, b), edge(a, d), edge(a, c)]);
            }
        }
        2 => {
            if let Some([a, b, c, d]) = PAIRS.into_iter().find(|p| negative(p[0]) && negative(p[1]))
            {
                let quad = [edge(a, c), edge(a, d), edge(b, d), edge(b, c)];
                faces.push([quad[0], quad[1], quad[2]]);
                faces.push([quad[0], quad[2], quad[3]]);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, Topology};

    /// A ball of radius `r` about the centre of 4x4x4 blocks, grid edge 1.
    fn ball(r: f64) -> DistanceVolume {
        let blocks: Vec<[i32; 3]> =
            (0..64).map(|i| [i / 16 - 2, i / 4 % 4 - 2, i % 4 - 2]).collect();
        let n = blocks.len() * BLOCK;
        let mut volume = DistanceVolume {
            voxel: 1.0,
            blocks,
            distance: vec![0.0; n],
            support: vec![1.0; n],
            evidence: Vec::new(),
        };
        for i in 0..n {
            let p = volume.position(i / BLOCK, i % BLOCK);
            volume.distance[i] = (p.coords.norm() - r) as f32;
        }
        volume
    }

    #[test]
    fn a_ball_is_closed_manifold_and_outward() {
        let surface = extract(&ball(9.3), 0.5);
        let topology = Topology::new(surface.positions.len(), surface.faces).unwrap();
        assert_eq!(topology.euler_characteristic(), 2);
        assert!(topology.boundary.iter().all(|&b| !b));
        let mesh = Mesh { topology: topology.into(), positions: surface.positions };
        let volume: f64 = (0..mesh.topology.faces.len())
            .map(|f| {
                let [a, b, c] = mesh.corners(f);
                a.coords.dot(&b.coords.cross(&c.coords)) / 6.0
            })
            .sum();
        let expected = 4.0 / 3.0 * std::f64::consts::PI * 9.3f64.powi(3);
        assert!((volume / expected - 1.0).abs() < 0.01, "{volume} {expected}");
    }

    #[test]
    fn no_support_no_surface() {
        let mut volume = ball(9.3);
        for i in 0..volume.support.len() {
            if volume.position(i / BLOCK, i % BLOCK).z > 0.0 {
                volume.support[i] = 0.1;
            }
        }
        let half = extract(&volume, 0.5);
        assert!(half.positions.iter().all(|p| p.z <= 0.0));
        let topology = Topology::new(half.positions.len(), half.faces).unwrap();
        assert_eq!(topology.euler_characteristic(), 1);
    }
}
