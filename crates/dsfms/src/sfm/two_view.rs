//! Which frames see the same thing: matching and epipolar verification of pairs.

use super::SfmOptions;
use super::essential::{parallax_deg, relative_pose};
use super::features::Features2d;
use super::frames::{Counter, SfmProgress, SfmStage};
use super::matching::{DescriptorMatch, UnitDescriptors, match_unit};
use super::random::Random;
use super::triangulation::{Sighting, centre_of, nearest_to_rays};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point3, Vector3};
use rayon::prelude::*;

/// A pair of frames with a relative pose.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
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

/// All pairs of few frames; else neighbours within the window and, of the distant pairs, those that
/// either frame counts among its `retrieved` of the highest score (0 = unrelated). In order.
pub(crate) fn chosen_pairs(
    frames: usize,
    options: &SfmOptions,
    score: &(dyn Fn(usize, usize) -> usize + Sync),
) -> Vec<(usize, usize)> {
    let mut pairs = all_pairs(frames);
    if frames <= options.all_pairs_up_to {
        return pairs;
    }
    let near = |a: usize, b: usize| b - a <= options.window;
    let distant: Vec<(usize, usize, usize)> = pairs
        .par_iter()
        .filter(|&&(a, b)| !near(a, b))
        .map(|&(a, b)| (score(a, b), a, b))
        .collect();
    let mut wanted = vec![false; frames * frames];
    for frame in 0..frames {
        let mut own: Vec<_> =
            distant.iter().filter(|(s, a, b)| *s > 0 && (*a == frame || *b == frame)).collect();
        own.sort_by_key(|(s, a, b)| (std::cmp::Reverse(*s), *a, *b));
        own.iter().take(options.retrieved).for_each(|(_, a, b)| wanted[a * frames + b] = true);
    }
    pairs.retain(|&(a, b)| near(a, b) || wanted[a * frames + b]);
    pairs
}

fn all_pairs(frames: usize) -> Vec<(usize, usize)> {
    (0..frames).flat_map(|a| (a + 1..frames).map(move |b| (a, b))).collect()
}

/// Match and verify pairs of frames, in order; pairs that fail are left out.
pub(crate) fn verify_pairs(
    camera: &CameraModel,
    features: &[Features2d],
    descriptors: &[UnitDescriptors],
    options: &SfmOptions,
    progress: SfmProgress,
) -> Vec<VerifiedPair> {
    let rays = sightlines(camera, features);
    let heads: Vec<_> = descriptors.iter().map(|d| d.head(options.preview_features)).collect();
    // The strongest features alone tell whether frames see the same thing.
    let preview = |a: usize, b: usize| {
        let found = match_unit(&heads[a], &heads[b], options.ratio, options.max_distance).len();
        if found >= options.preview_matches { found } else { 0 }
    };
    let pairs = chosen_pairs(features.len(), options, &preview);
    let count = Counter::new(SfmStage::Matching, pairs.len(), progress);
    let verify = |&(a, b): &(usize, usize)| {
        let found = (b - a <= 2 || preview(a, b) > 0)
            .then(|| {
                match_unit(&descriptors[a], &descriptors[b], options.ratio, options.max_distance)
            })
            .and_then(|matches| {
                verify_pair(camera, [a, b], [&rays[a], &rays[b]], matches, options)
            });
        count.next();
        found
    };
    let found: Vec<Option<VerifiedPair>> = pairs.par_iter().with_max_len(1).map(verify).collect();
    found.into_iter().flatten().collect()
}

/// Unit sightlines of the features of every frame; `None` where the lens has no inverse.
pub(super) fn sightlines(
    camera: &CameraModel,
    features: &[Features2d],
) -> Vec<Vec<Option<Vector3>>> {
    features.iter().map(|f| f.points.iter().map(|p| camera.unproject(p)).collect()).collect()
}

/// The relative pose of frames `[a, b]` and the matches that agree with it; `None` for too few.
pub(super) fn verify_pair(
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_and_the_best_of_the_distant() {
        let options =
            SfmOptions { all_pairs_up_to: 4, window: 1, retrieved: 1, ..Default::default() };
        assert_eq!(chosen_pairs(4, &options, &|_, _| 0).len(), 6);
        // Frame 0 is like frame 5 and a little like frame 3; the others are like nothing distant.
        let score = |a: usize, b: usize| match (a, b) {
            (0, 5) => 40,
            (0, 3) => 10,
            _ => 0,
        };
        let found = chosen_pairs(6, &options, &score);
        // Frame 3 has no better one than frame 0.
        assert_eq!(found, [(0, 1), (0, 3), (0, 5), (1, 2), (2, 3), (3, 4), (4, 5)]);
    }

    /// Features of 80 points with descriptors of their own, as four cameras beside each other see
    /// them.
    fn features(camera: &CameraModel) -> Vec<Features2d> {
        let mut random = Random::new(3, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        let points: Vec<Point3> = (0..80)
            .map(|_| Point3::new(30.0 * unit(), 30.0 * unit(), 50.0 + 20.0 * unit()))
            .collect();
        let mut one = || (256.0 * (unit() + 0.5)) as u8;
        let descriptors: Vec<[u8; 128]> = (0..80).map(|_| [(); 128].map(|()| one())).collect();
        let frame = |i: usize| {
            let moved = |p: &Point3| p + Vector3::new(2.0 * i as f64, -0.5 * i as f64, 0.0);
            let seen = points.iter().map(|p| camera.project(&moved(p)).unwrap().pixel);
            Features2d {
                points: seen.collect(),
                scale: vec![1.0; 80],
                angle: vec![0.0; 80],
                descriptors: descriptors.clone(),
            }
        };
        (0..4).map(frame).collect()
    }

    #[test]
    fn distant_frames_are_matched_where_their_strongest_features_are_alike() {
        let camera = CameraModel::pinhole([200, 150], [180.0; 2], [99.5, 74.5]);
        let features = features(&camera);
        let unit: Vec<UnitDescriptors> =
            features.iter().map(|f| UnitDescriptors::new(&f.descriptors)).collect();
        let pairs = |preview_matches| -> Vec<(usize, usize)> {
            let options = SfmOptions { preview_matches, min_matches: 20, ..Default::default() };
            let found = verify_pairs(&camera, &features, &unit, &options, &|_, _, _| ());
            found.iter().map(|pair| (pair.a, pair.b)).collect()
        };
        assert_eq!(pairs(20), [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]);
        // No preview has so many: neighbours, and theirs, are matched all the same.
        assert_eq!(pairs(1000), [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)]);
    }
}
