//! Relative pose of two views from sightlines (paper §4): five-point samples, the score and the
//! weights of MAGSAC++, non-linear refinement of `(R, t)`.
//!
//! Everything is on unit sightlines, so pinhole and fisheye cameras are treated alike. The
//! residual of a pair is the angle by which the sightlines miss a common epipolar plane,
//! `bᵀEa / √(‖Ea‖² + ‖Eᵀb‖²)`; times the focal length it is about Sampson's distance in px.

use super::five_point::five_point;
use super::magsac::Magsac;
use super::random::{Random, draws_needed};
use crate::geometry::{Isometry, Point3, Vector3};
use crate::solver::{Options, minimize_few};
use nalgebra::{Matrix3, Matrix5, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector5};

/// Relative pose of two views.
#[derive(Clone, Debug)]
pub struct RelativePose {
    /// From the axes of the first camera to those of the second; the translation has length 1.
    pub b_from_a: Isometry,
    /// Indices of the agreeing pairs, ascending.
    pub inliers: Vec<usize>,
}

/// `E = [t]ₓ R` of a relative pose.
#[doc(alias = "epipolar geometry")]
pub(crate) fn essential_matrix(b_from_a: &Isometry) -> Matrix3<f64> {
    b_from_a.translation.vector.cross_matrix() * b_from_a.rotation.to_rotation_matrix().matrix()
}

/// Signed angle (radians, small) by which two sightlines miss a common epipolar plane.
pub(crate) fn epipolar_angle(e: &Matrix3<f64>, a: &Vector3, b: &Vector3) -> f64 {
    let (ea, eb) = (e * a, e.tr_mul(b));
    b.dot(&ea) / (ea.norm_squared() + eb.norm_squared()).sqrt().max(1e-300)
}

/// Find the relative pose of two views by locally optimised random sampling.
///
/// `threshold` is the largest epipolar angle of an inlier, radians. `None` for fewer than
/// `8` pairs, or when no pose with most points in front of both cameras has 8 inliers.
pub(crate) fn relative_pose(
    a: &[Vector3],
    b: &[Vector3],
    threshold: f64,
    random: &mut Random,
) -> Option<RelativePose> {
    relative_pose_under(&Magsac::epipolar(threshold), a, b, threshold, random)
}

/// [`relative_pose`] with the score of a sample given.
fn relative_pose_under(
    loss: &Magsac,
    a: &[Vector3],
    b: &[Vector3],
    threshold: f64,
    random: &mut Random,
) -> Option<RelativePose> {
    /// A bound on time; five of five right are drawn once in 1000 where 25 % are.
    const MAX_DRAWS: usize = 1000;
    const NEEDED: usize = 8;
    if a.len() < NEEDED || a.len() != b.len() {
        return None;
    }
    let mut best: Option<(f64, Isometry)> = None;
    let (mut draws, mut limit) = (0, MAX_DRAWS);
    while draws < limit {
        draws += 1;
        let bound = best.as_ref().map_or(f64::INFINITY, |(cost, _)| *cost);
        let Some(e) = best_of_sample(a, b, loss, bound, random) else { continue };
        let Some(pose) = decompose(&e, a, b, threshold) else { continue };
        let refined = refine(&pose, a, b, loss);
        let cost = score(&essential_matrix(&refined), a, b, loss, bound);
        if cost < bound {
            let found = inliers_of(&refined, a, b, threshold).len();
            limit = draws_needed(found, a.len(), 5).clamp(20, MAX_DRAWS);
            best = Some((cost, refined));
        }
    }
    let pose = refine(&best?.1, a, b, loss);
    let inliers = inliers_of(&pose, a, b, threshold);
    (inliers.len() >= NEEDED).then_some(RelativePose { b_from_a: pose, inliers })
}

/// The cheapest essential matrix of one random sample of five; `None` when none costs less than
/// `bound`.
fn best_of_sample(
    a: &[Vector3],
    b: &[Vector3],
    loss: &Magsac,
    mut bound: f64,
    random: &mut Random,
) -> Option<Matrix3<f64>> {
    let sample = random.sample::<5>(a.len());
    let mut best = None;
    for e in five_point(&sample.map(|i| a[i]), &sample.map(|i| b[i])) {
        let cost = score(&e, a, b, loss, bound);
        if cost < bound {
            (bound, best) = (cost, Some(e));
        }
    }
    best
}

