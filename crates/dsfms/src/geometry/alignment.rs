//! Least-squares rigid and similarity alignment of corresponding points (Umeyama 1991).

use super::{Isometry, Loss, Point3, Similarity, Vector3, median};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};

/// The rigid motion `T` that minimises `Σ‖T·sourceᵢ − targetᵢ‖²`.
///
/// `None` for fewer than three pairs, slices of different lengths, or collinear points.
#[doc(alias("Procrustes", "Kabsch"))]
pub fn align_rigid(source: &[Point3], target: &[Point3]) -> Option<Isometry> {
    let weights = vec![1.0; source.len()];
    Some(umeyama(source, target, &weights, false)?.isometry)
}

/// The rigid motion that explains most of the pairs: iteratively reweighted with a Geman-McClure
/// scale of twice the median distance, so that what moved otherwise does
/// not pull as long as it is no more than about a quarter of the pairs.
///
/// `None` as for [`align_rigid`].
pub fn align_rigid_robust(source: &[Point3], target: &[Point3]) -> Option<Isometry> {
    /// A bound on time.
    const ROUNDS: usize = 20;
    const SETTLED: f64 = 1e-6;
    let mut motion = align_rigid(source, target)?;
    let mut before = f64::INFINITY;
    for _ in 0..ROUNDS {
        let pairs = source.iter().zip(target);
        let distances: Vec<f64> = pairs.map(|(s, t)| (motion * s - t).norm()).collect();
        let scale = (2.0 * median(&mut distances.clone())?).max(1e-12);
        if (scale - before).abs() <= SETTLED * scale {
            break;
        }
        before = scale;
        let weight = |d: &f64| Loss::GemanMcClure(1.0).evaluate((d / scale).powi(2)).1;
        let weights: Vec<f64> = distances.iter().map(weight).collect();
        motion = umeyama(source, target, &weights, false)?.isometry;
    }
    Some(motion)
}

/// [`align_rigid_robust`] of every so many-th pair, so that there are at most 2,000: a bound on
/// time for a video. `source` and `target` in the same length unit and order.
///
/// `None` as for [`align_rigid`].
pub fn align_rigid_few(source: &[Point3], target: &[Point3]) -> Option<Isometry> {
    /// Other values are not measured; those of all of 10,000 are in `docs/performance.md`.
    const ENOUGH: usize = 2000;
    let every = source.len().div_ceil(ENOUGH).max(1);
    let few =
        |points: &[Point3]| -> Vec<Point3> { points.iter().step_by(every).copied().collect() };
    align_rigid_robust(&few(source), &few(target))
}

/// The similarity `S` that minimises `Σ‖S·sourceᵢ − targetᵢ‖²`; `None` as for [`align_rigid`].
#[doc(alias("Umeyama", "Procrustes"))]
pub fn align_similarity(source: &[Point3], target: &[Point3]) -> Option<Similarity> {
    umeyama(source, target, &vec![1.0; source.len()], true)
}

fn centroid(points: &[Point3], weights: &[f64]) -> Vector3 {
    let sum: Vector3 = points.iter().zip(weights).map(|(p, &w)| p.coords * w).sum();
    sum / weights.iter().sum::<f64>()
}

fn umeyama(
    source: &[Point3],
    target: &[Point3],
    weights: &[f64],
    with_scale: bool,
) -> Option<Similarity> {
    if source.len() < 3 || source.len() != target.len() {
        return None;
    }
    let (cs, ct) = (centroid(source, weights), centroid(target, weights));
    let (mut covariance, mut spread) = (Matrix3::zeros(), 0.0);
    for ((s, t), &w) in source.iter().zip(target).zip(weights) {
        let (ds, dt) = (s.coords - cs, t.coords - ct);
        covariance += dt * ds.transpose() * w;
        spread += w * ds.norm_squared();
    }
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    if svd.singular_values[1] <= 1e-14 * svd.singular_values[0] {
        return None;
    }
    let mut sign = Vector3::repeat(1.0);
    if (u * v_t).determinant() < 0.0 {
        sign.z = -1.0;
    }
    let rotation = Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&sign) * v_t);
    let scale = if with_scale { svd.singular_values.dot(&sign) / spread } else { 1.0 };
    let translation = ct - rotation * cs * scale;
    let isometry = Isometry::from_parts(
        Translation3::from(translation),
        UnitQuaternion::from_rotation_matrix(&rotation),
    );
    (scale > 0.0).then(|| Similarity::from_isometry(isometry, scale))
}

