//! Triangle meshes: topology (who meets whom) apart from positions.

pub mod boundary;
pub mod components;
pub mod decimate;
pub(crate) mod faces;
pub mod laplacian;
pub mod normals;
pub mod orientation;
pub mod paths;
pub mod remesh;
pub mod repair;
#[cfg(test)]
pub(crate) mod shapes;
pub mod strain;
pub mod surface_points;
pub mod topology;

use crate::geometry::{Point3, area, bounding_box};
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
    /// A mesh of its vertices and its faces, whose corners count the vertices from 0 and run
    /// anticlockwise as seen from outside.
    ///
    /// ```
    /// use dsfms::{Mesh, geometry::Point3};
    ///
    /// let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]].map(Point3::from);
    /// let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2]])?;
    /// assert_eq!(mesh.face_areas(), [3.0]);
    /// # Ok::<_, dsfms::mesh::TopologyError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Topology::new`].
    pub fn new(positions: Vec<Point3>, faces: Vec<[u32; 3]>) -> Result<Self, TopologyError> {
        let topology = Arc::new(Topology::new(positions.len(), faces)?);
        Ok(Self { topology, positions })
    }

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

    /// Whether the corners of a face lie on one line (sine of its largest angle below 1e-12).
    pub(crate) fn is_degenerate(&self, face: usize) -> bool {
        is_flat(self.corners(face))
    }

    /// Length of every edge of [`Topology::edges`], length units.
    pub fn edge_lengths(&self) -> Vec<f64> {
        let length =
            |&[a, b]: &[u32; 2]| (self.positions[a as usize] - self.positions[b as usize]).norm();
        self.topology.edges.iter().map(length).collect()
    }

    /// Mean edge length, length units; 0 without edges.
    pub fn mean_edge_length(&self) -> f64 {
        let lengths = self.edge_lengths();
        lengths.iter().sum::<f64>() / lengths.len().max(1) as f64
    }

    /// Smallest inner angle of every face, radians.
    pub(crate) fn min_angles(&self) -> Vec<f64> {
        let smallest = |f: usize| {
            let [a, b, c] = self.corners(f);
            let angle = |p: &Point3, q: &Point3, r: &Point3| (q - p).angle(&(r - p));
            angle(a, b, c).min(angle(b, c, a)).min(angle(c, a, b))
        };
        (0..self.topology.faces.len()).map(smallest).collect()
    }

    /// Corners of the axis-aligned bounding box over all vertices.
    pub fn bounding_box(&self) -> [Point3; 2] {
        bounding_box(&self.positions)
    }

    /// Some of the faces as a mesh of their own: vertices that they use, in the old order; second,
    /// for each new vertex its old number.
    pub fn subset(&self, faces: &[usize]) -> (Self, Vec<u32>) {
        let mut name = vec![u32::MAX; self.positions.len()];
        for &f in faces {
            self.topology.faces[f].iter().for_each(|&v| name[v as usize] = 0);
        }
        let old: Vec<u32> = (0..name.len() as u32).filter(|&v| name[v as usize] == 0).collect();
        old.iter().enumerate().for_each(|(new, &v)| name[v as usize] = new as u32);
        let positions: Vec<Point3> = old.iter().map(|&v| self.positions[v as usize]).collect();
        let faces = faces.iter().map(|&f| self.topology.faces[f].map(|v| name[v as usize]));
        let topology = Topology::from_checked(positions.len(), faces.collect());
        (Self { topology: Arc::new(topology), positions }, old)
    }

    /// The same faces at other positions.
    pub fn with_positions(&self, positions: Vec<Point3>) -> Self {
        assert_eq!(positions.len(), self.positions.len(), "one position per vertex");
        Self { topology: Arc::clone(&self.topology), positions }
    }
}

/// Whether three corners lie on one line (sine of the largest angle below 1e-12).
fn is_flat([a, b, c]: [&Point3; 3]) -> bool {
    let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
    area(a, b, c) <= 0.5e-12 * longest
}
