//! Brown-Conrady distortion, as OpenCV writes it:
//!
//! ```text
//! x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²)
//! y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2y²) + 2 p2 x y
//! ```
//!
//! The model holds from the axis out to where the radial part stops growing or the map folds.

use super::{Distorted, polynomial};
use crate::geometry::Vector2;
use nalgebra::Matrix2;

/// Distorted normalised coordinates and their derivative; `None` outside the domain in which the
/// radial part is monotonic and the map keeps its orientation.
///
/// `k` is k1, k2, k3; `p` is p1, p2; `point` is `(x/z, y/z)`.
pub fn distort(k: &[f64; 3], p: &[f64; 2], point: &Vector2) -> Option<Distorted> {
    let growth = [1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2]];
    if !polynomial::positive_up_to(&growth, point.norm_squared()) {
        return None;
    }
    let image = evaluate(k, p, point);
    (image.jacobian.determinant() > 0.0).then_some(image)
}

fn evaluate(k: &[f64; 3], p: &[f64; 2], point: &Vector2) -> Distorted {
    let (x, y) = (point.x, point.y);
    let u = x * x + y * y;
    let radial = polynomial::evaluate(&[1.0, k[0], k[1], k[2]], u);
    let slope = 2.0 * polynomial::evaluate(&[k[0], 2.0 * k[1], 3.0 * k[2]], u);
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

/// Inverse of [`distort`]: Newton's method that never leaves the domain; `None` where no point of
/// the domain maps to `target`.
pub fn undistort(k: &[f64; 3], p: &[f64; 2], target: &Vector2) -> Option<Vector2> {
    let mut point = *target;
    let mut image = loop {
        match distort(k, p, &point) {
            Some(image) => break image,
            None if point.norm() > 1e-9 => point *= 0.5,
            None => return None,
        }
    };
    for _ in 0..50 {
        let residual = image.value - target;
        if residual.norm() <= 1e-14 * (1.0 + target.norm()) {
            return Some(point);
        }
        let step = image.jacobian.try_inverse()? * residual;
        match shortened(k, p, target, &point, &step, residual.norm()) {
            Some(next) => (point, image) = next,
            None => break,
        }
    }
    ((image.value - target).norm() < 1e-10 * (1.0 + target.norm())).then_some(point)
}

/// The longest of the steps `1, ½, ¼ …` that stays in the domain and comes closer to `target`.
fn shortened(
    k: &[f64; 3],
    p: &[f64; 2],
    target: &Vector2,
    point: &Vector2,
    step: &Vector2,
    residual: f64,
) -> Option<(Vector2, Distorted)> {
    (0..30).find_map(|halvings| {
        let trial = point - step * 0.5_f64.powi(halvings);
        let image = distort(k, p, &trial)?;
        ((image.value - target).norm() < residual).then_some((trial, image))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_worked_by_hand() {
        let point = Vector2::new(0.3, -0.4); // r² = 0.25
        let image = distort(&[0.1, 0.2, 0.4], &[0.01, 0.02], &point).unwrap();
        let radial = 1.0 + 0.025 + 0.0125 + 0.00625;
        let x = 0.3 * radial + 2.0 * 0.01 * -0.12 + 0.02 * (0.25 + 0.18);
        let y = -0.4 * radial + 0.01 * (0.25 + 0.32) + 2.0 * 0.02 * -0.12;
        assert!((image.value - Vector2::new(x, y)).norm() < 1e-15);
    }

    #[test]
    fn nothing_beyond_the_turning_radius() {
        // x(1 - r²/3): turns at r = 1, where the image is at 2/3.
        let k = [-1.0 / 3.0, 0.0, 0.0];
        assert!(distort(&k, &[0.0; 2], &Vector2::new(0.999, 0.0)).is_some());
        assert!(distort(&k, &[0.0; 2], &Vector2::new(1.001, 0.0)).is_none());
        assert!(undistort(&k, &[0.0; 2], &Vector2::new(0.66, 0.0)).is_some());
        assert!(undistort(&k, &[0.0; 2], &Vector2::new(0.67, 0.0)).is_none());
        assert!(undistort(&k, &[0.0; 2], &Vector2::new(f64::NAN, 0.0)).is_none());
    }
}
