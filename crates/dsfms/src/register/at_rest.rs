//! A camera that stands where it stood in a view of the exploration.
//!
//! Seen alone, a surface that stretches by 3 % is one that lies 3 % nearer: the rigid pose of its matches is off by
//! that much of the distance. Where the camera stands still its pose is known, and all that the matches share is motion of the
//! tissue.

use super::pose::rest_point;
use super::{CameraMotion, Match, Posed, RegisterError, RegisterOptions};
use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3};
use crate::mesh::Mesh;

/// Share of the matches that do not move in the image, from which on the camera is taken to stand: a camera that
/// moves moves all of them, and nearly always by more than their noise.
const STILL: f64 = 0.25;

/// The rigid pose that matches gave, or that of the view from which the camera is at rest, as
/// [`RegisterOptions::camera_motion`] says; `views`: `camera_from_template`.
///
/// # Errors
/// [`RegisterError::NoView`]: the camera is said to be at rest, and a third of the matches agree with no view.
pub fn posed_from(
    views: &[Isometry],
    camera: &CameraModel,
    rest: &Mesh,
    matches: &[Match],
    found: Posed,
    options: &RegisterOptions,
) -> Result<Posed, RegisterError> {
    if options.camera_motion == CameraMotion::Moving {
        return Ok(found);
    }
    let points: Vec<Point3> = matches.iter().map(|m| rest_point(rest, m)).collect();
    let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
    let [coarse, fine] = options.robust_px;
    let within = |posed: &Posed, px: f64| posed.residuals_px.iter().filter(|&&r| r < px).count();
    let nearest = views
        .iter()
        .map(|view| Posed::at(camera, &points, &pixels, *view, coarse))
        .min_by(|a, b| a.median_px().total_cmp(&b.median_px()));
    let most = nearest.as_ref().map_or(0, |there| within(there, 0.5 * coarse));
    match (nearest, options.camera_motion) {
        (Some(there), CameraMotion::AtRest) if 3 * most >= matches.len() => {
            Ok(Posed { at_rest: true, ..there })
        }
        (_, CameraMotion::AtRest) => {
            Err(RegisterError::NoView { agree: most, found: matches.len(), views: views.len() })
        }
        (Some(there), _) if stands(&found, within(&there, 0.5 * fine), matches.len()) => {
            Ok(Posed { at_rest: true, ..there })
        }
        _ => Ok(found),
    }
}

/// Whether the matches show tissue that moves before a camera at rest: some share a motion that no rigid pose explains, and
/// many do not move.
fn stands(found: &Posed, still: usize, all: usize) -> bool {
    found.shared_motion_px > 0.0 && still as f64 >= STILL * all as f64
}
