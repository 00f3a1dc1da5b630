//! Pure functions on points and numbers: triangles, barycentric coordinates, rigid and similarity
//! alignment, medians, robust losses, disjoint sets.

pub mod alignment;
pub mod neighbours;
pub mod robust;
pub mod sets;
pub mod statistics;
pub mod triangle;

pub(crate) use alignment::turn_between;
pub use alignment::{align_rigid, align_rigid_few, align_rigid_robust, align_similarity};
pub use neighbours::Neighbours;
pub use robust::Loss;
pub use sets::DisjointSets;
pub(crate) use statistics::scatter;
pub use statistics::{SIGMA_OVER_MAD, centre_and_spread, median};
pub(crate) use triangle::signed_area;
pub use triangle::{area, area_normal, barycentric, normal, point_at};

/// Vertices, edges or faces that one task of a parallel loop takes at least: the work on fewer is
/// soon done.
pub(crate) const GRAIN: usize = 256;

/// Corners of the axis-aligned box around points; infinite around none.
pub(crate) fn bounding_box(points: &[Point3]) -> [Point3; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY].map(|v| Point3::new(v, v, v));
    points.iter().fold(none, |[low, high], p| [low.inf(p), high.sup(p)])
}

/// A point of 3-space; mm or template units, the frame named where it is used.
pub type Point3 = nalgebra::Point3<f64>;
/// A free vector of 3-space.
pub type Vector3 = nalgebra::Vector3<f64>;
/// A point of the image plane in px, pixel centres at integers.
pub type Point2 = nalgebra::Point2<f64>;
/// A free vector of the image plane in px.
pub type Vector2 = nalgebra::Vector2<f64>;
/// A rigid motion, written right to left: `camera_from_world * point_in_world`.
pub type Isometry = nalgebra::Isometry3<f64>;
/// A rigid motion with a scale.
pub type Similarity = nalgebra::Similarity3<f64>;
