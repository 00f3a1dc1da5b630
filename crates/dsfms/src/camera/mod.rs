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

mod brown_conrady;
#[cfg(test)]
mod check;
mod kannala_brandt;
mod lens;
mod model;
mod newton;
mod pinhole;
mod polynomial;
mod rational;
pub mod resample;

pub use brown_conrady::BrownConrady;
pub use kannala_brandt::KannalaBrandt;
pub(crate) use lens::LensModel;
pub use lens::{Lens, LensKind};
pub use model::{CameraError, CameraModel};
pub use pinhole::Pinhole;
pub use rational::Rational;
