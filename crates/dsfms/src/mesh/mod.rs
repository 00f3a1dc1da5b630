//! Triangle meshes: topology (who meets whom) apart from positions.

pub mod laplacian;
pub mod normals;
pub mod topology;

use crate::geometry::{Point3, area};
use std::sync::Arc;
pub use topology::{Topology, TopologyError};

/// A triangle mesh: rest, V′ and V″ share one [`Topology`] by reference.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Who meets whom.
    pub topology: Arc<Topology>,
    /// One position per vertex; unit and frame are named by the owner.
    pub positions: Vec<Point3>,
}

impl Mesh {
    /// The three corners of a face.
    pub fn corners(&self, face: usize) -> [&Point3; 3] {
        self.topology.faces[face].map(|v| &self.positions[v as usize])
    }

    /// Area of every face, squared length units.
    pub fn face_areas(&self) -> Vec<f64> {
        (0..self.topology.faces.len())
            .map(|f| {
                let [a, b, c] = self.corners(f);
                area(a, b, c)
            })
            .collect()
    }

    /// The same faces at other positions.
    pub fn with_positions(&self, positions: Vec<Point3>) -> Self {
        assert_eq!(positions.len(), self.positions.len(), "one position per vertex");
        Self { topology: Arc::clone(&self.topology), positions }
    }
}
