//! Newton's method for the inverse of a distortion.

use super::Distorted;
use crate::geometry::Vector2;

/// Where `distort` maps to `target`, without leaving its domain (`Some`); `None` where no point of
/// the domain does.
pub(super) fn invert(
    distort: impl Fn(&Vector2) -> Option<Distorted>,
    target: &Vector2,
) -> Option<Vector2> {
    let mut point = *target;
    let mut image = loop {
        match distort(&point) {
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
        match shortened(&distort, target, &point, &step, residual.norm()) {
            Some(next) => (point, image) = next,
            None => break,
        }
    }
    ((image.value - target).norm() < 1e-10 * (1.0 + target.norm())).then_some(point)
}

/// The longest of the steps `1, ½, ¼ …` that stays in the domain and comes closer to `target`.
fn shortened(
    distort: impl Fn(&Vector2) -> Option<Distorted>,
    target: &Vector2,
    point: &Vector2,
    step: &Vector2,
    residual: f64,
) -> Option<(Vector2, Distorted)> {
    (0..30).find_map(|halvings| {
        let trial = point - step * 0.5_f64.powi(halvings);
        let image = distort(&trial)?;
        ((image.value - target).norm() < residual).then_some((trial, image))
    })
}
