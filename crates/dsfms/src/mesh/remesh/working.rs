//! The surface between two passes.

use crate::geometry::Point3;
use crate::mesh::Topology;

/// The surface as it is being changed.
pub(super) struct WorkingMesh {
    pub(super) positions: Vec<Point3>,
    pub(super) faces: Vec<[u32; 3]>,
    /// Corners of the boundary, which never move or vanish.
    pub(super) fixed: Vec<bool>,
    /// Edge length wanted at each vertex over the mean.
    pub(super) size: Vec<f64>,
}

impl WorkingMesh {
    pub(super) fn topology(&self) -> Topology {
        Topology::from_checked(self.positions.len(), self.faces.clone())
    }

    /// Length wanted of an edge over the mean: that of its more demanding end.
    pub(super) fn edge_size(&self, a: u32, b: u32) -> f64 {
        self.size[a as usize].min(self.size[b as usize])
    }
}
