//! Cameras: from a point in camera axes (x right, y down, z forward) to a pixel and back.

use crate::geometry::{Point2, Point3, Vector3};
use nalgebra::Matrix2x3;

/// A pixel and `∂pixel/∂point`, px per length unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Position in px, pixel centres at integers.
    pub pixel: Point2,
    /// Derivative with respect to the point in camera axes.
    pub jacobian: Matrix2x3<f64>,
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

pub mod model;
pub use model::{CameraModel, Lens};
