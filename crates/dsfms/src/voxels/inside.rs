//! Which voxels lie inside a closed surface.

use super::grid::VoxelGrid;
use crate::geometry::Point3;
use rayon::prelude::*;

/// Whether each voxel centre lies inside; `positions` in voxels. Lines along i enter and leave at
/// faces (even-odd rule), each up to the voxel before the exit; a line through an edge or corner
/// counts as if moved aside infinitely little, so that it meets exactly one of the faces there.
pub(super) fn inside(grid: &VoxelGrid, positions: &[Point3], faces: &[[u32; 3]]) -> Vec<bool> {
    let [nx, ny, nz] = grid.size();
    let mut crossings: Vec<(usize, f64)> = faces
        .par_iter()
        .flat_map_iter(|face| crossings(face.map(|v| positions[v as usize]), [ny, nz]))
        .collect();
    crossings.par_sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut inside = vec![false; grid.count()];
    for line in crossings.chunk_by(|a, b| a.0 == b.0) {
        for &[(row, enter), (_, leave)] in line.as_chunks::<2>().0 {
            let [first, end] = [enter, leave].map(|x| x.ceil().clamp(0.0, nx as f64) as usize);
            inside[row * nx + first..row * nx + end.max(first)].fill(true);
        }
    }
    inside
}

/// Lines (j, k) that meet a face, as `j + ny k`, and where.
fn crossings(corners: [Point3; 3], [ny, nz]: [usize; 2]) -> impl Iterator<Item = (usize, f64)> {
    let range = move |c: usize, n: usize| {
        let low = corners.iter().map(|p| p[c]).fold(f64::INFINITY, f64::min).ceil().max(0.0);
        let high = corners.iter().map(|p| p[c]).fold(-f64::INFINITY, f64::max).floor();
        let end = (high + 1.0).clamp(0.0, n as f64) as usize;
        (low.min(end as f64) as usize)..end
    };
    let lines = range(2, nz).flat_map(move |k| range(1, ny).map(move |j| (j, k)));
    lines.filter_map(move |(j, k)| {
        let at = [j as f64, k as f64];
        let sides = [(1, 2), (2, 0), (0, 1)].map(|(a, b)| side(&corners[a], &corners[b], at));
        let one_side = sides.iter().all(|s| s.1) || sides.iter().all(|s| !s.1);
        let all: f64 = sides.iter().map(|s| s.0).sum();
        let x: f64 = sides.iter().zip(&corners).map(|(s, p)| s.0 * p.x).sum();
        (one_side && all != 0.0).then(|| (j + ny * k, x / all))
    })
}

/// Twice the area that (j, k) spans with an edge, and on which side of it the point lies. The same
/// numbers for the edge in both directions; a point on the edge counts as moved by (ε, ε²).
fn side(a: &Point3, b: &Point3, [y, z]: [f64; 2]) -> (f64, bool) {
    let turned = (a.y, a.z) > (b.y, b.z);
    let (p, q) = if turned { (b, a) } else { (a, b) };
    let area = (q.y - p.y) * (z - p.z) - (q.z - p.z) * (y - p.y);
    let left = match area {
        0.0 if q.z == p.z => q.y > p.y,
        0.0 => q.z < p.z,
        area => area > 0.0,
    };
    if turned { (-area, !left) } else { (area, left) }
}

/// All that is set, and what lies within `reach` voxels along every axis.
pub(super) fn widened(size: [usize; 3], set: &[bool], reach: usize) -> Vec<bool> {
    let mut wide = set.to_vec();
    let mut stride = 1;
    for n in size {
        let mut line = vec![false; n];
        for start in (0..set.len()).filter(|i| i / stride % n == 0) {
            (0..n).for_each(|t| line[t] = wide[start + t * stride]);
            let mut until = 0;
            for t in 0..n + reach {
                if t < n && line[t] {
                    until = t + 2 * reach + 1;
                }
                if t >= reach && t < until {
                    wide[start + (t - reach) * stride] = true;
                }
            }
        }
        stride *= n;
    }
    wide
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector3;
    use crate::mesh::{Mesh, shapes};
    use nalgebra::Affine3;

    fn grid(size: [usize; 3]) -> VoxelGrid {
        VoxelGrid::new(size, Affine3::identity()).unwrap()
    }

    fn of(mesh: &Mesh, size: [usize; 3]) -> Vec<bool> {
        inside(&grid(size), &mesh.positions, &mesh.topology.faces)
    }

    /// A box whose faces run through voxel centres: every line meets edges or corners.
    #[test]
    fn a_box_on_the_grid_has_the_voxels_of_its_volume() {
        let corner = |i: u32| {
            [
                1.0 + 3.0 * f64::from(i & 1),
                1.0 + 2.0 * f64::from(i >> 1 & 1),
                2.0 + f64::from(i >> 2),
            ]
        };
        let positions: Vec<Point3> = (0..8).map(|i| corner(i).into()).collect();
        let quads =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let found = of(&shapes::mesh(positions, faces), [6, 5, 4]);
        // 3 x 2 x 1 mm, 1 mm voxels.
        assert_eq!(found.iter().filter(|v| **v).count(), 6);
    }

    #[test]
    fn a_ball_by_its_radius_wherever_it_lies() {
        let ball = shapes::icosphere(4, 5.0);
        for shift in [[7.0, 7.0, 7.0], [7.3, 6.6, 7.5], [2.0, 7.0, 13.0]].map(Vector3::from) {
            let moved = ball.with_positions(ball.positions.iter().map(|p| p + shift).collect());
            let found = of(&moved, [15, 15, 15]);
            for (i, found) in found.iter().enumerate() {
                let at = Vector3::new((i % 15) as f64, (i / 15 % 15) as f64, (i / 225) as f64);
                let r = (at - shift).norm();
                if !(4.9..=5.1).contains(&r) {
                    assert_eq!(*found, r < 5.0, "{at}");
                }
            }
        }
    }

    #[test]
    fn widening_by_hand() {
        let mut set = vec![false; 14];
        set[3] = true;
        let wide = widened([7, 2, 1], &set, 2);
        let row = [false, true, true, true, true, true, false];
        assert_eq!(wide, [row, row].concat());
        assert_eq!(widened([7, 2, 1], &[false; 14], 2), [false; 14]);
    }
}
