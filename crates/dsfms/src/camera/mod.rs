//! Cameras: from a point in camera axes (x right, y down, z forward) to a pixel and back.
//!
//! ```
//! use dsfms::camera::{Camera, CameraModel, Lens};
//! use dsfms::geometry::Point3;
//! let lens = Lens::BrownConrady { k: [-0.2, 0.1, 0.0], p: [0.0, 0.0] };
//! let camera = CameraModel { size: [640, 480], focal: [548.0, 549.0], centre: [316.4, 243.2], lens };
//! let pixel = camera.project(&Point3::new(5.0, -3.0, 60.0)).unwrap().pixel;
//! let ray = camera.unproject(&pixel).unwrap();
//! assert!((ray * 60.0 / ray.z - Point3::new(5.0, -3.0, 60.0).coords).norm() < 1e-9);
//! ```

use crate::geometry::{Point2, Point3, Vector2, Vector3};
use nalgebra::{Matrix2, Matrix2x3};

/// A pixel and `∂pixel/∂point`, px per length unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Position in px, pixel centres at integers.
    pub pixel: Point2,
    /// Derivative with respect to the point in camera axes.
    pub jacobian: Matrix2x3<f64>,
}

/// Distorted normalised coordinates and their derivative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distorted {
    /// `(x_d, y_d)`, without unit.
    pub value: Vector2,
    /// `∂(x_d, y_d)/∂(x/z, y/z)`.
    pub jacobian: Matrix2<f64>,
}

/// What every camera model can do.
pub trait Camera: Send + Sync {
    /// Width and height in px.
    fn size(&self) -> [usize; 2];
    /// Where a point in camera axes appears; `None` behind the camera or outside the domain in
    /// which the distortion is monotonic. The pixel may lie outside the image.
    fn project(&self, point: &Point3) -> Option<Projection>;
    /// Unit direction of the sightline of a pixel; `None` where the distortion has no inverse.
    fn unproject(&self, pixel: &Point2) -> Option<Vector3>;
}

/// What a lens model says of itself; everything else follows from it.
///
/// A new one is a struct with this trait in a file of its own, and its line in the table of
/// `lens.rs`.
pub(crate) trait LensModel: Sized {
    /// As our files call it.
    const NAME: &'static str;
    /// Words by which others know it, small letters; the lens of a text is the last of the table
    /// with one of its words.
    const WORDS: &'static [&'static str];
    /// Names of its coefficients in OpenCV's order.
    const COEFFICIENTS: &'static [&'static str];
    /// A list of numbers holds at least so many of them.
    const LEAST: usize;
    /// Whether all coefficients zero make a pinhole of it.
    const PERSPECTIVE: bool;
    /// Of all its coefficients.
    fn of(coefficients: &[f64]) -> Self;
    /// All its coefficients.
    fn coefficients(&self) -> Vec<f64>;
    /// Distorted normalised coordinates `(x/z, y/z)`; `None` outside the model's domain.
    fn distort(&self, point: &Vector2) -> Option<Distorted>;
    /// Inverse of [`Self::distort`]; `None` where there is none.
    fn undistort(&self, point: &Vector2) -> Option<Vector2>;
    /// `∂(x_d, y_d)/∂(k1, k2)` at `(x/z, y/z)`.
    fn radial_derivatives(&self, point: &Vector2) -> [Vector2; 2];
}

mod brown_conrady;
#[cfg(test)]
mod check;
mod kannala_brandt;
mod lens;
mod model;
mod newton;
mod pinhole;
mod polynomial;
mod posed;
mod rational;
pub mod resample;

pub use brown_conrady::BrownConrady;
pub use kannala_brandt::KannalaBrandt;
pub use lens::{Lens, LensKind};
pub use model::{CameraError, CameraModel};
pub use pinhole::Pinhole;
pub use posed::PosedFrame;
pub use rational::Rational;
