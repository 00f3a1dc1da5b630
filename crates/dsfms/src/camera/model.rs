//! The camera models a file can name.

use super::{Camera, Projection};
use crate::geometry::{Point2, Point3, Vector3};
use nalgebra::Matrix2x3;
use serde::{Deserialize, Serialize};

/// Intrinsics: `pixel = focal · distort(x/z, y/z) + centre`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraModel {
    /// Width and height in px.
    pub size: [usize; 2],
    /// Focal lengths in px.
    pub focal: [f64; 2],
    /// Principal point in px, pixel centres at integers.
    pub centre: [f64; 2],
    /// Lens distortion.
    pub lens: Lens,
}

/// Lens distortion of normalised coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lens {
    /// Perfect pinhole.
    #[default]
    Pinhole,
    /// OpenCV's k1, k2, k3 (radial) and p1, p2 (tangential).
    BrownConrady {
        /// Radial coefficients k1, k2, k3.
        k: [f64; 3],
        /// Tangential coefficients p1, p2.
        p: [f64; 2],
    },
    /// OpenCV fisheye: `θ_d = θ(1 + k1θ² + k2θ⁴ + k3θ⁶ + k4θ⁸)`.
    KannalaBrandt {
        /// k1 to k4.
        k: [f64; 4],
    },
}

impl Camera for CameraModel {
    fn size(&self) -> [usize; 2] {
        self.size
    }

    fn project(&self, point: &Point3) -> Option<Projection> {
        if point.z <= 0.0 {
            return None;
        }
        let (x, y, iz) = (point.x / point.z, point.y / point.z, 1.0 / point.z);
        let [fx, fy] = self.focal;
        Some(Projection {
            pixel: Point2::new(fx * x + self.centre[0], fy * y + self.centre[1]),
            jacobian: Matrix2x3::new(fx * iz, 0.0, -fx * x * iz, 0.0, fy * iz, -fy * y * iz),
        })
    }

    fn unproject(&self, pixel: &Point2) -> Option<Vector3> {
        let x = (pixel.x - self.centre[0]) / self.focal[0];
        let y = (pixel.y - self.centre[1]) / self.focal[1];
        Some(Vector3::new(x, y, 1.0).normalize())
    }
}
