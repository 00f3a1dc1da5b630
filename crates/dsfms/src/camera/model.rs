//! Intrinsics: focal lengths, principal point, lens.

use super::{Camera, Distorted, Lens, Projection};
use crate::geometry::{Point2, Point3, Vector2, Vector3};
use nalgebra::{Matrix2x3, Matrix3};
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

/// What makes a camera unusable.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// An image without pixels.
    #[error("camera size is {0:?} px; width and height must be positive")]
    Size([usize; 2]),
    /// NaN or infinite.
    #[error("camera field {field} is {value}; it must be a finite number")]
    NotFinite {
        /// Name of the number.
        field: &'static str,
        /// What it is.
        value: f64,
    },
    /// Zero or negative focal length.
    #[error("camera field {field} is {value}; a focal length in px must be positive")]
    Focal {
        /// `fx` or `fy`.
        field: &'static str,
        /// What it is.
        value: f64,
    },
    /// Principal point more than one image size outside the image.
    #[error(
        "camera field {field} is {value}, far outside the image of {size} px; expected px of this resolution"
    )]
    Centre {
        /// `cx` or `cy`.
        field: &'static str,
        /// What it is.
        value: f64,
        /// Width or height, px.
        size: usize,
    },
}

impl CameraModel {
    /// A camera without distortion: size, focal lengths and principal point in px, pixel centres at
    /// integers.
    pub fn pinhole(size: [usize; 2], focal: [f64; 2], centre: [f64; 2]) -> Self {
        Self { size, focal, centre, lens: Lens::default() }
    }

    /// The 3x3 matrix K of the pinhole part.
    pub fn matrix(&self) -> Matrix3<f64> {
        let ([fx, fy], [cx, cy]) = (self.focal, self.centre);
        Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    }

    /// Normalised coordinates `(x/z, y/z)` of a pixel, distortion removed.
    pub(crate) fn normalise(&self, pixel: &Point2) -> Option<Vector2> {
        let x = (pixel.x - self.centre[0]) / self.focal[0];
        let y = (pixel.y - self.centre[1]) / self.focal[1];
        self.lens.undistort(&Vector2::new(x, y))
    }

    /// The camera of the image halved by `image::filter::halve`: the centre of a small
    /// pixel lies between four centres of the large image.
    pub fn halved(&self) -> Self {
        Self {
            size: self.size.map(|n| n / 2),
            focal: self.focal.map(|f| 0.5 * f),
            centre: self.centre.map(|c| 0.5 * (c - 0.5)),
            lens: self.lens,
        }
    }

    /// Check every number. The principal point may lie up to one image size outside the image
    /// (crops), no further.
    ///
    /// # Errors
    /// The first number that makes no sense, by name.
    pub fn validate(&self) -> Result<(), CameraError> {
        if self.size.contains(&0) {
            return Err(CameraError::Size(self.size));
        }
        let ([fx, fy], [cx, cy]) = (self.focal, self.centre);
        let named = [("fx", fx), ("fy", fy), ("cx", cx), ("cy", cy)];
        for (field, value) in named.into_iter().chain(self.lens.coefficients()) {
            if !value.is_finite() {
                return Err(CameraError::NotFinite { field, value });
            }
        }
        for (field, value) in [("fx", fx), ("fy", fy)] {
            if value <= 0.0 {
                return Err(CameraError::Focal { field, value });
            }
        }
        for (field, value, size) in [("cx", cx, self.size[0]), ("cy", cy, self.size[1])] {
            let extent = size as f64;
            if value < -extent || value > 2.0 * extent {
                return Err(CameraError::Centre { field, value, size });
            }
        }
        Ok(())
    }
}

impl Camera for CameraModel {
    fn size(&self) -> [usize; 2] {
        self.size
    }

    fn project(&self, point: &Point3) -> Option<Projection> {
        if point.z.is_nan() || point.z <= 0.0 {
            return None;
        }
        let iz = 1.0 / point.z;
        let normalised = Vector2::new(point.x * iz, point.y * iz);
        let Distorted { value, jacobian } = self.lens.distort(&normalised)?;
        let pixel = Point2::new(
            self.focal[0] * value.x + self.centre[0],
            self.focal[1] * value.y + self.centre[1],
        );
        let perspective = Matrix2x3::new(iz, 0.0, -normalised.x * iz, 0.0, iz, -normalised.y * iz);
        let mut jacobian = jacobian * perspective;
        jacobian.row_mut(0).scale_mut(self.focal[0]);
        jacobian.row_mut(1).scale_mut(self.focal[1]);
        pixel.coords.iter().all(|v| v.is_finite()).then_some(Projection { pixel, jacobian })
    }

    fn unproject(&self, pixel: &Point2) -> Option<Vector3> {
        let normalised = self.normalise(pixel)?;
        Some(Vector3::new(normalised.x, normalised.y, 1.0).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> CameraModel {
        CameraModel::pinhole([640, 480], [548.0, 549.0], [316.4, 243.2])
    }

    #[test]
    fn validate_names_the_field() {
        let bad = CameraModel { focal: [548.0, f64::NAN], ..camera() };
        assert!(bad.validate().unwrap_err().to_string().contains("fy is NaN"));
        let bad = CameraModel { focal: [-1.0, 549.0], ..camera() };
        assert!(bad.validate().unwrap_err().to_string().contains("fx is -1"));
        let bad = CameraModel { centre: [1400.0, 243.2], ..camera() };
        assert!(bad.validate().unwrap_err().to_string().contains("cx is 1400"));
        let lens = Lens::KannalaBrandt { k: [0.0, 0.0, f64::INFINITY, 0.0] };
        assert!(CameraModel { lens, ..camera() }.validate().is_err());
        assert!(CameraModel { size: [0, 480], ..camera() }.validate().is_err());
        assert!(camera().validate().is_ok());
    }

    #[test]
    fn halving_agrees_with_pixel_centres() {
        let point = Point3::new(2.0, -1.0, 40.0);
        let full = camera().project(&point).unwrap().pixel;
        let half = camera().halved().project(&point).unwrap().pixel;
        assert!(((full.x - 0.5) / 2.0 - half.x).abs() < 1e-12);
        assert!(((full.y - 0.5) / 2.0 - half.y).abs() < 1e-12);
    }
}
