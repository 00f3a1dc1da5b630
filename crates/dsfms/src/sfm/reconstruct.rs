//! The stage: frames and intrinsics in, poses and points out.

use super::collect::{collect, normalise};
use super::error::SfmError;
use super::features::Features2d;
use super::followed::{Followed, follow_where_few, join};
use super::frames::{
    SfmProgress, SfmStage, ValidAreas, check_input, check_usable, detect_all, unusable,
};
use super::incremental::{grow, settle};
use super::kept::{whole_features, whole_matches, whole_poses};
use super::map::Map;
use super::matching::UnitDescriptors;
use super::options::LAST_LOSS;
use super::reconstruction::{FoundModel, NoPose, SparseReconstruction};
use super::rematch::rematch;
use super::tracks::{PairMatches, build_tracks};
use super::two_view::{VerifiedPair, verify_pairs};
use super::{LocalContrast, SfmOptions};
use crate::camera::CameraModel;
use crate::checkpoint::Keep;
use crate::image::{Frame, Mask};
use crate::solver::Loss;

/// Reconstruct camera poses and sparse points from overlapping frames of a rigid scene.
///
/// `masks`: one per frame, or an empty slice; `true` = valid. `camera`: intrinsics of all frames.
/// Frames that cannot be registered are listed with a reason; the error is for when nothing can
/// be reconstructed.
///
/// # Errors
/// Input that cannot belong together (counts, sizes, camera), options out of range, too few usable
/// frames, or no two that see the same from different places.
#[doc(alias("SfM", "structure from motion"))]
pub fn reconstruct(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    options: &SfmOptions,
    progress: SfmProgress,
) -> Result<SparseReconstruction, SfmError> {
    reconstruct_kept(frames, masks, camera, options, progress, Keep::default())
}

/// [`reconstruct`] that keeps what its steps make.
pub(crate) fn reconstruct_kept(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    options: &SfmOptions,
    progress: SfmProgress,
    keep: Keep,
) -> Result<SparseReconstruction, SfmError> {
    check_input(frames, masks, camera, options)?;
    let first = attempt(frames, masks, camera, options, progress, keep);
    let registered = |found: &Result<SparseReconstruction, SfmError>| {
        found.as_ref().map_or(0, SparseReconstruction::registered)
    };
    let enough = ENOUGH * frames.len() as f64;
    if options.local_contrast != LocalContrast::WhereNeeded || registered(&first) as f64 >= enough {
        return first;
    }
    tracing::info!(
        registered = registered(&first),
        of = frames.len(),
        enough = ENOUGH,
        "a second attempt, on local contrast"
    );
    // Faint texture makes descriptors alike; the geometry that matches must obey sorts them.
    let ratio = options.ratio.max(FAINT_RATIO);
    let local = SfmOptions { local_contrast: LocalContrast::Always, ratio, ..options.clone() };
    let second = attempt(frames, masks, camera, &local, progress, keep.suffixed("-contrast"));
    if registered(&second) > registered(&first) { second } else { first }
}

/// Share of the frames that spares a second attempt.
const ENOUGH: f64 = 0.8;

/// Ratio of descriptor distances in a second attempt, at least.
const FAINT_RATIO: f32 = 0.92;

