//! A camera that stands where it stood in a view of the exploration.
//!
//! Seen alone, a surface that stretches by 3 % is one that lies 3 % nearer: the rigid pose of its matches is off by
//! that much of the distance. Where the camera stands still its pose is known, and all that the matches share is motion of the
//! tissue.

use super::pose::{count_within, median_of, residuals, rest_point};
use super::{CameraMotion, Match, Posed, RegisterError, RegisterOptions};
use crate::camera::CameraModel;
use crate::geometry::{Point2, Point3};
use crate::mesh::Mesh;
use crate::template::TemplateView;

/// Share of the matches that do not move in the image, from which on the camera is taken to stand: a camera that
/// moves moves all of them, and nearly always by more than their noise.
const STILL: f64 = 0.25;
/// Share of those that do not move which lie within half the distance, at least. About the point that a moving
/// camera leaves in place motion grows with distance, and a quarter would; of matches of 0.7 px noise 0.75 do.
const STILL_WITHIN_HALF: f64 = 0.5;

/// The rigid pose that matches gave, or that of the view of the exploration from which the camera is at rest, as
/// [`RegisterOptions::camera_motion`] says. Not in the paper.
///
/// # Errors
/// [`RegisterError::NoView`]: the camera is said to be at rest, and a third of the matches agree with no view.
pub fn posed_from(
    views: &[TemplateView],
    camera: &CameraModel,
    rest: &Mesh,
    matches: &[Match],
    found: Posed,
    options: &RegisterOptions,
) -> Result<Posed, RegisterError> {
    // A camera that moves explains rigid motion as well.
    let moves = match options.camera_motion {
        CameraMotion::Moving => true,
        CameraMotion::Auto => found.shared_motion_px == 0.0,
        CameraMotion::AtRest => false,
    };
    if moves {
        return Ok(found);
    }
    let points: Vec<Point3> = matches.iter().map(|m| rest_point(rest, m)).collect();
    let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
    let [coarse, fine] = options.robust_px;
    let there = |view: &TemplateView| {
        let pose = view.camera_from_template;
        (pose, residuals(camera, &pose, &points, &pixels))
    };
    let nearest =
        views.iter().map(there).min_by(|a, b| median_of(&a.1).total_cmp(&median_of(&b.1)));
    let (all, left) = (matches.len(), nearest.as_ref().map_or(&[][..], |n| &n.1));
    let within = |px: f64| count_within(left, px);
    let agree = within(0.5 * coarse);
    let stands = match options.camera_motion {
        CameraMotion::AtRest if 3 * agree >= all => true,
        CameraMotion::AtRest => {
            return Err(RegisterError::NoView { agree, found: all, views: views.len() });
        }
        // Many matches do not move.
        _ => {
            let [near, nearer] = [0.5, 0.25].map(|share| within(share * fine) as f64);
            near >= STILL * all as f64 && nearer >= STILL_WITHIN_HALF * near
        }
    };
    let pose = nearest.filter(|_| stands).map(|n| n.0);
    Ok(pose.map_or(found, |pose| Posed {
        at_rest: true,
        ..Posed::at(camera, &points, &pixels, pose, coarse)
    }))
}
