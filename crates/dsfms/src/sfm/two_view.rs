//! Which frames see the same thing: matching and epipolar verification of pairs.

use super::SfmOptions;
use super::essential::{parallax_deg, relative_pose};
use super::features::Features2d;
use super::matching::{DescriptorMatch, UnitDescriptors, match_unit};
use super::random::Random;
use super::triangulation::{Sighting, centre_of, nearest_to_rays};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point3, Vector3};
use rayon::prelude::*;

/// A pair of frames with a relative pose.
#[derive(Clone, Debug)]
pub struct VerifiedPair {
    /// First frame.
    pub a: usize,
    /// Second frame, `a < b`.
    pub b: usize,
    /// From the axes of camera `a` to those of `b`; translation of length 1.
    pub b_from_a: Isometry,
    /// Matches that agree with the pose.
    pub matches: Vec<DescriptorMatch>,
    /// Median angle between the sightlines of the matches, degrees.
    pub parallax_deg: f64,
}

/// The pairs to compare: all for few frames, else neighbours within the window and every tenth
/// frame with every tenth.
pub fn candidate_pairs(frames: usize, options: &SfmOptions) -> Vec<(usize, usize)> {
    let wanted = |a: usize, b: usize| {
        frames <= options.all_pairs_up_to
            || b - a <= options.window
            || (a.is_multiple_of(10) && b.is_multiple_of(10))
    };
    (0..frames)
        .flat_map(|a| (a + 1..frames).map(move |b| (a, b)))
        .filter(|&(a, b)| wanted(a, b))
        .collect()
}

/// Match and verify the candidate pairs, in order; pairs that fail are left out.
pub fn verify_pairs(
    camera: &CameraModel,
    features: &[Features2d],
    descriptors: &[UnitDescriptors],
    options: &SfmOptions,
    done: &(dyn Fn() + Sync),
) -> Vec<VerifiedPair> {
    let rays: Vec<Vec<Option<Vector3>>> =
        features.iter().map(|f| f.points.iter().map(|p| camera.unproject(p)).collect()).collect();
    let heads: Vec<_> = descriptors.iter().map(|d| d.head(options.preview_features)).collect();
    let verify = |&(a, b): &(usize, usize)| {
        let found = (b - a <= 2 || looks_related(&heads[a], &heads[b], options))
            .then(|| {
                match_unit(&descriptors[a], &descriptors[b], options.ratio, options.max_distance)
            })
            .and_then(|matches| {
                verify_pair(camera, [a, b], [&rays[a], &rays[b]], matches, options)
            });
        done();
        found
    };
    let pairs = candidate_pairs(features.len(), options);
    let found: Vec<Option<VerifiedPair>> = pairs.par_iter().with_max_len(1).map(verify).collect();
    found.into_iter().flatten().collect()
}

/// Whether the strongest features alone give a few matches: saves the full comparison of frames
/// that see different things.
fn looks_related(a: &UnitDescriptors, b: &UnitDescriptors, options: &SfmOptions) -> bool {
    match_unit(a, b, options.ratio, options.max_distance).len() >= options.preview_matches
}

fn verify_pair(
    camera: &CameraModel,
    [a, b]: [usize; 2],
    rays: [&[Option<Vector3>]; 2],
    mut matches: Vec<DescriptorMatch>,
    options: &SfmOptions,
) -> Option<VerifiedPair> {
    matches.retain(|m| rays[0][m.a as usize].is_some() && rays[1][m.b as usize].is_some());
    if matches.len() < options.min_matches {
        return None;
    }
    let from: Vec<Vector3> = matches.iter().filter_map(|m| rays[0][m.a as usize]).collect();
    let to: Vec<Vector3> = matches.iter().filter_map(|m| rays[1][m.b as usize]).collect();
    let threshold = options.max_epipolar_px / mean_focal(camera);
    let mut random = Random::new(options.seed, ((a as u64) << 32) | b as u64);
    let found = relative_pose(&from, &to, threshold, &mut random)?;
    if found.inliers.len() < options.min_matches {
        return None;
    }
    let parallax = found.inliers.iter().map(|&i| pair_parallax(&found.b_from_a, &from[i], &to[i]));
    let mut parallax: Vec<f64> = parallax.collect();
    parallax.sort_by(f64::total_cmp);
    Some(VerifiedPair {
        a,
        b,
        b_from_a: found.b_from_a,
        parallax_deg: parallax[parallax.len() / 2],
        matches: found.inliers.iter().map(|&i| matches[i]).collect(),
    })
}

/// Angle between two sightlines, degrees.
fn pair_parallax(b_from_a: &Isometry, a: &Vector3, b: &Vector3) -> f64 {
    let origin = crate::geometry::Point2::origin();
    let sightings = [(Isometry::identity(), *a), (*b_from_a, *b)].map(|(pose, ray)| Sighting {
        pose,
        ray,
        pixel: origin,
    });
    nearest_to_rays(&sightings)
        .map_or(0.0, |p| parallax_deg(&p, &Point3::origin(), &centre_of(b_from_a)))
}

/// Mean focal length, px: turns pixels into small angles.
pub(super) fn mean_focal(camera: &CameraModel) -> f64 {
    0.5 * (camera.focal[0] + camera.focal[1])
}
