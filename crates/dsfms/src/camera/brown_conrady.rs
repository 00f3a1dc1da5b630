//! Brown-Conrady distortion, as OpenCV writes it:
//!
//! ```text
//! x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²)
//! y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2y²) + 2 p2 x y
//! ```
//!
//! The model holds from the axis out to where the radial part stops growing or the map folds.

use super::{Distorted, LensModel, newton, polynomial};
use crate::geometry::Vector2;
use nalgebra::Matrix2;

/// Radial and tangential coefficients.
#[derive(Clone, Copy, Debug, Default)]
pub struct BrownConrady {
    /// k1, k2, k3.
    pub k: [f64; 3],
    /// p1, p2.
    pub p: [f64; 2],
}

impl LensModel for BrownConrady {
    const NAME: &'static str = "brown_conrady";
    const WORDS: &'static [&'static str] = &["brown", "opencv", "plumb", "radtan", "radial"];
    const COEFFICIENTS: &'static [&'static str] = &["k1", "k2", "p1", "p2", "k3"];
    const LEAST: usize = 4;
    const PERSPECTIVE: bool = true;

    fn of(c: &[f64]) -> Self {
        Self { k: [c[0], c[1], c[4]], p: [c[2], c[3]] }
    }

    fn coefficients(&self) -> Vec<f64> {
        let ([k1, k2, k3], [p1, p2]) = (self.k, self.p);
        vec![k1, k2, p1, p2, k3]
    }

    /// `None` outside the domain in which the radial part is monotonic and the map keeps its
    /// orientation.
    fn distort(&self, point: &Vector2) -> Option<Distorted> {
        let [k1, k2, k3] = self.k;
        let u = point.norm_squared();
        if !polynomial::positive_up_to(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3], u) {
            return None;
        }
        let radial = polynomial::evaluate(&[1.0, k1, k2, k3], u);
        let slope = polynomial::evaluate(&[k1, 2.0 * k2, 3.0 * k3], u);
        let image = radial_and_tangential(radial, slope, &self.p, point);
        (image.jacobian.determinant() > 0.0).then_some(image)
    }

    fn undistort(&self, target: &Vector2) -> Option<Vector2> {
        newton::invert(|point| self.distort(point), target)
    }

    fn radial_derivatives(&self, point: &Vector2) -> [Vector2; 2] {
        let u = point.norm_squared();
        [point * u, point * (u * u)]
    }
}

/// The map of a radial factor of `u = r²` with its slope by u, and of p1, p2.
pub(super) fn radial_and_tangential(
    radial: f64,
    slope: f64,
    p: &[f64; 2],
    point: &Vector2,
) -> Distorted {
    let (x, y) = (point.x, point.y);
    let u = x * x + y * y;
    let slope = 2.0 * slope;
    let [p1, p2] = *p;
    let value = Vector2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (u + 2.0 * x * x),
        y * radial + p1 * (u + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let mixed = slope * x * y + 2.0 * (p1 * x + p2 * y);
    let jacobian = Matrix2::new(
        radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
        mixed,
        mixed,
        radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
    );
    Distorted { value, jacobian }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_worked_by_hand() {
        let point = Vector2::new(0.3, -0.4); // r² = 0.25
        let image = BrownConrady { k: [0.1, 0.2, 0.4], p: [0.01, 0.02] }.distort(&point).unwrap();
        let radial = 1.0 + 0.025 + 0.0125 + 0.00625;
        let x = 0.3 * radial + 2.0 * 0.01 * -0.12 + 0.02 * (0.25 + 0.18);
        let y = -0.4 * radial + 0.01 * (0.25 + 0.32) + 2.0 * 0.02 * -0.12;
        assert!((image.value - Vector2::new(x, y)).norm() < 1e-15);
    }

    #[test]
    fn nothing_beyond_the_turning_radius() {
        // x(1 - r²/3): turns at r = 1, where the image is at 2/3.
        let lens = BrownConrady { k: [-1.0 / 3.0, 0.0, 0.0], p: [0.0; 2] };
        assert!(lens.distort(&Vector2::new(0.999, 0.0)).is_some());
        assert!(lens.distort(&Vector2::new(1.001, 0.0)).is_none());
        assert!(lens.undistort(&Vector2::new(0.66, 0.0)).is_some());
        assert!(lens.undistort(&Vector2::new(0.67, 0.0)).is_none());
        assert!(lens.undistort(&Vector2::new(f64::NAN, 0.0)).is_none());
    }
}