fn attempt(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    options: &SfmOptions,
    progress: SfmProgress,
    keep: Keep,
) -> Result<SparseReconstruction, SfmError> {
    let areas = ValidAreas::new(frames, masks, options);
    let mut features = features(frames, &areas, options, progress, &keep)?;
    let descriptors: Vec<_> =
        features.iter().map(|f| UnitDescriptors::new(&f.descriptors)).collect();
    let whole =
        |found: &(Vec<VerifiedPair>, Vec<Followed>)| whole_matches(&found.0, &found.1, &features);
    let matched = || {
        let pairs = verify_pairs(camera, &features, &descriptors, options, progress);
        let tracks = follow_where_few(frames, &areas, &pairs, options, progress);
        Ok::<_, SfmError>((pairs, tracks))
    };
    let (mut pairs, tracks) = keep.stage("matches", |_| frames.len(), whole, matched)?;
    for VerifiedPair { a, b, matches, parallax_deg, .. } in &pairs {
        tracing::debug!(a, b, matches = matches.len(), parallax_deg, "pair");
    }
    let least = options.min_matches;
    tracing::info!(pairs = pairs.len(), followed = tracks.len(), least, "matches");
    let followed = join(&tracks, camera, &mut features, &descriptors, &mut pairs, options);
    let whole = |found: &SparseReconstruction| whole_poses(found, &features);
    let mut found = keep.stage("poses", SparseReconstruction::registered, whole, || {
        let mut rejected = unusable(frames, &features);
        check_usable(frames, &rejected)?;
        let (mut map, others) =
            largest_model(camera, &features, &pairs, options, progress, &mut rejected)?;
        let first = map.poses.iter().position(Option::is_some).unwrap_or(0);
        if options.refine.any() {
            settle(&mut map, first, options, options.refine, 2, 50);
        }
        if options.guided {
            rematch(&mut map, &descriptors, &followed, options, progress);
            settle(&mut map, first, options, options.refine, 2, 30);
        }
        finish_adjustment(&mut map, first, options);
        normalise(&mut map, first);
        Ok::<_, SfmError>(collect(map, frames, rejected, others))
    })?;
    found.features = features;
    Ok(found)
}

/// Features of every frame.
pub(super) fn features(
    frames: &[Frame],
    areas: &ValidAreas,
    options: &SfmOptions,
    progress: SfmProgress,
    keep: &Keep,
) -> Result<Vec<Features2d>, SfmError> {
    let whole = |found: &Vec<Features2d>| whole_features(found, frames.len());
    let make = || Ok(detect_all(frames, areas, options, progress));
    keep.stage("features", Vec::len, whole, make)
}

/// Grow models until no pair of unregistered frames starts another; keep the largest, and list the
/// others in the order in which they were found.
fn largest_model<'a>(
    camera: &CameraModel,
    features: &'a [Features2d],
    pairs: &[VerifiedPair],
    options: &SfmOptions,
    progress: SfmProgress,
    rejected: &mut Vec<(usize, NoPose)>,
) -> Result<(Map<'a>, Vec<FoundModel>), SfmError> {
    /// The largest counts; further ones are only told to the user.
    const MAX_MODELS: usize = 4;
    let counts: Vec<usize> = features.iter().map(Features2d::len).collect();
    let matched: Vec<PairMatches> =
        pairs.iter().map(|p| PairMatches { a: p.a, b: p.b, matches: p.matches.clone() }).collect();
    let tracks = build_tracks(&counts, &matched);
    let mut free = vec![true; features.len()];
    let mut models: Vec<Map> = Vec::new();
    let report = |n: usize| progress(SfmStage::Registration, n, features.len());
    while models.len() < MAX_MODELS {
        let Some(map) = grow(camera, features, &tracks, pairs, &free, options, &report) else {
            break;
        };
        free.iter_mut().zip(&map.poses).for_each(|(f, pose)| *f &= pose.is_none());
        models.push(map);
    }
    // The first of the largest, so that ties do not depend on anything else.
    let best = (0..models.len()).rev().max_by_key(|&i| models[i].registered());
    let Some(best) = best else {
        let largest = pairs.iter().map(|p| p.parallax_deg).fold(0.0, f64::max);
        let needed_deg = options.min_parallax_deg;
        return Err(SfmError::NoInitialPair {
            pairs: pairs.len(),
            parallax_deg: largest,
            needed_deg,
        });
    };
    explain(&models, best, pairs, rejected);
    let kept = models.remove(best);
    Ok((kept, models.iter().map(Map::summary).collect()))
}

/// Say of every frame outside the chosen model why it is outside.
fn explain(
    models: &[Map],
    best: usize,
    pairs: &[VerifiedPair],
    rejected: &mut Vec<(usize, NoPose)>,
) {
    for view in 0..models[best].poses.len() {
        if models[best].poses[view].is_some() || rejected.iter().any(|r| r.0 == view) {
            continue;
        }
        let other = models.iter().find(|m| m.poses[view].is_some());
        let linked = pairs.iter().filter(|p| p.a == view || p.b == view).count();
        let why = match (other, linked) {
            (Some(other), _) => NoPose::OtherModel { frames: other.registered() },
            (None, 0) => NoPose::Unmatched,
            (None, matching) => NoPose::Disagreement { matching },
        };
        rejected.push((view, why));
    }
    rejected.sort_by_key(|r| r.0);
}

