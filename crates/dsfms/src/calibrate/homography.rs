//! The homography of two planes (direct linear transformation, Hartley's normalisation).

use crate::geometry::{Point2, Vector2};
use nalgebra::{DMatrix, Matrix3, SMatrix, SymmetricEigen};

/// `H` with `target ~ H source`, of unit Frobenius norm up to sign; `None` for fewer than four
/// pairs or points on one line.
pub(super) fn homography(source: &[Point2], target: &[Point2]) -> Option<Matrix3<f64>> {
    if source.len() < 4 || source.len() != target.len() {
        return None;
    }
    let (from, to) = (normaliser(source)?, normaliser(target)?);
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (s, t) in source.iter().zip(target) {
        let (s, t) = (from * s.to_homogeneous(), to * t.to_homogeneous());
        let mut rows = DMatrix::<f64>::zeros(2, 9);
        for k in 0..3 {
            (rows[(0, k)], rows[(0, 6 + k)]) = (s[k], -t.x * s[k]);
            (rows[(1, 3 + k)], rows[(1, 6 + k)]) = (s[k], -t.y * s[k]);
        }
        normal += rows.transpose() * &rows;
    }
    let eigen = SymmetricEigen::new(normal);
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    // A second null vector means that the points do not fix H.
    if eigen.eigenvalues[order[1]] < 1e-9 * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let h = Matrix3::from_row_slice(h.as_slice());
    let h = to.try_inverse()? * h * from;
    Some(h / h.norm())
}

/// Moves the centroid to the origin and the mean distance from it to √2.
fn normaliser(points: &[Point2]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let centre: Vector2 = points.iter().map(|p| p.coords).sum::<Vector2>() / n;
    let spread = points.iter().map(|p| (p.coords - centre).norm()).sum::<f64>() / n;
    let s = 2.0_f64.sqrt() / spread;
    s.is_finite().then(|| Matrix3::new(s, 0.0, -s * centre.x, 0.0, s, -s * centre.y, 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_a_known_homography() {
        let truth = Matrix3::new(1.2, 0.1, 30.0, -0.2, 0.9, 12.0, 1e-3, -2e-3, 1.0);
        let source: Vec<Point2> =
            (0..12).map(|i| Point2::new(f64::from(i % 4) * 10.0, f64::from(i / 4) * 7.0)).collect();
        let map = |h: &Matrix3<f64>, p: &Point2| Point2::from_homogeneous(h * p.to_homogeneous());
        let target: Vec<Point2> = source.iter().map(|p| map(&truth, p).unwrap()).collect();
        let found = homography(&source, &target).unwrap();
        for (s, t) in source.iter().zip(&target) {
            assert!((map(&found, s).unwrap() - t).norm() < 1e-8);
        }
        assert!(homography(&source[..4], &target[..4]).is_none(), "a line fixes nothing");
    }
}