/// Sum of the losses, lower is better; no longer summed up once it has reached `bound`.
fn score(e: &Matrix3<f64>, a: &[Vector3], b: &[Vector3], loss: &Magsac, bound: f64) -> f64 {
    let mut cost = 0.0;
    for (a, b) in a.iter().zip(b) {
        cost += loss.evaluate(epipolar_angle(e, a, b).powi(2)).0;
        if cost >= bound {
            break;
        }
    }
    cost
}

/// Pairs within the threshold and in front of both cameras.
fn inliers_of(pose: &Isometry, a: &[Vector3], b: &[Vector3], threshold: f64) -> Vec<usize> {
    let e = essential_matrix(pose);
    let agrees = |i: &usize| {
        epipolar_angle(&e, &a[*i], &b[*i]).abs() <= threshold && in_front(pose, &a[*i], &b[*i])
    };
    (0..a.len()).filter(agrees).collect()
}

/// Whether the sightlines meet at positive distances (nearly parallel ones count as meeting at
/// infinity).
fn in_front(pose: &Isometry, a: &Vector3, b: &Vector3) -> bool {
    let (ra, t) = (pose.rotation * a, pose.translation.vector);
    let cosine = ra.dot(b);
    let (ta, tb) = (ra.dot(&t), b.dot(&t));
    // Closest points of s·ra + t and u·b, times the positive 1 − cosine².
    let (s, u) = (cosine * tb - ta, tb - cosine * ta);
    cosine > 0.0 && (1.0 - cosine * cosine < 1e-9 || (s > 0.0 && u > 0.0))
}

/// The pose, of the four with this essential matrix, that sees most inliers in front.
fn decompose(e: &Matrix3<f64>, a: &[Vector3], b: &[Vector3], threshold: f64) -> Option<Isometry> {
    let svd = e.svd(true, true);
    let (mut u, mut v_t) = (svd.u?, svd.v_t?);
    if u.determinant() < 0.0 {
        u = -u;
    }
    if v_t.determinant() < 0.0 {
        v_t = -v_t;
    }
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let t: Vector3 = u.column(2).into_owned();
    let mut best: Option<(usize, Isometry)> = None;
    for (w, t) in [(w, t), (w, -t), (w.transpose(), t), (w.transpose(), -t)] {
        let rotation = Rotation3::from_matrix_unchecked(u * w * v_t);
        let pose = Isometry::from_parts(
            Translation3::from(t),
            UnitQuaternion::from_rotation_matrix(&rotation),
        );
        let found = inliers_of(&pose, a, b, threshold).len();
        if best.as_ref().is_none_or(|(n, _)| found > *n) {
            best = Some((found, pose));
        }
    }
    best.map(|(_, pose)| pose)
}

/// Least squares of the weighted epipolar angles over rotation (3) and direction of translation
/// (2). The denominator of the residual is held during a step (a dropped derivative of second order
/// in the residual).
fn refine(pose: &Isometry, a: &[Vector3], b: &[Vector3], loss: &Magsac) -> Isometry {
    let options =
        Options { max_steps: 6, cost_tolerance: 1e-9, fastest: 1.0, ..Options::default() };
    let cost = |pose: &Isometry, bound| score(&essential_matrix(pose), a, b, loss, bound);
    let normal = |pose: &Isometry| normal_equations(pose, a, b, loss);
    minimize_few(pose, &options, cost, normal, |pose, step| {
        let t = pose.translation.vector;
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        let translation = (t + tangent_of(&t) * step.fixed_rows::<2>(3)).normalize();
        Isometry::from_parts(Translation3::from(translation), rotation * pose.rotation)
    })
}

