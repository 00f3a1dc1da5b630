//! The rigid pose of the rest shape, robust against matches on tissue that moved.

use super::RegisterOptions;
use super::correspondence::Match;
use super::error::RegisterError;
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Neighbours, Point2, Point3, Vector2, median, point_at};
use crate::mesh::Mesh;
use crate::sfm::random::Random;
use crate::sfm::resection::{refine_pose, resect};
use crate::solver::Loss;

/// Matches a pose needs.
pub const NEEDED: usize = 4;

/// Matches that are compared with their neighbours at most.
const MOST_SAMPLED: usize = 1000;

/// A rigid pose and how well it explains the matches.
#[derive(Clone, Debug)]
pub struct Posed {
    /// `camera_from_template`.
    pub pose: Isometry,
    /// Reprojection error of every match under the pose, px; infinite behind the camera.
    pub residuals_px: Vec<f64>,
    /// Motion that neighbouring matches share and the pose does not explain, px: root mean product
    /// of the offsets of a match and its nearest neighbour. Noise and wrong matches, which share
    /// nothing with their neighbours, do not count.
    pub shared_motion_px: f64,
    /// The pose is known (see [`CameraMotion`](super::CameraMotion)), not fitted to the matches.
    pub at_rest: bool,
}

impl Posed {
    /// Median reprojection error, px.
    pub fn median_px(&self) -> f64 {
        median_of(&self.residuals_px)
    }

    /// Matches that the pose explains within a distance, px.
    pub(super) fn within(&self, px: f64) -> usize {
        count_within(&self.residuals_px, px)
    }

    /// Reprojection error that one match in ten exceeds, px; of those before the camera.
    pub(super) fn nine_of_ten_px(&self) -> f64 {
        let finite = self.residuals_px.iter().copied().filter(|r| r.is_finite());
        let mut sorted: Vec<f64> = finite.collect();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted.get(sorted.len() * 9 / 10).copied().unwrap_or(0.0)
    }
}

/// Number of reprojection errors below a distance, px.
pub(super) fn count_within(residuals_px: &[f64], px: f64) -> usize {
    residuals_px.iter().filter(|&&r| r < px).count()
}

/// 0 of nothing.
pub(super) fn median_of(values: &[f64]) -> f64 {
    median(&mut values.to_vec()).unwrap_or(0.0)
}

/// Find the rigid pose: sampled three-point poses, then a Geman-McClure scale annealed from
/// `robust_px[0]` down to the level of the residuals themselves (at least `robust_px[1]`), so that
/// the part of the organ that stayed put decides and not the part that was pushed.
///
/// # Errors
/// An option out of its bounds, fewer than four matches, or no pose with four matches in agreement.
#[doc(alias("PnP", "absolute pose", "RANSAC"))]
pub fn pose(
    camera: &CameraModel,
    rest: &Mesh,
    matches: &[Match],
    options: &RegisterOptions,
    seed: u64,
) -> Result<Posed, RegisterError> {
    options.validate()?;
    if matches.len() < NEEDED {
        return Err(RegisterError::TooFewMatches { found: matches.len(), needed: NEEDED });
    }
    let points: Vec<Point3> = matches.iter().map(|m| rest_point(rest, m)).collect();
    let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
    let tolerance = 0.5 * options.robust_px[0];
    let found = resect(camera, &points, &pixels, tolerance, &mut Random::new(seed, 0))
        .ok_or(RegisterError::NoPose { inliers: 0, found: matches.len() })?;
    if found.inliers.len() < NEEDED || 3 * found.inliers.len() < matches.len() {
        return Err(RegisterError::NoPose { inliers: found.inliers.len(), found: matches.len() });
    }
    Ok(settled(camera, &points, &pixels, found.pose, options.robust_px))
}

/// The rigid pose near a known one (a frame before), which nine in ten matches are not far from.
///
/// # Errors
/// An option out of its bounds, fewer than four matches, or no pose there that a third of them
/// agree with.
pub fn pose_near(
    camera: &CameraModel,
    points: &[Point3],
    pixels: &[Point2],
    options: &RegisterOptions,
    start: Isometry,
) -> Result<Posed, RegisterError> {
    options.validate()?;
    let found = points.len();
    if found < NEEDED {
        return Err(RegisterError::TooFewMatches { found, needed: NEEDED });
    }
    let [coarse, fine] = options.robust_px;
    let mut left = residuals(camera, &start, points, pixels);
    left.sort_unstable_by(f64::total_cmp);
    let from = (2.0 * left[left.len() * 9 / 10]).min(coarse).max(fine);
    let posed = settled(camera, points, pixels, start, [from, fine]);
    let inliers = posed.within(0.5 * coarse);
    if inliers < NEEDED || 3 * inliers < found {
        return Err(RegisterError::NoPose { inliers, found });
    }
    Ok(posed)
}

