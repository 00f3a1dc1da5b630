//! A point from its sightlines in several views (paper §4), in double precision.

use crate::camera::Camera;
use crate::geometry::{Isometry, Point2, Point3, Vector3};
use crate::solver::{Options, minimize_few};
use nalgebra::{Matrix3, Vector3 as V3};

/// One sighting of a point: where from, in which direction, at which pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sighting {
    /// `camera_from_world` of the view.
    pub pose: Isometry,
    /// Unit sightline in camera axes.
    pub ray: Vector3,
    /// Pixel.
    pub pixel: Point2,
}

impl Sighting {
    /// Centre of the camera in world axes.
    pub fn centre(&self) -> Point3 {
        centre_of(&self.pose)
    }

    /// Distance in px between the sighting and the projection of `point`; infinite behind.
    pub fn error_px(&self, camera: &dyn Camera, point: &Point3) -> f64 {
        let seen = camera.project(&(self.pose * point));
        seen.map_or(f64::INFINITY, |p| (p.pixel - self.pixel).norm())
    }
}

/// Centre of a camera in world axes.
pub(crate) fn centre_of(pose: &Isometry) -> Point3 {
    pose.inverse_transform_point(&Point3::origin())
}

/// Limits of an acceptable point.
#[derive(Clone, Copy, Debug)]
pub struct TriangulationLimits {
    /// Largest distance between a sighting and the projection, px.
    pub max_error_px: f64,
    /// Smallest largest angle between two sightlines, degrees.
    pub min_parallax_deg: f64,
}

/// The point nearest to all sightlines, `argmin Σ‖(I − ddᵀ)(X − C)‖²`; `None` when parallel.
pub(crate) fn nearest_to_rays(sightings: &[Sighting]) -> Option<Point3> {
    let (mut normal, mut right) = (Matrix3::zeros(), V3::zeros());
    for s in sightings {
        let direction = s.pose.rotation.inverse() * s.ray;
        let projector = Matrix3::identity() - direction * direction.transpose();
        normal += projector;
        right += projector * s.centre().coords;
    }
    let point = normal.cholesky()?.solve(&right);
    point.iter().all(|v| v.is_finite()).then(|| Point3::from(point))
}

/// Least squares of the reprojection errors from a first point; the best point met.
pub(crate) fn refine_point(camera: &dyn Camera, sightings: &[Sighting], start: Point3) -> Point3 {
    let options = Options { max_steps: 5, fastest: 1.0, ..Options::default() };
    let cost = |p: &Point3, _| sightings.iter().map(|s| s.error_px(camera, p).powi(2)).sum::<f64>();
    let normal = |point: &Point3| {
        let (mut normal, mut gradient) = (Matrix3::zeros(), V3::zeros());
        for s in sightings {
            // A point with a cost has a projection everywhere.
            let Some(seen) = camera.project(&(s.pose * point)) else { continue };
            let jacobian = seen.jacobian * s.pose.rotation.to_rotation_matrix().matrix();
            normal += jacobian.transpose() * jacobian;
            gradient += jacobian.transpose() * (seen.pixel - s.pixel);
        }
        (normal, gradient)
    };
    minimize_few(&start, &options, cost, normal, |point, step| point + step)
}

/// Largest angle between two sightlines of a point, degrees.
pub(crate) fn largest_parallax_deg(point: &Point3, centres: &[Point3]) -> f64 {
    let directions: Vec<Vector3> = centres.iter().map(|c| (point - c).normalize()).collect();
    let mut smallest_cosine: f64 = 1.0;
    for (i, a) in directions.iter().enumerate() {
        for b in &directions[i + 1..] {
            smallest_cosine = smallest_cosine.min(a.dot(b));
        }
    }
    smallest_cosine.clamp(-1.0, 1.0).acos().to_degrees()
}

/// The point on which most sightings agree, and which do; `None` when fewer than two do or their
/// parallax is too small.
///
/// Every pair of sightings (at most `MAX_PAIRS`, evenly spread) proposes a point; ties go to the
/// lower error. The winner is refined on its sightings.
pub(crate) fn triangulate(
    camera: &dyn Camera,
    sightings: &[Sighting],
    limits: &TriangulationLimits,
) -> Option<(Point3, Vec<bool>)> {
    let agreeing = |point: &Point3| -> Vec<bool> {
        sightings.iter().map(|s| s.error_px(camera, point) <= limits.max_error_px).collect()
    };
    let (_, _, point) = pairs(sightings.len())
        .filter_map(|(i, j)| nearest_to_rays(&[sightings[i], sightings[j]]))
        .map(|point| {
            let bound = limits.max_error_px;
            let errors = sightings.iter().map(|s| s.error_px(camera, &point).min(bound));
            let count = agreeing(&point).iter().filter(|&&v| v).count();
            (count, errors.sum::<f64>(), point)
        })
        .filter(|c| c.0 >= 2)
        .min_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)))?;
    let select = |used: &[bool]| -> Vec<Sighting> {
        sightings.iter().zip(used).filter(|(_, u)| **u).map(|(s, _)| *s).collect()
    };
    let point = refine_point(camera, &select(&agreeing(&point)), point);
    let used = agreeing(&point);
    let centres: Vec<Point3> = select(&used).iter().map(Sighting::centre).collect();
    let wide =
        centres.len() >= 2 && largest_parallax_deg(&point, &centres) >= limits.min_parallax_deg;
    wide.then_some((point, used))
}

/// All pairs of `n` things, thinned evenly to at most `MAX_PAIRS`.
fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    /// All pairs of nine sightings: more cost time, not points.
    const MAX_PAIRS: usize = 36;
    let total = n * n.saturating_sub(1) / 2;
    let step = total.div_ceil(MAX_PAIRS).max(1);
    (0..n).flat_map(move |i| (i + 1..n).map(move |j| (i, j))).step_by(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;

    fn camera() -> CameraModel {
        CameraModel::pinhole([640, 480], [500.0; 2], [320.0, 240.0])
    }

    fn sighting(pose: Isometry, point: &Point3, shift: f64) -> Sighting {
        let mut pixel = camera().project(&(pose * point)).unwrap().pixel;
        pixel.x += shift;
        Sighting { pose, ray: camera().unproject(&pixel).unwrap(), pixel }
    }

    #[test]
    fn one_bad_sighting_is_left_out() {
        let point = Point3::new(1.0, -2.0, 50.0);
        let shifts = [0.0, 0.0, 30.0, 0.0];
        let sightings: Vec<_> = (0..4)
            .map(|i| {
                let pose = Isometry::translation(-2.0 * i as f64, 0.3 * i as f64, 0.0);
                sighting(pose, &point, shifts[i])
            })
            .collect();
        let limits = TriangulationLimits { max_error_px: 2.0, min_parallax_deg: 1.0 };
        let (found, used) = triangulate(&camera(), &sightings, &limits).unwrap();
        assert!((found - point).norm() < 1e-6);
        assert_eq!(used, [true, true, false, true]);
    }

    #[test]
    fn too_little_parallax_gives_no_point() {
        let point = Point3::new(0.0, 0.0, 100.0);
        let views = [0.0, 0.5].map(|x| sighting(Isometry::translation(x, 0.0, 0.0), &point, 0.0));
        let limits = TriangulationLimits { max_error_px: 2.0, min_parallax_deg: 1.0 };
        assert!(triangulate(&camera(), &views, &limits).is_none());
    }
}
