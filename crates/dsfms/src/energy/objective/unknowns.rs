//! The state of a solve.

use crate::geometry::Point3;

/// What is solved for.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknowns {
    /// Vertex positions in camera axes.
    pub vertices: Vec<Point3>,
    /// Global unknowns; their meaning is the objective's.
    pub globals: Vec<f64>,
}
