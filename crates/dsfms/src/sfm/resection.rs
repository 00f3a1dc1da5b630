//! Resection (paper §4): the pose of a calibrated camera from known points and their pixels.
//!
//! Three-point samples (Grunert's equations as in Haralick et al. 1994), the score and the weights
//! of MAGSAC++ on pixel errors, and non-linear refinement, all in double precision.

use super::magsac::Magsac;
use super::random::{Random, draws_needed};
use crate::camera::Camera;
use crate::geometry::{Isometry, Point2, Point3, Vector3, align_rigid};
use crate::solver::{Loss, Options, minimize_few};
use nalgebra::{Matrix2x6, Matrix4, Matrix6, Schur, UnitQuaternion, Vector6};

/// A pose and the matches that agree with it.
#[derive(Clone, Debug)]
pub struct Resection {
    /// `camera_from_world`.
    pub pose: Isometry,
    /// Indices of the agreeing matches, ascending.
    pub inliers: Vec<usize>,
}

/// Find the pose of a camera from point–pixel matches with outliers.
///
/// `threshold_px`: largest error of an inlier. `None` for fewer than 4 matches or when no pose has
/// 4 inliers. The result depends on nothing but the arguments.
#[doc(alias("PnP", "P3P", "absolute pose", "RANSAC"))]
pub fn resect(
    camera: &dyn Camera,
    points: &[Point3],
    pixels: &[Point2],
    threshold_px: f64,
    random: &mut Random,
) -> Option<Resection> {
    resect_under(&Magsac::reprojection(threshold_px), camera, points, pixels, threshold_px, random)
}

/// [`resect`] with the score of a sample given.
fn resect_under(
    loss: &Magsac,
    camera: &dyn Camera,
    points: &[Point3],
    pixels: &[Point2],
    threshold_px: f64,
    random: &mut Random,
) -> Option<Resection> {
    /// A bound on time; three of three right are drawn once in 2000 where 8 % are.
    const MAX_DRAWS: usize = 2000;
    const NEEDED: usize = 4;
    let rays: Vec<Option<Vector3>> = pixels.iter().map(|p| camera.unproject(p)).collect();
    let usable: Vec<usize> =
        (0..points.len().min(pixels.len())).filter(|&i| rays[i].is_some()).collect();
    if usable.len() < NEEDED {
        return None;
    }
    let robust = |s: f64| loss.evaluate(s);
    let refine = |pose: &Isometry| refine_pose_under(camera, pose, points, pixels, &robust);
    let score = |pose: &Isometry, bound: f64| score(camera, pose, points, pixels, &robust, bound);
    let mut best: Option<(f64, Isometry)> = None;
    let (mut draws, mut limit) = (0, MAX_DRAWS);
    while draws < limit {
        draws += 1;
        let sample = random.sample::<3>(usable.len()).map(|i| usable[i]);
        let Some(sightlines) = all_of(sample.map(|i| rays[i])) else { continue };
        for pose in three_point(&sample.map(|i| points[i]), &sightlines) {
            let bound = best.as_ref().map_or(f64::INFINITY, |(cost, _)| *cost);
            if score(&pose, bound) >= bound {
                continue;
            }
            // Never worse than its start.
            let pose = refine(&pose);
            let found = inliers_of(camera, &pose, points, pixels, threshold_px).len();
            limit = draws_needed(found, usable.len(), 3).clamp(20, MAX_DRAWS);
            best = Some((score(&pose, f64::INFINITY), pose));
        }
    }
    let pose = refine(&best?.1);
    let inliers = inliers_of(camera, &pose, points, pixels, threshold_px);
    (inliers.len() >= NEEDED).then_some(Resection { pose, inliers })
}

fn all_of(rays: [Option<Vector3>; 3]) -> Option<[Vector3; 3]> {
    Some([rays[0]?, rays[1]?, rays[2]?])
}

/// Reprojection error, px; infinite where the camera does not see the point.
pub(crate) fn error_px(
    camera: &dyn Camera,
    pose: &Isometry,
    point: &Point3,
    pixel: &Point2,
) -> f64 {
    camera.project(&(pose * point)).map_or(f64::INFINITY, |p| (p.pixel - pixel).norm())
}

