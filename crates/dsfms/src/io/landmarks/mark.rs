//! Where a landmark is.

use crate::geometry::Point3;

/// Where a landmark is on its mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MarkPlace {
    /// A vertex, from 0.
    Vertex(usize),
    /// A point, in the numbers of the mesh file.
    Point(Point3),
}

/// A landmark on one mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Its name; `1`, `2`, … where the file has none.
    pub name: String,
    /// Where it is.
    pub place: MarkPlace,
}

/// A landmark on both meshes.
#[derive(Clone, Debug, PartialEq)]
pub struct PickedPair {
    /// Its name.
    pub name: String,
    /// On the preoperative mesh.
    pub ct: MarkPlace,
    /// On the template.
    pub template: MarkPlace,
}

impl MarkPlace {
    /// The point itself, on a mesh of these vertices; points of the file times `factor`.
    ///
    /// # Errors
    /// A vertex that the mesh does not have.
    pub fn on(&self, vertices: &[Point3], factor: f64) -> Result<Point3, String> {
        match *self {
            Self::Point(p) => Ok(p * factor),
            Self::Vertex(v) => vertices.get(v).copied().ok_or_else(|| {
                format!("vertex {v} does not exist; the mesh has {}", vertices.len())
            }),
        }
    }
}
