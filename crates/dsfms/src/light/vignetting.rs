//! Vignetting: what a lens takes from the corners of the image.
//!
//! ```text
//! V(x) = max(1 + a r², V₀),   r² = (x² + y²) / z²
//! ```
//!
//! with `r` the distance of the undistorted pixel from the principal point over the focal length,
//! the tangent of the angle from the optical axis. Natural vignetting, cos⁴, is near a = −2 for
//! small angles. As a factor on what a surface point sends to the camera it is in one place for
//! albedo, prediction and renderer, and pictures stay as they are.

use crate::geometry::{Point3, Vector3};

/// Least and largest `a` of a lens: none takes more (cos⁴ is −2), and none brightens its corners
/// much.
pub const BOUNDS: [f64; 2] = [-2.0, 0.2];

/// V₀: a polynomial that is right near the axis must not turn the corners dark, or negative.
const LEAST: f64 = 0.1;

/// `V` at a point in camera axes before the camera, and its derivative by the point; `a` of the
/// formula, 0 = none, below 0 = darker corners.
pub fn vignetting(a: f64, point: &Point3) -> (f64, Vector3) {
    let depth2 = point.z * point.z;
    let r2 = (point.x * point.x + point.y * point.y) / depth2;
    let value = 1.0 + a * r2;
    // Not a number for a point in the camera's own plane, which no camera sees.
    if value.is_nan() || value < LEAST {
        return (LEAST, Vector3::zeros());
    }
    (value, Vector3::new(point.x, point.y, -r2 * point.z) * (2.0 * a / depth2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        // r² = (9 + 16) / 100.
        let (value, slope) = vignetting(-0.4, &Point3::new(3.0, -4.0, 10.0));
        assert!((value - 0.9).abs() < 1e-15);
        assert!((slope - Vector3::new(-0.024, 0.032, 0.02)).norm() < 1e-15);
        assert_eq!(vignetting(0.0, &Point3::new(3.0, -4.0, 10.0)), (1.0, Vector3::zeros()));
        assert_eq!(vignetting(-2.0, &Point3::new(9.0, 0.0, 10.0)), (LEAST, Vector3::zeros()));
    }
}