/// The shortest rotation of one direction to another, `I + [v]ₓ + [v]ₓ² / (1 + c)` with `v = a × b`
/// and `c = a · b` of unit length: nalgebra's `Rotation3::rotation_between` takes the arc cosine of
/// a `c` that is above 1 by its last bit, and is then not a number. `None` where the directions are
/// opposite, or one of them is none.
pub(crate) fn turn_between(a: &Vector3, b: &Vector3) -> Option<Matrix3<f64>> {
    let (a, b) = (a.try_normalize(0.0)?, b.try_normalize(0.0)?);
    let cross = a.cross(&b).cross_matrix();
    let whole = 1.0 + a.dot(&b);
    (whole > f64::EPSILON).then(|| Matrix3::identity() + cross + cross * cross / whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_a_known_similarity() {
        let source: Vec<_> = [[0., 0., 0.], [1., 0., 0.], [0., 2., 0.], [0.3, 0.1, 3.]]
            .iter()
            .map(|p| Point3::new(p[0], p[1], p[2]))
            .collect();
        let truth = Similarity::new(Vector3::new(1., -2., 3.), Vector3::new(0.3, -0.2, 0.9), 2.5);
        let target: Vec<_> = source.iter().map(|p| truth * p).collect();
        let found = align_similarity(&source, &target).unwrap();
        for (s, t) in source.iter().zip(&target) {
            assert!((found * s - t).norm() < 1e-12);
        }
        assert!((found.scaling() - 2.5).abs() < 1e-12);
    }

    #[test]
    fn robust_alignment_follows_the_majority() {
        let source: Vec<_> = (0..30)
            .map(|i| Point3::new((i % 5) as f64, (i / 5) as f64, (0.7 * i as f64).sin()))
            .collect();
        let truth = Isometry::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.2, 0.1, -0.3));
        let pushed = |i: usize| if i < 8 { Vector3::new(0.0, 0.0, 4.0) } else { Vector3::zeros() };
        let target: Vec<_> =
            source.iter().enumerate().map(|(i, p)| truth * p + pushed(i)).collect();
        let found = align_rigid_robust(&source, &target).unwrap();
        let off = (found * source[29] - target[29]).norm();
        assert!(off < 1e-6, "{off}");
        assert!((align_rigid(&source, &target).unwrap() * source[29] - target[29]).norm() > 0.5);
    }

    #[test]
    fn few_of_many_tell_the_motion_of_the_majority() {
        let source: Vec<_> = (0..5000)
            .map(|i| Point3::new((i % 71) as f64, (i / 71) as f64, (0.7 * i as f64).sin()))
            .collect();
        let truth = Isometry::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.2, 0.1, -0.3));
        let pushed =
            |i: usize| if i < 1000 { Vector3::new(0.0, 0.0, 9.0) } else { Vector3::zeros() };
        let target: Vec<_> =
            source.iter().enumerate().map(|(i, p)| truth * p + pushed(i)).collect();
        let found = align_rigid_few(&source, &target).unwrap();
        let off = |i: usize| (found * source[i] - target[i]).norm();
        assert!(off(1001) < 1e-6 && off(4999) < 1e-6, "{} {}", off(1001), off(4999));
        assert_eq!(
            align_rigid_few(&source[..1500], &target[..1500]),
            align_rigid_robust(&source[..1500], &target[..1500])
        );
    }

    #[test]
    fn refuses_collinear_points() {
        let line: Vec<_> = (0..5).map(|i| Point3::new(i as f64, 0.0, 0.0)).collect();
        assert!(align_rigid(&line, &line).is_none());
    }

    #[test]
    fn a_turn_between_directions_is_a_rotation_also_where_they_hardly_differ() {
        let mut not_numbers = 0;
        for i in 0..2000 {
            let t = f64::from(i);
            let a = Vector3::new(t.sin(), (1.7 * t).cos(), (0.3 * t).sin() + 0.2);
            let off = Vector3::new((2.3 * t).cos(), t.cos(), (0.9 * t).sin());
            for size in [0.0, 1e-16, 1e-15, 1e-9, 1e-3, 1.0] {
                let b = a * 3.0 + off * size;
                let turn = turn_between(&a, &b).unwrap();
                assert!((turn * a.normalize() - b.normalize()).norm() < 1e-14);
                assert!((turn.transpose() * turn - Matrix3::identity()).norm() < 1e-13);
                let theirs = nalgebra::Rotation3::rotation_between(&a, &b).unwrap();
                not_numbers += usize::from(theirs.matrix().iter().any(|x| x.is_nan()));
            }
        }
        assert!(not_numbers > 0, "nalgebra's is a number everywhere: use it");
        let x = Vector3::x();
        assert_eq!(turn_between(&x, &-x), None);
        assert_eq!(turn_between(&x, &Vector3::zeros()), None);
    }
}