/// Anneal the scale of the loss from the first to the second, px, or to the level of the residuals.
fn settled(
    camera: &CameraModel,
    points: &[Point3],
    pixels: &[Point2],
    start: Isometry,
    [coarse, fine]: [f64; 2],
) -> Posed {
    let (mut pose, mut scale) = (start, coarse);
    loop {
        pose = refine_pose(camera, &pose, points, pixels, Loss::GemanMcClure(scale));
        let floor = fine.max(2.0 * median_of(&residuals(camera, &pose, points, pixels)));
        if scale <= floor {
            break;
        }
        scale = (0.5 * scale).max(floor);
    }
    Posed::at(camera, points, pixels, pose, coarse)
}

impl Posed {
    /// What a pose leaves of the matches; offsets from `most_px` on are wrong matches.
    pub(super) fn at(
        camera: &CameraModel,
        points: &[Point3],
        pixels: &[Point2],
        pose: Isometry,
        most_px: f64,
    ) -> Self {
        let residuals_px = residuals(camera, &pose, points, pixels);
        let offset = |i: usize| -> Option<Vector2> {
            let seen = camera.project(&(pose * points[i]))?;
            (residuals_px[i] < most_px).then_some(pixels[i] - seen.pixel)
        };
        let offsets: Vec<(Point3, Vector2)> =
            (0..points.len()).filter_map(|i| Some((points[i], offset(i)?))).collect();
        let shared_motion_px = shared_motion(&offsets);
        Self { pose, residuals_px, shared_motion_px, at_rest: false }
    }
}

/// Root mean product of every point's offset with its nearest neighbour's; 0 where the mean is
/// negative or no more than noise without any sharing would often give.
fn shared_motion(offsets: &[(Point3, Vector2)]) -> f64 {
    let places = Neighbours::of(offsets.iter().map(|o| o.0.coords.into()).collect());
    let neighbour = |i: usize| places.nearest(i, 1).first().copied();
    // Of very many matches one in several tells as much.
    let products: Vec<f64> = (0..offsets.len())
        .step_by(offsets.len() / MOST_SAMPLED + 1)
        .filter_map(|i| Some(offsets[i].1.dot(&offsets[neighbour(i)?].1)))
        .collect();
    let count = products.len().max(1) as f64;
    let mean = products.iter().sum::<f64>() / count;
    let spread = (products.iter().map(|p| p * p).sum::<f64>() / count).sqrt();
    (mean - 2.0 * spread / count.sqrt()).max(0.0).sqrt()
}

/// The rest position of a match.
pub(crate) fn rest_point(rest: &Mesh, m: &Match) -> Point3 {
    point_at(rest.corners(m.face as usize), m.barycentric)
}

/// Reprojection errors under a pose, px; infinite behind the camera.
pub(super) fn residuals(
    camera: &CameraModel,
    pose: &Isometry,
    points: &[Point3],
    pixels: &[Point2],
) -> Vec<f64> {
    let error = |(p, x): (&Point3, &Point2)| {
        camera.project(&(pose * p)).map_or(f64::INFINITY, |seen| (seen.pixel - x).norm())
    };
    points.iter().zip(pixels).map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offsets(of: impl Fn(usize) -> Vector2) -> Vec<(Point3, Vector2)> {
        (0..100).map(|i| (Point3::new((i % 10) as f64, (i / 10) as f64, 0.0), of(i))).collect()
    }

    #[test]
    fn shared_motion_is_what_neighbours_have_in_common() {
        let noise = |i: usize, size: f64| {
            let angle = (i * i) as f64 * 2.4;
            Vector2::new(size * angle.cos(), size * angle.sin())
        };
        assert_eq!(shared_motion(&offsets(|i| noise(i, 5.0))), 0.0);
        // Half of the points moved by 8 px, all with noise: √(½ · 64) less what chance could give.
        let pushed = |i: usize| if i % 10 < 5 { Vector2::new(8.0, 0.0) } else { Vector2::zeros() };
        let found = shared_motion(&offsets(|i| pushed(i) + noise(i, 1.0)));
        assert!((4.5..5.7).contains(&found), "{found}");
        assert_eq!(shared_motion(&[]), 0.0);
    }

    #[test]
    fn shared_motion_is_less_by_two_standard_errors_of_its_mean() {
        // Neighbours in pairs far from others: three in four products are 4, the others 0.
        let pair = |i: usize| Point3::new(100.0 * (i / 2) as f64, (i % 2) as f64, 0.0);
        let moved = |i: usize| if (i / 2).is_multiple_of(4) { 0.0 } else { 2.0 };
        let offsets: Vec<(Point3, Vector2)> =
            (0..64).map(|i| (pair(i), Vector2::new(0.0, moved(i)))).collect();
        let (mean, spread) = (3.0, (0.75f64 * 16.0).sqrt());
        let expected = (mean - 2.0 * spread / 8.0f64).sqrt();
        assert!((shared_motion(&offsets) - expected).abs() < 1e-12);
    }
}
