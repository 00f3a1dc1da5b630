//! A coarse lattice over the surroundings of the organ.

use super::grid::{VoxelGrid, cell};
use crate::geometry::{Point3, Vector3, bounding_box};

/// At most so many steps along the longest side.
const STEPS: f64 = 96.0;
/// How far it reaches beyond the organ, of the organ's longest side: so far may the organ move.
const MARGIN: f64 = 0.25;
/// And at least so many voxels.
const LEAST: f64 = 4.0;

/// Nodes on voxel centres (also of voxels that the grid does not have), so that with steps of one
/// voxel nothing is interpolated.
#[derive(Clone, Debug)]
pub(super) struct VoxelLattice {
    /// Voxel of the first node.
    low: Point3,
    /// Voxels from node to node.
    step: Vector3,
    size: [usize; 3],
}

impl VoxelLattice {
    /// Around points in voxels.
    pub(super) fn around(grid: &VoxelGrid, points: &[Point3]) -> Self {
        let spacing = Vector3::from(grid.spacing());
        let [low, high] = bounding_box(points);
        let longest = (high - low).component_mul(&spacing).max();
        let margin = spacing.map(|s| (MARGIN * longest / s).max(LEAST).ceil());
        let low = (low - margin).map(f64::floor);
        let extent = (high + margin) - low;
        let longest = extent.component_mul(&spacing).max();
        let step = spacing.map(|s| (longest / STEPS / s).ceil());
        let size = [0, 1, 2].map(|c| (extent[c] / step[c]).ceil() as usize + 1);
        Self { low, step, size }
    }

    pub(super) fn count(&self) -> usize {
        self.size.iter().product()
    }

    /// A node, in voxels.
    pub(super) fn node(&self, place: usize) -> Point3 {
        let [nx, ny, _] = self.size;
        let at =
            Vector3::new((place % nx) as f64, (place / nx % ny) as f64, (place / nx / ny) as f64);
        self.low + at.component_mul(&self.step)
    }

    /// Whether a place in voxels lies within.
    pub(super) fn holds(&self, at: &Point3) -> bool {
        let at = (at - self.low).component_div(&self.step);
        (0..3).all(|c| (0.0..=(self.size[c] - 1) as f64).contains(&at[c]))
    }

    /// Values of the nodes, trilinear at a place in voxels; outside those of the border.
    pub(super) fn at(&self, values: &[Vector3], at: &Point3) -> Vector3 {
        let at = Point3::from((at - self.low).component_div(&self.step));
        cell(self.size, &at).iter().map(|&(node, weight)| values[node] * weight).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Affine3, Matrix4};

    #[test]
    fn nodes_lie_on_voxels_and_linear_fields_come_back() {
        let map = Matrix4::from_diagonal(&nalgebra::Vector4::new(0.5, -0.5, 2.0, 1.0));
        let grid = VoxelGrid::new([300, 300, 60], Affine3::from_matrix_unchecked(map)).unwrap();
        let points = [Point3::new(20.5, 30.0, 5.0), Point3::new(270.0, 260.0, 55.0)];
        let lattice = VoxelLattice::around(&grid, &points);
        // 125 mm, with margins 188: steps of 1.96 mm are 4 voxels, 4 voxels, 1 voxel.
        assert_eq!(lattice.step, Vector3::new(4.0, 4.0, 1.0));
        assert!(lattice.size.iter().all(|n| (40..=120).contains(n)), "{:?}", lattice.size);
        let linear = |p: &Point3| Vector3::new(p.x - 2.0 * p.y, p.z, 0.25 * p.x + 1.0);
        let values: Vec<Vector3> = (0..lattice.count()).map(|n| linear(&lattice.node(n))).collect();
        for p in [points[0], points[1], Point3::new(100.3, 44.4, 17.9)] {
            assert!((lattice.at(&values, &p) - linear(&p)).norm() < 1e-9 && lattice.holds(&p));
        }
        assert!(!lattice.holds(&Point3::new(-80.0, 100.0, 20.0)));
    }
}
