//! A camera whose pose is known: it stands where it stood in a view of the exploration, or what
//! lies around the organ shows it.
//!
//! Seen alone, a surface that stretches by 3 % is one that lies 3 % nearer: the rigid pose of its
//! matches is off by that much of the distance. Where the camera's pose is known, all that the
//! matches share is motion of the tissue.

use super::correspondence::Match;
use super::error::RegisterError;
use super::pose::{count_within, median_of, residuals, rest_point};
use super::{CameraMotion, Posed, RegisterOptions};
use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3};
use crate::mesh::Mesh;
use crate::template::TemplateView;

/// Share of the matches that do not move in the image, from which on the camera is taken to stand:
/// a camera that moves moves all of them, and nearly always by more than their noise.
const STILL: f64 = 0.25;
/// Share of those that do not move which lie within half the distance, at least. About the point
/// that a moving camera leaves in place motion grows with distance, and a quarter would; of matches
/// of 0.7 px noise 0.75 do.
const STILL_WITHIN_HALF: f64 = 0.5;

/// Where the camera may be, whatever the matches on the organ say.
#[derive(Clone, Copy, Debug)]
pub struct KnownPoses<'a> {
    /// Views of the exploration, where it may stand.
    pub views: &'a [TemplateView],
    /// `camera_from_template` as what lies around the organ shows it.
    pub around: Option<Isometry>,
}

/// The rigid pose that matches gave, or a known one that a part of them agrees with while others
/// move, as [`RegisterOptions::camera_motion`] says. Not in the paper.
///
/// # Errors
/// [`RegisterError::NoView`]: the camera is said to be at rest, and a third of the matches agree
/// with no view.
pub fn posed_from(
    known: &KnownPoses,
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
    let KnownPoses { views, around } = *known;
    let around = around.filter(|_| options.camera_motion == CameraMotion::Auto);
    let there = |pose: Isometry| (pose, residuals(camera, &pose, &points, &pixels));
    let poses = views.iter().map(|view| view.camera_from_template).chain(around);
    let nearest = poses.map(there).min_by(|a, b| median_of(&a.1).total_cmp(&median_of(&b.1)));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector3;
    use crate::register::pose;
    use crate::synth::{Draw, Random, correspond, patch};

    #[test]
    fn a_stretch_is_no_change_of_distance_where_the_camera_is_known() {
        let camera = CameraModel::pinhole([640, 480], [600.0; 2], [319.5, 239.5]);
        let rest = patch(600, 3).mesh;
        let truth = Isometry::new(Vector3::new(2.0, -1.0, 70.0), Vector3::new(0.15, -0.2, 0.05));
        let at = |p: &Point3| {
            let grown = (p.x + 5.0).max(0.0);
            truth * (p + Vector3::new(grown, p.y * grown / 30.0, 0.0) * 0.05)
        };
        let shape: Vec<Point3> = rest.positions.iter().map(at).collect();
        let draw = Draw { count: 120, sigma_px: 0.4 };
        let all = vec![true; shape.len()];
        let matches = correspond(&camera, &rest, &shape, &all, draw, &mut Random::new(1, 2));
        let options = RegisterOptions::default();
        let found = pose(&camera, &rest, &matches, &options, 0).unwrap();
        let off = |posed: &Posed| (posed.pose * Point3::origin() - truth * Point3::origin()).norm();
        let posed = |around, options: &RegisterOptions| {
            let known = KnownPoses { views: &[], around };
            posed_from(&known, &camera, &rest, &matches, found.clone(), options).unwrap()
        };
        assert!(off(&found) > 0.3, "{}", off(&found));
        let known = posed(Some(truth), &options);
        assert!(known.at_rest && known.pose == truth);
        assert_eq!(posed(None, &options).pose, found.pose);
        // One that no part of the matches agrees with, and one that nobody asked for.
        let wrong = Isometry::translation(0.0, 1.0, 0.0) * truth;
        assert_eq!(posed(Some(wrong), &options).pose, found.pose);
        let moving = RegisterOptions { camera_motion: CameraMotion::Moving, ..options };
        assert_eq!(posed(Some(truth), &moving).pose, found.pose);
    }
}
