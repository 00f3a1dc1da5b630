//! Order statistics and moments that every stage needs.

use super::{Point3, Vector3};
use nalgebra::Matrix3;

/// Mean of points, and the sum of `(p − mean)(p − mean)ᵀ`, squared units of the points; not finite
/// of none.
pub(crate) fn scatter(points: impl Iterator<Item = Point3> + Clone) -> (Point3, Matrix3<f64>) {
    let count = points.clone().count() as f64;
    let centre = Point3::from(points.clone().map(|p| p.coords).sum::<Vector3>() / count);
    let scatter = points.map(|p| (p - centre) * (p - centre).transpose()).sum();
    (centre, scatter)
}

/// The upper median; reorders `values`. `None` of nothing.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    let found =
        (middle < values.len()).then(|| values.select_nth_unstable_by(middle, f64::total_cmp));
    found.map(|(_, &mut median, _)| median)
}

/// Standard deviation of a normal distribution over its median absolute deviation.
pub const SIGMA_OVER_MAD: f64 = 1.4826;

/// Median, and the standard deviation of a normal distribution with the same median absolute
/// deviation; reorders `values`. Both 0 of nothing.
pub fn centre_and_spread(values: &mut [f64]) -> (f64, f64) {
    let centre = median(values).unwrap_or(0.0);
    let mut deviations: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
    (centre, SIGMA_OVER_MAD * median(&mut deviations).unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_by_hand() {
        let points = [[1.0, 2.0, 3.0], [3.0, 2.0, 7.0]].map(Point3::from);
        let (centre, scatter) = scatter(points.into_iter());
        assert_eq!(centre, Point3::new(2.0, 2.0, 5.0));
        assert_eq!(scatter, Matrix3::new(2.0, 0.0, 4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 8.0));
    }

    #[test]
    fn one_outlier_moves_neither() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0]), Some(4.0));
        assert_eq!(median(&mut []), None);
        let (centre, spread) = centre_and_spread(&mut [1.0, 2.0, 3.0, 4.0, 1e9]);
        assert_eq!((centre, spread), (3.0, 1.4826));
    }
}
