//! OpenCV's rational model:
//!
//! ```text
//! x_d = x R(r²) + 2 p1 x y + p2 (r² + 2x²),   R(u) = (1 + k1 u + k2 u² + k3 u³) / (1 + k4 u + k5 u² + k6 u³)
//! y_d = y R(r²) + p1 (r² + 2y²) + 2 p2 x y
//! ```
//!
//! The model holds from the axis out to where `r R(r²)` stops growing, the denominator vanishes, or
//! the map folds.

use super::brown_conrady::radial_and_tangential;
use super::{Distorted, LensModel, newton, polynomial};
use crate::geometry::Vector2;

/// Radial and tangential coefficients.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rational {
    /// k1 to k6.
    pub k: [f64; 6],
    /// p1, p2.
    pub p: [f64; 2],
}

impl Rational {
    /// Coefficients of numerator and denominator.
    fn fraction(&self) -> [[f64; 4]; 2] {
        let [k1, k2, k3, k4, k5, k6] = self.k;
        [[1.0, k1, k2, k3], [1.0, k4, k5, k6]]
    }
}

/// Derivative of a cubic.
fn derivative(c: &[f64; 4]) -> [f64; 3] {
    [c[1], 2.0 * c[2], 3.0 * c[3]]
}

impl LensModel for Rational {
    const NAME: &'static str = "rational";
    const WORDS: &'static [&'static str] = &["rational", "full_opencv"];
    const COEFFICIENTS: &'static [&'static str] = &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
    const LEAST: usize = 8;
    const PERSPECTIVE: bool = true;

    fn of(c: &[f64]) -> Self {
        Self { k: [c[0], c[1], c[4], c[5], c[6], c[7]], p: [c[2], c[3]] }
    }

    fn coefficients(&self) -> Vec<f64> {
        let ([k1, k2, k3, k4, k5, k6], [p1, p2]) = (self.k, self.p);
        vec![k1, k2, p1, p2, k3, k4, k5, k6]
    }

    fn distort(&self, point: &Vector2) -> Option<Distorted> {
        let u = point.norm_squared();
        let [n, d] = self.fraction();
        // d(r N/D)/dr · D² = (N + 2u N') D − 2u N D', a polynomial of degree six.
        let mut growth = [0.0; 7];
        for (i, n) in n.iter().enumerate() {
            for (j, d) in d.iter().enumerate() {
                growth[i + j] += n * d * (1.0 + 2.0 * i as f64 - 2.0 * j as f64);
            }
        }
        if !(polynomial::positive_up_to(&d, u) && polynomial::positive_up_to(&growth, u)) {
            return None;
        }
        let below = polynomial::evaluate(&d, u);
        let radial = polynomial::evaluate(&n, u) / below;
        let [up, down] = [n, d].map(|c| polynomial::evaluate(&derivative(&c), u));
        let image = radial_and_tangential(radial, (up - radial * down) / below, &self.p, point);
        (image.jacobian.determinant() > 0.0).then_some(image)
    }

    fn undistort(&self, target: &Vector2) -> Option<Vector2> {
        newton::invert(|point| self.distort(point), target)
    }

    fn radial_derivatives(&self, point: &Vector2) -> [Vector2; 2] {
        let u = point.norm_squared();
        let first = u / polynomial::evaluate(&self.fraction()[1], u);
        [point * first, point * (first * u)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::BrownConrady;

    #[test]
    fn a_value_worked_by_hand() {
        let lens = Rational { k: [0.1, 0.2, 0.4, 0.2, 0.4, 0.8], p: [0.01, 0.02] };
        let image = lens.distort(&Vector2::new(0.3, -0.4)).unwrap(); // r² = 0.25
        let radial = 1.04375 / (1.0 + 0.05 + 0.025 + 0.0125);
        let x = 0.3 * radial + 2.0 * 0.01 * -0.12 + 0.02 * (0.25 + 0.18);
        let y = -0.4 * radial + 0.01 * (0.25 + 0.32) + 2.0 * 0.02 * -0.12;
        assert!((image.value - Vector2::new(x, y)).norm() < 1e-15);
    }

    #[test]
    fn without_a_denominator_it_is_brown_conrady() {
        let (k, p) = ([-0.2, 0.05, 0.01], [0.003, -0.002]);
        let plain = BrownConrady { k, p };
        let lens = Rational { k: [k[0], k[1], k[2], 0.0, 0.0, 0.0], p };
        let point = Vector2::new(0.5, -0.3);
        let (a, b) = (lens.distort(&point).unwrap(), plain.distort(&point).unwrap());
        assert!((a.value - b.value).norm() < 1e-15 && (a.jacobian - b.jacobian).norm() < 1e-15);
        assert_eq!(lens.radial_derivatives(&point), plain.radial_derivatives(&point));
    }

    #[test]
    fn nothing_beyond_the_turning_radius_or_the_pole() {
        // r / (1 + r²) turns at r = 1, where the image is at ½.
        let lens = Rational { k: [0.0, 0.0, 0.0, 1.0, 0.0, 0.0], p: [0.0; 2] };
        assert!(lens.distort(&Vector2::new(0.999, 0.0)).is_some());
        assert!(lens.distort(&Vector2::new(1.001, 0.0)).is_none());
        assert!(lens.undistort(&Vector2::new(0.499, 0.0)).is_some());
        assert!(lens.undistort(&Vector2::new(0.501, 0.0)).is_none());
        // r / (1 − r²) grows without end towards r = 1.
        let lens = Rational { k: [0.0, 0.0, 0.0, -1.0, 0.0, 0.0], p: [0.0; 2] };
        let far = lens.undistort(&Vector2::new(100.0, 0.0)).unwrap();
        assert!((0.99..1.0).contains(&far.x));
        assert!(lens.distort(&Vector2::new(1.001, 0.0)).is_none());
    }
}