/// Sum of the losses, lower is better; no longer summed up once it has reached `bound`.
fn score(
    camera: &dyn Camera,
    pose: &Isometry,
    points: &[Point3],
    pixels: &[Point2],
    robust: Robust,
    bound: f64,
) -> f64 {
    let mut cost = 0.0;
    for (p, x) in points.iter().zip(pixels) {
        cost += robust(error_px(camera, pose, p, x).powi(2)).0;
        if cost >= bound {
            break;
        }
    }
    cost
}

fn inliers_of(
    camera: &dyn Camera,
    pose: &Isometry,
    points: &[Point3],
    pixels: &[Point2],
    threshold_px: f64,
) -> Vec<usize> {
    let agrees = |i: &usize| error_px(camera, pose, &points[*i], &pixels[*i]) <= threshold_px;
    (0..points.len().min(pixels.len())).filter(agrees).collect()
}

/// Loss `ρ(s)` of a squared error (px²) and its derivative.
type Robust<'a> = &'a dyn Fn(f64) -> (f64, f64);

/// Levenberg–Marquardt on the six parameters of a pose over reprojection errors (px) under a
/// robust loss; never worse than the start. A step that brings a point behind the camera fails,
/// unless the loss is bounded.
pub fn refine_pose(
    camera: &dyn Camera,
    start: &Isometry,
    points: &[Point3],
    pixels: &[Point2],
    loss: Loss,
) -> Isometry {
    refine_pose_under(camera, start, points, pixels, &|s| loss.evaluate(s))
}

fn refine_pose_under(
    camera: &dyn Camera,
    start: &Isometry,
    points: &[Point3],
    pixels: &[Point2],
    robust: Robust,
) -> Isometry {
    let cost = |pose: &Isometry, bound: f64| score(camera, pose, points, pixels, robust, bound);
    let normal = |pose: &Isometry| pose_normal_equations(camera, pose, points, pixels, robust);
    // A pose of a sample of three is farther off than a linearisation reaches.
    let options = Options {
        max_steps: 20,
        cost_tolerance: 1e-8,
        initial_damping: 1e-4,
        fastest: 1.0,
        ..Options::default()
    };
    minimize_few(start, &options, cost, normal, retract)
}

fn pose_normal_equations(
    camera: &dyn Camera,
    pose: &Isometry,
    points: &[Point3],
    pixels: &[Point2],
    robust: Robust,
) -> (Matrix6<f64>, Vector6<f64>) {
    let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    for (point, pixel) in points.iter().zip(pixels) {
        let local = pose * point;
        let Some(seen) = camera.project(&local) else { continue };
        let residual = seen.pixel - pixel;
        let weight = robust(residual.norm_squared()).1;
        if weight == 0.0 {
            continue;
        }
        let jacobian = pose_jacobian(&seen.jacobian, &local);
        hessian += jacobian.transpose() * jacobian * weight;
        gradient += jacobian.transpose() * residual * weight;
    }
    (hessian, gradient)
}

/// `∂pixel/∂(ω, τ)` for the motion `p ↦ exp(ω)p + τ` of a point in camera axes.
pub(super) fn pose_jacobian(
    pixel_by_point: &nalgebra::Matrix2x3<f64>,
    local: &Point3,
) -> Matrix2x6<f64> {
    let mut jacobian = Matrix2x6::zeros();
    let rotation = -pixel_by_point * local.coords.cross_matrix();
    jacobian.fixed_columns_mut::<3>(0).copy_from(&rotation);
    jacobian.fixed_columns_mut::<3>(3).copy_from(pixel_by_point);
    jacobian
}

/// `exp(ω, τ) · pose`: rotation `exp(ω)` and translation `τ` in camera axes.
pub(super) fn retract(pose: &Isometry, step: &Vector6<f64>) -> Isometry {
    let rotation = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
    let translation = rotation * pose.translation.vector + step.fixed_rows::<3>(3);
    let mut rotation = rotation * pose.rotation;
    rotation.renormalize();
    Isometry::from_parts(translation.into(), rotation)
}

