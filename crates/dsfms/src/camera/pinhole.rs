//! The lens without distortion.

use super::{Distorted, LensModel};
use crate::geometry::Vector2;
use nalgebra::Matrix2;

/// The identity of normalised coordinates `(x/z, y/z)`.
#[derive(Clone, Copy, Debug)]
pub struct Pinhole;

impl LensModel for Pinhole {
    const NAME: &'static str = "none";
    const WORDS: &'static [&'static str] = &["none", "pinhole", "no "];
    const COEFFICIENTS: &'static [&'static str] = &[];
    const LEAST: usize = 0;
    const PERSPECTIVE: bool = true;

    fn of(_: &[f64]) -> Self {
        Self
    }

    fn coefficients(&self) -> Vec<f64> {
        Vec::new()
    }

    fn distort(&self, point: &Vector2) -> Option<Distorted> {
        Some(Distorted { value: *point, jacobian: Matrix2::identity() })
    }

    fn undistort(&self, point: &Vector2) -> Option<Vector2> {
        Some(*point)
    }

    fn radial_derivatives(&self, _: &Vector2) -> [Vector2; 2] {
        [Vector2::zeros(); 2]
    }
}
