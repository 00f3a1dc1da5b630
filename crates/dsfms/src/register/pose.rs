//! The rigid pose of the rest shape, robust against matches on tissue that moved.

use super::{Match, RegisterError, RegisterOptions};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, point_at};
use crate::mesh::Mesh;
use crate::sfm::random::Random;
use crate::sfm::resection::{refine_pose, resect};
use crate::solver::Loss;

/// Matches a pose needs.
pub const NEEDED: usize = 4;

/// A rigid pose and how well it explains the matches.
#[derive(Clone, Debug)]
pub struct Posed {
    /// `camera_from_template`.
    pub pose: Isometry,
    /// Reprojection error of every match under the pose, px; infinite behind the camera.
    pub residuals_px: Vec<f64>,
}

impl Posed {
    /// Median reprojection error, px: the motion that a rigid pose cannot explain.
    pub fn median_px(&self) -> f64 {
        median(&self.residuals_px)
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Find the rigid pose: sampled three-point poses, then a Geman-McClure scale annealed from
/// `robust_px[0]` down to the level of the residuals themselves (at least `robust_px[1]`), so that
/// the part of the organ that stayed put decides and not the part that was pushed.
///
/// # Errors
/// Fewer than four matches, or no pose with four matches in agreement.
pub fn pose(
    camera: &CameraModel,
    rest: &Mesh,
    matches: &[Match],
    options: &RegisterOptions,
    seed: u64,
) -> Result<Posed, RegisterError> {
    if matches.len() < NEEDED {
        return Err(RegisterError::TooFewMatches { found: matches.len(), needed: NEEDED });
    }
    let points: Vec<Point3> = matches.iter().map(|m| rest_point(rest, m)).collect();
    let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
    let [coarse, fine] = options.robust_px;
    let found = resect(camera, &points, &pixels, 0.5 * coarse, &mut Random::new(seed, 0))
        .ok_or(RegisterError::NoPose { inliers: 0, found: matches.len() })?;
    if found.inliers.len() < NEEDED || 3 * found.inliers.len() < matches.len() {
        return Err(RegisterError::NoPose { inliers: found.inliers.len(), found: matches.len() });
    }
    let (mut pose, mut scale) = (found.pose, coarse);
    loop {
        pose = refine_pose(camera, &pose, &points, &pixels, Loss::GemanMcClure(scale));
        let floor = fine.max(2.0 * median(&residuals(camera, &pose, &points, &pixels)));
        if scale <= floor {
            break;
        }
        scale = (0.5 * scale).max(floor);
    }
    let residuals_px = residuals(camera, &pose, &points, &pixels);
    Ok(Posed { pose, residuals_px })
}

/// The rest position of a match.
pub fn rest_point(rest: &Mesh, m: &Match) -> Point3 {
    point_at(rest.corners(m.face as usize), m.barycentric)
}

fn residuals(
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