/// Poses that see three points along three unit sightlines: at most four, none when the points
/// are collinear.
pub(crate) fn three_point(points: &[Point3; 3], rays: &[Vector3; 3]) -> Vec<Isometry> {
    let squared = |i: usize, j: usize| (points[i] - points[j]).norm_squared();
    let (a2, b2, c2) = (squared(1, 2), squared(0, 2), squared(0, 1));
    if a2.min(b2).min(c2) <= 1e-20 * a2.max(b2).max(c2) {
        return Vec::new();
    }
    let (ca, cb, cc) = (rays[1].dot(&rays[2]), rays[0].dot(&rays[2]), rays[0].dot(&rays[1]));
    let d = (a2 - c2) / b2;
    let s = (a2 + c2) / b2;
    let (p, q) = (c2 / b2, a2 / b2);
    let quartic = [
        (d - 1.0).powi(2) - 4.0 * p * ca * ca,
        4.0 * (d * (1.0 - d) * cb - (1.0 - s) * ca * cc + 2.0 * p * ca * ca * cb),
        2.0 * (d * d - 1.0 + 2.0 * d * d * cb * cb + 2.0 * (1.0 - p) * ca * ca
            - 4.0 * s * ca * cb * cc
            + 2.0 * (1.0 - q) * cc * cc),
        4.0 * (-d * (1.0 + d) * cb + 2.0 * q * cc * cc * cb - (1.0 - s) * ca * cc),
        (1.0 + d).powi(2) - 4.0 * q * cc * cc,
    ];
    let pose = |v: f64| {
        let u = ((d - 1.0) * v * v - 2.0 * d * cb * v + 1.0 + d) / (2.0 * (cc - v * ca));
        let s1 = (b2 / (1.0 + v * v - 2.0 * v * cb)).sqrt();
        let local = [s1, u * s1, v * s1];
        let valid = local.iter().all(|s| s.is_finite() && *s > 0.0);
        let seen: [Point3; 3] = std::array::from_fn(|i| Point3::from(rays[i] * local[i]));
        if valid { align_rigid(points, &seen) } else { None }
    };
    positive_roots(&quartic).into_iter().filter_map(pose).collect()
}

