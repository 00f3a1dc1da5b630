//! Kannala-Brandt fisheye distortion, as OpenCV writes it:
//!
//! ```text
//! θ = atan r,   θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸),   x_d = (θ_d / r) x
//! ```
//!
//! in normalised coordinates `x/z, y/z` with `r` their norm, hence for points in front of the
//! camera: fields of view below 180 degrees.

use super::{Distorted, LensModel, polynomial};
use crate::geometry::Vector2;
use nalgebra::Matrix2;

/// Coefficients k1 to k4.
#[derive(Clone, Copy, Debug, Default)]
pub struct KannalaBrandt {
    /// k1 to k4.
    pub k: [f64; 4],
}

impl LensModel for KannalaBrandt {
    const NAME: &'static str = "kannala_brandt";
    const WORDS: &'static [&'static str] = &["fisheye", "kannala", "equidistant"];
    const COEFFICIENTS: &'static [&'static str] = &["k1", "k2", "k3", "k4"];
    const LEAST: usize = 4;
    const PERSPECTIVE: bool = false;

    fn of(c: &[f64]) -> Self {
        Self { k: [c[0], c[1], c[2], c[3]] }
    }

    fn coefficients(&self) -> Vec<f64> {
        self.k.to_vec()
    }

    /// `None` where `θ_d` has stopped growing.
    fn distort(&self, point: &Vector2) -> Option<Distorted> {
        let k = &self.k;
        let r = point.norm();
        let (theta_d, slope) = angle(k, r.atan())?;
        // s = θ_d/r and s'/r; the series near the axis avoids 0/0.
        let (scale, bend) = if r < 1e-4 {
            let c = k[0] - 1.0 / 3.0;
            (1.0 + c * r * r, 2.0 * c)
        } else {
            let scale = theta_d / r;
            (scale, (slope / (1.0 + r * r) - scale) / (r * r))
        };
        let jacobian = Matrix2::identity() * scale + point * point.transpose() * bend;
        Some(Distorted { value: point * scale, jacobian })
    }

    /// `None` where no point in front of the camera maps to `target`.
    fn undistort(&self, target: &Vector2) -> Option<Vector2> {
        let k = &self.k;
        let theta_d = target.norm();
        if theta_d < 1e-12 {
            return Some(*target);
        }
        let theta = invert_angle(k, theta_d)?;
        (theta < std::f64::consts::FRAC_PI_2 - 1e-6).then(|| target * (theta.tan() / theta_d))
    }

    fn radial_derivatives(&self, point: &Vector2) -> [Vector2; 2] {
        let r = point.norm();
        let theta = r.atan();
        let first = if r < 1e-9 { r * r } else { theta.powi(3) / r };
        [point * first, point * (first * theta * theta)]
    }
}

/// `θ_d` and `dθ_d/dθ`; `None` beyond the first maximum of `θ_d`.
fn angle(k: &[f64; 4], theta: f64) -> Option<(f64, f64)> {
    let u = theta * theta;
    let growth = [1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]];
    polynomial::positive_up_to(&growth, u).then(|| {
        let scale = polynomial::evaluate(&[1.0, k[0], k[1], k[2], k[3]], u);
        (theta * scale, polynomial::evaluate(&growth, u))
    })
}

/// Newton's method on `θ_d(θ) = target`, with steps shortened to stay where `θ_d` grows.
fn invert_angle(k: &[f64; 4], target: f64) -> Option<f64> {
    let mut theta = target.min(1.5);
    let mut image = loop {
        match angle(k, theta) {
            Some(image) => break image,
            None if theta > 1e-9 => theta *= 0.5,
            None => return None,
        }
    };
    for _ in 0..50 {
        let residual = image.0 - target;
        if residual.abs() <= 1e-15 * (1.0 + target) {
            break;
        }
        let step = residual / image.1;
        let closer = (0..30).find_map(|halvings| {
            let trial = theta - step * 0.5_f64.powi(halvings);
            let image = angle(k, trial).filter(|_| trial >= 0.0)?;
            ((image.0 - target).abs() < residual.abs()).then_some((trial, image))
        });
        let Some(next) = closer else { break };
        (theta, image) = next;
    }
    ((image.0 - target).abs() < 1e-10 * (1.0 + target)).then_some(theta)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equidistant_lens_by_hand() {
        // No coefficients: r_d = θ, so 45 degrees lies at π/4.
        let image = KannalaBrandt { k: [0.0; 4] }.distort(&Vector2::new(0.0, 1.0)).unwrap();
        assert!((image.value - Vector2::new(0.0, std::f64::consts::FRAC_PI_4)).norm() < 1e-15);
        assert!(KannalaBrandt { k: [0.0; 4] }.undistort(&Vector2::new(1.58, 0.0)).is_none());
    }

    #[test]
    fn series_and_formula_meet_near_the_axis() {
        let lens = KannalaBrandt { k: [0.05, -0.01, 0.02, 0.003] };
        let below = lens.distort(&Vector2::new(0.99999e-4, 0.0)).unwrap();
        let above = lens.distort(&Vector2::new(1.00001e-4, 0.0)).unwrap();
        assert!((below.value / 0.99999 - above.value / 1.00001).norm() < 1e-12);
        assert!((below.jacobian - above.jacobian).norm() < 1e-7);
        // θ_d/r = 1 + (k1 − 1/3) r² + …
        let near = lens.distort(&Vector2::new(5e-5, 0.0)).unwrap();
        let bend = (near.value.x / 5e-5 - 1.0) / (5e-5 * 5e-5);
        assert!((bend - (0.05 - 1.0 / 3.0)).abs() < 1e-6, "{bend}");
    }

    #[test]
    fn nothing_beyond_the_turning_angle() {
        // θ(1 - θ²/3) turns at 1 rad.
        let lens = KannalaBrandt { k: [-1.0 / 3.0, 0.0, 0.0, 0.0] };
        assert!(lens.distort(&Vector2::new(0.99_f64.tan(), 0.0)).is_some());
        assert!(lens.distort(&Vector2::new(1.01_f64.tan(), 0.0)).is_none());
        assert!(lens.undistort(&Vector2::new(0.66, 0.0)).is_some());
        assert!(lens.undistort(&Vector2::new(0.67, 0.0)).is_none());
    }
}