/// Last adjustment: a loss that gives far sightings no say, then only what fits.
fn finish_adjustment(map: &mut Map, first: usize, options: &SfmOptions) {
    for loss in [Loss::GemanMcClure(1.5), LAST_LOSS] {
        // As in `settle`: every sighting used has a finite error.
        let _ = map.adjust(&|v| v == first, loss, options.refine, 50);
        map.filter(&options.limits());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Isometry, Point3, Vector3, align_similarity};
    use crate::sfm::random::Random;
    use crate::sfm::triangulate_known;
    use crate::sfm::triangulation::centre_of;

    const SIZE: [usize; 2] = [200, 150];

    fn camera() -> CameraModel {
        CameraModel::pinhole(SIZE, [180.0; 2], [99.5, 74.5])
    }

    fn poses() -> Vec<Isometry> {
        let pose = |i: i32| {
            let x = (i - 2) as f64;
            let turn = Vector3::new(0.01 * x, -0.07 * x, 0.02 * x * x);
            Isometry::new(Vector3::new(-3.5 * x, 0.4 * x * x, 50.0), turn)
        };
        (0..5).map(pose).collect()
    }

    /// Gaussian blobs of several sizes on a wavy sheet.
    fn frame(pose: &Isometry, index: usize) -> Frame {
        frame_of(11, pose, index)
    }

    /// Of the sheet with the blobs of a seed.
    fn frame_of(sheet: u64, pose: &Isometry, index: usize) -> Frame {
        let mut random = Random::new(sheet, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        let mut grey = vec![0.4; SIZE[0] * SIZE[1]];
        for _ in 0..500 {
            let (x, y) = (70.0 * unit(), 55.0 * unit());
            let point = Point3::new(x, y, 4.0 * (0.15 * x).sin() + 3.0 * (0.2 * y).cos());
            let (sigma, height) = (1.0 + 1.5 * (unit() + 0.5), 0.8 * unit());
            let Some(seen) = crate::camera::Camera::project(&camera(), &(pose * point)) else {
                continue;
            };
            let reach = (4.0 * sigma) as i64;
            let (u, v) = (seen.pixel.x.round() as i64, seen.pixel.y.round() as i64);
            for (i, j) in
                (v - reach..=v + reach).flat_map(|j| (u - reach..=u + reach).map(move |i| (i, j)))
            {
                if (0..SIZE[0] as i64).contains(&i) && (0..SIZE[1] as i64).contains(&j) {
                    let (dx, dy) = (i as f64 - seen.pixel.x, j as f64 - seen.pixel.y);
                    let bell = (-(dx * dx + dy * dy) / (2.0 * sigma * sigma)).exp();
                    grey[j as usize * SIZE[0] + i as usize] += height * bell;
                }
            }
        }
        let rgb =
            grey.iter().map(|g: &f64| [(g.clamp(0.02, 0.95) * 255.0).round() as u8; 3]).collect();
        Frame { name: format!("frame_{index:03}"), size: SIZE, rgb }
    }

    fn frames() -> Vec<Frame> {
        poses().iter().enumerate().map(|(i, p)| frame(p, i)).collect()
    }

    fn run(frames: &[Frame], threads: usize) -> Result<SparseReconstruction, SfmError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| reconstruct(frames, &[], &camera(), &SfmOptions::default(), &|_, _, _| ()))
    }

    #[test]
    fn poses_come_back_with_the_same_bits_at_any_thread_count_and_a_black_frame_is_named() {
        let mut frames = frames();
        frames.push(Frame {
            name: "dark".into(),
            size: SIZE,
            rgb: vec![[2; 3]; SIZE[0] * SIZE[1]],
        });
        let (one, two) = (run(&frames, 1).unwrap(), run(&frames, 2).unwrap());
        assert_eq!(one.poses, two.poses);
        assert_eq!(one.points, two.points);
        assert_eq!(one.registered(), 5);
        assert!(matches!(one.rejected[..], [(_, NoPose::Black { .. })]), "{:?}", one.rejected);
        let found: Vec<Point3> = one.poses.iter().flatten().map(centre_of).collect();
        let truth: Vec<Point3> = poses().iter().map(centre_of).collect();
        let fit = align_similarity(&found, &truth).unwrap();
        // A pixel is 0.28 units at this depth, and overlapping blobs shift one another.
        for (f, t) in found.iter().zip(&truth) {
            assert!((fit * f - t).norm() < 0.2, "{}", (fit * f - t).norm());
        }
    }

    #[test]
    fn frames_of_two_places_are_two_models_and_the_larger_is_kept() {
        // The last three poses have parallax enough among themselves.
        let mut frames: Vec<Frame> =
            poses()[2..].iter().enumerate().map(|(i, p)| frame_of(23, p, i)).collect();
        frames.extend(poses().iter().enumerate().map(|(i, p)| frame_of(11, p, 3 + i)));
        let found = run(&frames, 2).unwrap();
        let [kept, other] = &found.models[..] else { panic!("{:?}", found.models) };
        assert_eq!((&kept.frames[..], &other.frames[..]), (&[3, 4, 5, 6, 7][..], &[0, 1, 2][..]));
        assert_eq!(kept.points, found.points.len());
        assert!(other.points >= SfmOptions::default().min_matches, "{}", other.points);
        assert_eq!(found.rejected.iter().map(|r| r.0).collect::<Vec<_>>(), other.frames);
        assert!(found.rejected.iter().all(|r| r.1 == NoPose::OtherModel { frames: 3 }));
    }

    #[test]
    fn where_there_are_no_features_corners_are_followed() {
        // Nothing has such a contrast.
        let blind = SfmOptions { contrast_threshold: 1.0, ..Default::default() };
        let run =
            |options: &SfmOptions| reconstruct(&frames(), &[], &camera(), options, &|_, _, _| ());
        let without = run(&SfmOptions { flow_below: 0, ..blind.clone() });
        assert!(matches!(without, Err(SfmError::TooFewFeatures { usable: 0, .. })));
        let found = run(&blind).unwrap();
        assert_eq!(found.registered(), 5, "{:?}", found.rejected);
        let centres: Vec<Point3> = found.poses.iter().flatten().map(centre_of).collect();
        let truth: Vec<Point3> = poses().iter().map(centre_of).collect();
        let fit = align_similarity(&centres, &truth).unwrap();
        for (f, t) in centres.iter().zip(&truth) {
            assert!((fit * f - t).norm() < 0.4, "{}", (fit * f - t).norm());
        }
        assert!(found.features.iter().all(|f| f.descriptors.is_empty()));
    }

    #[test]
    fn known_poses_give_points_on_the_sheet() {
        let poses: Vec<_> = poses().into_iter().map(Some).collect();
        let options = SfmOptions::default();
        let found = triangulate_known(
            &frames(),
            &[],
            &camera(),
            &poses,
            &options,
            &|_, _, _| (),
            Keep::default(),
        )
        .unwrap();
        assert_eq!(found.poses, poses);
        assert!(found.points.len() > 50, "{}", found.points.len());
        let height = |p: &Point3| (p.z - 4.0 * (0.15 * p.x).sin() - 3.0 * (0.2 * p.y).cos()).abs();
        let mut heights: Vec<f64> = found.points.iter().map(|p| height(&p.position)).collect();
        heights.sort_by(f64::total_cmp);
        assert!(heights[heights.len() / 2] < 0.5, "{}", heights[heights.len() / 2]);
    }

    #[test]
    fn bad_input_is_named() {
        let frames = frames();
        assert!(matches!(run(&frames[..1], 1), Err(SfmError::TooFewFrames(1))));
        let mut small = frames[..2].to_vec();
        small[1].size = [100, 300];
        assert!(run(&small, 1).unwrap_err().to_string().contains("frame_001"));
        let still = vec![frames[0].clone(); 3];
        assert!(matches!(run(&still, 1), Err(SfmError::NoInitialPair { .. })));
        let black = Frame { name: "b".into(), size: SIZE, rgb: vec![[0; 3]; SIZE[0] * SIZE[1]] };
        let error = run(&[black.clone(), black], 1).unwrap_err();
        assert!(
            matches!(error, SfmError::TooFewFeatures { usable: 0, .. })
                && error.to_string().contains("black")
        );
        let mut bad = camera();
        bad.focal[0] = f64::NAN;
        let result = reconstruct(&frames, &[], &bad, &SfmOptions::default(), &|_, _, _| ());
        assert!(matches!(result, Err(SfmError::Camera(_))));
    }
}