fn normal_equations(
    pose: &Isometry,
    a: &[Vector3],
    b: &[Vector3],
    loss: &Magsac,
) -> (Matrix5<f64>, Vector5<f64>) {
    let e = essential_matrix(pose);
    let t = pose.translation.vector;
    let tangent = tangent_of(&t);
    let (mut hessian, mut gradient) = (Matrix5::zeros(), Vector5::zeros());
    for (a, b) in a.iter().zip(b) {
        let (ea, eb) = (e * a, e.tr_mul(b));
        let scale = 1.0 / (ea.norm_squared() + eb.norm_squared()).sqrt().max(1e-300);
        let residual = b.dot(&ea) * scale;
        let weight = loss.evaluate(residual * residual).1;
        if weight == 0.0 {
            continue;
        }
        let y = pose.rotation * a;
        let d_rotation = y.cross(&b.cross(&t)) * scale;
        let d_translation = tangent.tr_mul(&y.cross(b)) * scale;
        let row = Vector5::new(
            d_rotation.x,
            d_rotation.y,
            d_rotation.z,
            d_translation.x,
            d_translation.y,
        );
        hessian += row * row.transpose() * weight;
        gradient += row * (residual * weight);
    }
    (hessian, gradient)
}

/// Two unit vectors orthogonal to `v` and to each other, as columns.
fn tangent_of(v: &Vector3) -> SMatrix<f64, 3, 2> {
    let helper = if v.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let first = v.cross(&helper).normalize();
    SMatrix::from_columns(&[first, v.cross(&first).normalize()])
}

/// Angle between two sightlines to the same point, degrees: the parallax that fixes its depth.
pub(crate) fn parallax_deg(point: &Point3, centre_a: &Point3, centre_b: &Point3) -> f64 {
    (point - centre_a).angle(&(point - centre_b)).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 120 pairs of sightlines with noise of deviation 1.25e-4 rad; of every `of` pairs the
    /// first `wrong` are outliers.
    fn scene(seed: u64, wrong: usize, of: usize) -> (Isometry, Vec<Vector3>, Vec<Vector3>) {
        let truth =
            Isometry::new(Vector3::new(0.8, -0.1, 0.59).normalize(), [0.05, -0.2, 0.1].into());
        let mut random = Random::new(seed, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        let (mut a, mut b) = (Vec::new(), Vec::new());
        for i in 0..120 {
            let p = Point3::new(4.0 * unit(), 3.0 * unit(), 5.0 + 2.0 * unit());
            // Of three uniform numbers: deviation 0.5.
            let mut normal = || unit() + unit() + unit();
            let noise = Vector3::new(normal(), normal(), 0.0) * 2.5e-4;
            a.push((p.coords.normalize() + noise).normalize());
            let stray = Point3::new(unit(), unit(), 1.0);
            let q = if i % of < wrong { stray } else { truth * p };
            b.push(q.coords.normalize());
        }
        (truth, a, b)
    }

    #[test]
    fn recovers_a_pose_among_outliers() {
        let (truth, a, b) = scene(3, 1, 3);
        let found = relative_pose(&a, &b, 1e-3, &mut Random::new(0, 0)).unwrap();
        assert!(found.inliers.len() >= 80 && found.inliers.len() < 90);
        assert!(found.b_from_a.rotation.angle_to(&truth.rotation) < 3e-3);
        assert!(found.b_from_a.translation.vector.angle(&truth.translation.vector) < 1e-2);
    }

    #[test]
    fn among_many_outliers_a_generous_threshold_does_less_harm_than_under_a_truncated_quadratic() {
        // The angle deviates by 0.9e-4 rad, as one of the two sightlines has noise; 2.6 of these
        // are the right threshold.
        let error = |loss: fn(f64) -> Magsac, factor: f64| {
            let of_seed = |seed: u64| {
                let (truth, a, b) = scene(seed, 3, 5);
                let threshold = 2.3e-4 * factor;
                let random = &mut Random::new(seed, 0);
                let found = relative_pose_under(&loss(threshold), &a, &b, threshold, random);
                let pose = found.unwrap().b_from_a;
                pose.translation.vector.angle(&truth.translation.vector)
            };
            (0..6).map(of_seed).sum::<f64>() / 6.0
        };
        let [right, generous] = [1.0, 8.0].map(|factor| error(Magsac::epipolar, factor));
        assert!(right < 4e-3 && generous < 4e-3, "{right}, {generous}");
        let plain = error(Magsac::truncated, 8.0);
        assert!(generous < 0.7 * plain, "{generous}, truncated {plain}");
    }
}