/// Positive real roots of `c₀x⁴ + … + c₄`, as eigenvalues of the companion matrix, each polished
/// by two Newton steps.
fn positive_roots(c: &[f64; 5]) -> Vec<f64> {
    let largest = c.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if !largest.is_finite() || c[0].abs() <= 1e-12 * largest {
        return Vec::new();
    }
    let mut companion = Matrix4::zeros();
    for i in 0..4 {
        companion[(0, i)] = -c[i + 1] / c[0];
    }
    for i in 1..4 {
        companion[(i, i - 1)] = 1.0;
    }
    let Some(schur) = Schur::try_new(companion, f64::EPSILON, 200) else { return Vec::new() };
    let value = |x: f64| (((c[0] * x + c[1]) * x + c[2]) * x + c[3]) * x + c[4];
    let slope = |x: f64| ((4.0 * c[0] * x + 3.0 * c[1]) * x + 2.0 * c[2]) * x + c[3];
    let polish = |x: f64| {
        let step = value(x) / slope(x);
        if step.is_finite() { x - step } else { x }
    };
    let real = schur.complex_eigenvalues();
    real.iter()
        .filter(|z| z.re > 0.0 && z.im.abs() <= 1e-4 * z.re.max(1e-3))
        .map(|z| polish(polish(z.re)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;

    fn scene() -> (CameraModel, Isometry, Vec<Point3>, Vec<Point2>) {
        let camera = CameraModel::pinhole([640, 480], [500.0, 510.0], [318.0, 241.0]);
        let pose = Isometry::new(Vector3::new(3.0, -1.0, 60.0), Vector3::new(0.2, -0.4, 0.1));
        let mut random = Random::new(9, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        let points: Vec<_> =
            (0..60).map(|_| Point3::new(30.0 * unit(), 30.0 * unit(), 20.0 * unit())).collect();
        let pixels = points.iter().map(|p| camera.project(&(pose * p)).unwrap().pixel).collect();
        (camera, pose, points, pixels)
    }

    #[test]
    fn three_points_give_the_pose_among_at_most_four() {
        let (camera, pose, points, pixels) = scene();
        for k in 0..19 {
            let rays = [3 * k, 3 * k + 1, 3 * k + 2].map(|i| camera.unproject(&pixels[i]).unwrap());
            let found = three_point(&[points[3 * k], points[3 * k + 1], points[3 * k + 2]], &rays);
            let near = |p: &Isometry| (p.inverse() * pose).rotation.angle() < 1e-6;
            assert!(found.len() <= 4 && found.iter().any(near), "sample {k}");
        }
    }

    #[test]
    fn half_outliers_do_not_move_the_pose() {
        let (camera, pose, points, mut pixels) = scene();
        for i in (0..60).step_by(2) {
            pixels[i] = Point2::new(11.0 * i as f64 % 640.0, 37.0 * i as f64 % 480.0);
        }
        let found = resect(&camera, &points, &pixels, 2.0, &mut Random::new(0, 0)).unwrap();
        assert!(found.inliers.len() >= 30 && found.inliers.len() <= 33);
        assert!((found.pose.inverse() * pose).rotation.angle() < 1e-4);
        assert!(resect(&camera, &points[..3], &pixels[..3], 2.0, &mut Random::new(0, 0)).is_none());
    }

    #[test]
    fn a_point_behind_the_camera_hinders_no_bounded_loss() {
        let (camera, pose, mut points, mut pixels) = scene();
        points.push(pose.inverse() * Point3::new(0.0, 0.0, -5.0));
        pixels.push(Point2::new(100.0, 100.0));
        let start = retract(&pose, &Vector6::new(0.02, -0.01, 0.01, 0.3, -0.2, 0.5));
        let found = refine_pose(&camera, &start, &points, &pixels, Loss::GemanMcClure(20.0));
        assert!((found.inverse() * pose).rotation.angle() < 1e-6);
        // Under least squares it is infinitely far off, wherever the pose is.
        assert_eq!(refine_pose(&camera, &start, &points, &pixels, Loss::Squared), start);
    }

    #[test]
    fn among_many_outliers_a_generous_threshold_does_less_harm_than_under_a_truncated_quadratic() {
        let (camera, truth, points, exact) = scene();
        // Of three uniform numbers: a deviation of 0.5 px, of which 3 are the right threshold.
        let error = |loss: fn(f64) -> Magsac, threshold: f64| {
            let of_seed = |seed: u64| {
                let mut random = Random::new(seed, 1);
                let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
                let mut normal = || unit() + unit() + unit();
                let mut pixel = |(i, p): (usize, &Point2)| match i % 5 {
                    0..3 => Point2::new(320.0 + 213.0 * normal(), 240.0 + 160.0 * normal()),
                    _ => p + nalgebra::Vector2::new(normal(), normal()),
                };
                let pixels: Vec<_> = exact.iter().enumerate().map(&mut pixel).collect();
                let (loss, random) = (loss(threshold), &mut Random::new(seed, 0));
                let found = resect_under(&loss, &camera, &points, &pixels, threshold, random);
                (found.unwrap().pose * truth.inverse()).rotation.angle()
            };
            (0..12).map(of_seed).sum::<f64>() / 12.0
        };
        let [right, generous] = [1.5, 12.0].map(|threshold| error(Magsac::reprojection, threshold));
        assert!(right < 1e-2 && generous < 1e-2, "{right}, {generous}");
        let plain = error(Magsac::truncated, 12.0);
        assert!(generous < 0.8 * plain, "{generous}, truncated {plain}");
    }

    #[test]
    fn pose_jacobian_matches_central_differences() {
        let (camera, pose, points, _) = scene();
        let local = pose * points[0];
        let analytic = pose_jacobian(&camera.project(&local).unwrap().jacobian, &local);
        for k in 0..6 {
            let at = |h: f64| {
                let mut step = Vector6::zeros();
                step[k] = h;
                camera.project(&(retract(&pose, &step) * points[0])).unwrap().pixel
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((numeric - analytic.column(k)).norm() < 1e-4, "parameter {k}");
        }
    }
}
