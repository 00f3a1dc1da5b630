//! The lens without distortion.

use super::Distorted;
use crate::geometry::Vector2;
use nalgebra::Matrix2;

/// The identity of normalised coordinates `(x/z, y/z)`, with its derivative.
pub fn distort(point: &Vector2) -> Option<Distorted> {
    Some(Distorted { value: *point, jacobian: Matrix2::identity() })
}

/// Inverse of [`distort`].
pub fn undistort(point: &Vector2) -> Option<Vector2> {
    Some(*point)
}
