//! The stage: frames and intrinsics in, poses and points out.

use super::features::{Features2d, detect, viewport};
use super::guided::{GuidedLimits, GuidedView, match_guided};
use super::incremental::{grow, settle};
use super::map::{Map, MapTrack};
use super::matching::UnitDescriptors;
use super::reconstruction::{Reconstruction, ScenePoint, SfmError, TrackedPixel};
use super::tracks::{PairMatches, build_tracks};
use super::two_view::{VerifiedPair, candidate_pairs, mean_focal, verify_pairs};
use super::{RefineIntrinsics, SfmOptions};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2};
use crate::image::{Frame, Mask};
use crate::solver::Loss;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Steps of the stage, for progress displays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SfmStage {
    /// Frames whose features were detected.
    Features,
    /// Pairs of frames compared.
    Matching,
    /// Frames registered.
    Registration,
    /// Pairs compared along epipolar lines.
    GuidedMatching,
}

/// Receives the stage, the number of things done and of all things; may be called from any thread.
pub type Progress<'a> = &'a (dyn Fn(SfmStage, usize, usize) + Sync);

/// Fewest features of a usable frame.
const MIN_FEATURES: usize = 30;

/// Reconstruct camera poses and sparse points from overlapping frames of a rigid scene.
///
/// `masks`: one per frame, or an empty slice; `true` = valid. `camera`: intrinsics of all frames.
/// Frames that cannot be registered are listed with a reason; the error is for when nothing can
/// be reconstructed.
pub fn reconstruct(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    options: &SfmOptions,
    progress: Progress,
) -> Result<Reconstruction, SfmError> {
    check_input(frames, masks, camera, options)?;
    let features = detect_all(frames, masks, options, progress);
    let mut rejected = unusable(frames, &features);
    check_usable(frames, &rejected)?;
    let descriptors: Vec<_> =
        features.iter().map(|f| UnitDescriptors::new(&f.descriptors)).collect();
    let count =
        Counter::new(SfmStage::Matching, candidate_pairs(frames.len(), options).len(), progress);
    let pairs = verify_pairs(camera, &features, &descriptors, options, &|| count.next());
    let mut map = largest_model(camera, &features, &pairs, options, progress, &mut rejected)?;
    let first = map.poses.iter().position(Option::is_some).unwrap_or(0);
    if options.guided {
        rematch(&mut map, &descriptors, options, progress);
        settle(&mut map, first, options, 2, 30);
    }
    finish_adjustment(&mut map, first, options);
    normalise(&mut map, first);
    Ok(collect(map, frames, rejected))
}

/// Points and features for poses that are known: features, matching along epipolar lines and
/// triangulation; neither poses nor intrinsics are changed.
///
/// `poses`: `camera_from_world` per frame, `None` for frames to leave out.
pub fn triangulate_known(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    poses: &[Option<Isometry>],
    options: &SfmOptions,
    progress: Progress,
) -> Result<Reconstruction, SfmError> {
    check_input(frames, masks, camera, options)?;
    if poses.len() != frames.len() {
        return Err(SfmError::Count { what: "poses", found: poses.len(), frames: frames.len() });
    }
    let features = detect_all(frames, masks, options, progress);
    let mut rejected = unusable(frames, &features);
    let missing = (0..frames.len()).filter(|&v| poses[v].is_none());
    rejected.extend(missing.map(|v| (v, "no pose was given".to_string())));
    rejected.sort_by_key(|r| r.0);
    rejected.dedup_by_key(|r| r.0);
    let descriptors: Vec<_> =
        features.iter().map(|f| UnitDescriptors::new(&f.descriptors)).collect();
    let mut map = Map {
        camera: camera.clone(),
        features: &features,
        poses: poses.to_vec(),
        tracks: Vec::new(),
    };
    rematch(&mut map, &descriptors, options, progress);
    let none = RefineIntrinsics::default();
    // Without points there is nothing to adjust, and the caller sees an empty cloud.
    let _ = map.adjust(&|_| true, Loss::GemanMcClure(1.5), none, 20);
    map.filter(&options.limits());
    Ok(collect(map, frames, rejected))
}

fn check_input(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    options: &SfmOptions,
) -> Result<(), SfmError> {
    options.validate()?;
    if frames.len() < 2 {
        return Err(SfmError::TooFewFrames(frames.len()));
    }
    if !masks.is_empty() && masks.len() != frames.len() {
        return Err(SfmError::Count { what: "masks", found: masks.len(), frames: frames.len() });
    }
    let [fx, fy] = camera.focal;
    let [cx, cy] = camera.centre;
    for (field, value, positive) in
        [("fx", fx, true), ("fy", fy, true), ("cx", cx, false), ("cy", cy, false)]
    {
        if !value.is_finite() || (positive && value <= 0.0) {
            return Err(SfmError::Camera { field, value, positive });
        }
    }
    for (i, frame) in frames.iter().enumerate() {
        let (frame, found, expected) = (frame.name.clone(), frame.size, camera.size);
        if found != expected {
            return Err(SfmError::Size { frame, found, expected });
        }
        if let Some(mask) = masks.get(i).and_then(Option::as_ref).filter(|m| m.size != found) {
            return Err(SfmError::MaskSize { frame, found: mask.size, expected: found });
        }
    }
    Ok(())
}

fn detect_all(
    frames: &[Frame],
    masks: &[Option<Mask>],
    options: &SfmOptions,
    progress: Progress,
) -> Vec<Features2d> {
    const RIM_PX: usize = 12;
    let lit = if options.find_viewport { viewport(frames, RIM_PX) } else { None };
    let count = Counter::new(SfmStage::Features, frames.len(), progress);
    let one = |(i, frame): (usize, &Frame)| {
        let own = masks.get(i).and_then(Option::as_ref);
        let mask = match (own, &lit) {
            (Some(own), Some(lit)) => Some(both(own, lit)),
            (own, lit) => own.or(lit.as_ref()).cloned(),
        };
        let features = detect(frame, mask.as_ref(), options);
        count.next();
        features
    };
    frames.par_iter().enumerate().with_max_len(1).map(one).collect()
}

fn both(a: &Mask, b: &Mask) -> Mask {
    let data = a.data.iter().zip(&b.data).map(|(a, b)| *a && *b).collect();
    Mask { size: a.size, data }
}

/// Frames with too few features, and why.
fn unusable(frames: &[Frame], features: &[Features2d]) -> Vec<(usize, String)> {
    let reason = |(i, f): (usize, &Features2d)| {
        (f.len() < MIN_FEATURES).then(|| {
            let brightest = frames[i].rgb.iter().flatten().max().copied().unwrap_or(0);
            let why = if brightest < 16 {
                format!("the frame is black (brightest value {brightest} of 255)")
            } else {
                format!(
                    "{} features inside the valid area, at least {MIN_FEATURES} are needed",
                    f.len()
                )
            };
            (i, why)
        })
    };
    features.iter().enumerate().filter_map(reason).collect()
}

fn check_usable(frames: &[Frame], rejected: &[(usize, String)]) -> Result<(), SfmError> {
    let usable = frames.len() - rejected.len();
    if usable >= 2 {
        return Ok(());
    }
    let reasons: Vec<String> =
        rejected.iter().take(5).map(|(i, why)| format!("{}: {why}", frames[*i].name)).collect();
    Err(SfmError::TooFewFeatures { usable, frames: frames.len(), reasons: reasons.join("; ") })
}

/// Grow models until no pair of unregistered frames starts another; keep the largest.
fn largest_model<'a>(
    camera: &CameraModel,
    features: &'a [Features2d],
    pairs: &[VerifiedPair],
    options: &SfmOptions,
    progress: Progress,
    rejected: &mut Vec<(usize, String)>,
) -> Result<Map<'a>, SfmError> {
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
    Ok(models.swap_remove(best))
}

/// Say of every frame outside the chosen model why it is outside.
fn explain(
    models: &[Map],
    best: usize,
    pairs: &[VerifiedPair],
    rejected: &mut Vec<(usize, String)>,
) {
    for view in 0..models[best].poses.len() {
        if models[best].poses[view].is_some() || rejected.iter().any(|r| r.0 == view) {
            continue;
        }
        let other = models.iter().find(|m| m.poses[view].is_some());
        let linked = pairs.iter().filter(|p| p.a == view || p.b == view).count();
        let why = match (other, linked) {
            (Some(other), _) => format!(
                "it belongs to a separate model of {} frames that shares too few points with the largest",
                other.registered()
            ),
            (None, 0) => "no other frame matches it".to_string(),
            (None, n) => {
                format!("{n} frames match it, but too few reconstructed points agree on a pose")
            }
        };
        rejected.push((view, why));
    }
    rejected.sort_by_key(|r| r.0);
}

/// Match all registered pairs again along epipolar lines; new tracks, new points.
fn rematch(
    map: &mut Map,
    descriptors: &[UnitDescriptors],
    options: &SfmOptions,
    progress: Progress,
) {
    let views: Vec<Option<GuidedView>> = (0..map.poses.len())
        .map(|v| {
            let rays = map.features[v].points.iter().map(|p| map.camera.unproject(p)).collect();
            Some(GuidedView { pose: map.poses[v]?, rays, descriptors: descriptors[v].clone() })
        })
        .collect();
    let limits = GuidedLimits {
        angle: options.max_epipolar_px / mean_focal(&map.camera),
        ratio: 0.5 * (1.0 + options.ratio),
        max_distance: options.max_distance,
        depth: depth_range(map),
    };
    let pairs = candidate_pairs(map.poses.len(), options);
    let count = Counter::new(SfmStage::GuidedMatching, pairs.len(), progress);
    let guided = |&(a, b): &(usize, usize)| {
        let matches = match (&views[a], &views[b]) {
            (Some(from), Some(to)) => match_guided(from, to, &limits),
            _ => Vec::new(),
        };
        count.next();
        PairMatches { a, b, matches }
    };
    let matched: Vec<PairMatches> = pairs.par_iter().with_max_len(1).map(guided).collect();
    let counts: Vec<usize> = map.features.iter().map(Features2d::len).collect();
    map.tracks = build_tracks(&counts, &matched).into_iter().map(MapTrack::new).collect();
    map.triangulate(&options.limits());
}

/// Distances between which points are looked for: those of the known points with room, or, without
/// points, from a tenth of the camera path's extent to infinity.
fn depth_range(map: &Map) -> [f64; 2] {
    let mut depths: Vec<f64> = Vec::new();
    for track in &map.tracks {
        let Some(point) = track.point else { continue };
        depths.extend(
            track.seen().filter_map(|m| Some((map.poses[m.view as usize]? * point).coords.norm())),
        );
    }
    depths.sort_by(f64::total_cmp);
    if let (Some(near), Some(far)) =
        (depths.get(depths.len() / 100), depths.get(depths.len() * 99 / 100))
    {
        return [0.7 * near, 1.5 * far];
    }
    let centres: Vec<_> = map.poses.iter().flatten().map(super::triangulation::centre_of).collect();
    let extent = centres.iter().map(|c| (c - centres[0]).norm()).fold(0.0, f64::max);
    [0.1 * extent, 1e4 * extent]
}

/// Last adjustment: a loss that gives far sightings no say, then only what fits.
fn finish_adjustment(map: &mut Map, first: usize, options: &SfmOptions) {
    for loss in [Loss::GemanMcClure(1.5), Loss::GemanMcClure(1.0)] {
        // As in `settle`: every sighting used has a finite error.
        let _ = map.adjust(&|v| v == first, loss, options.refine, 50);
        map.filter(&options.limits());
    }
}

/// World axes of the first registered camera, median depth 50.
fn normalise(map: &mut Map, first: usize) {
    const MEDIAN_DEPTH: f64 = 50.0;
    if let Some(pose) = map.poses[first] {
        map.poses.iter_mut().flatten().for_each(|p| *p *= pose.inverse());
        map.tracks.iter_mut().filter_map(|t| t.point.as_mut()).for_each(|p| *p = pose * *p);
    }
    let depth = map.median_depth();
    if depth > 0.0 {
        map.rescale(MEDIAN_DEPTH / depth);
    }
}

fn collect(map: Map, frames: &[Frame], rejected: Vec<(usize, String)>) -> Reconstruction {
    let errors = map.errors();
    let mut sums = vec![(0.0, 0usize); frames.len()];
    for &(_, view, error) in &errors {
        sums[view] = (sums[view].0 + error * error, sums[view].1 + 1);
    }
    let points = errors.chunk_by(|x, y| x.0 == y.0).filter_map(|of_track| {
        let track = &map.tracks[of_track[0].0];
        let pixel = |m: super::tracks::Member| TrackedPixel {
            frame: m.view as usize,
            feature: m.feature as usize,
            pixel: map.pixel(m),
        };
        let seen: Vec<TrackedPixel> = track.seen().map(pixel).collect();
        Some(ScenePoint {
            position: track.point?,
            rgb: mean_colour(frames, &seen),
            error_px: of_track.iter().map(|e| e.2).sum::<f64>() / of_track.len() as f64,
            track: seen,
        })
    });
    Reconstruction {
        points: points.collect(),
        rejected,
        reprojection_px: sums.iter().map(|(s, n)| (s / (*n).max(1) as f64).sqrt()).collect(),
        features: map.features.to_vec(),
        poses: map.poses,
        camera: map.camera,
    }
}

/// Mean encoded colour at the pixels of a track.
fn mean_colour(frames: &[Frame], seen: &[TrackedPixel]) -> [u8; 3] {
    let colour = |frame: &Frame, p: &Point2| {
        let at = |v: f64, n: usize| (v.round().max(0.0) as usize).min(n - 1);
        frame.rgb[at(p.y, frame.size[1]) * frame.size[0] + at(p.x, frame.size[0])]
    };
    let mut sum = [0.0; 3];
    for s in seen {
        let rgb = colour(&frames[s.frame], &s.pixel);
        (0..3).for_each(|c| sum[c] += rgb[c] as f64);
    }
    sum.map(|v| (v / seen.len().max(1) as f64).round() as u8)
}

/// Counts things done on several threads and reports them.
struct Counter<'a> {
    stage: SfmStage,
    total: usize,
    done: AtomicUsize,
    progress: Progress<'a>,
}

impl<'a> Counter<'a> {
    fn new(stage: SfmStage, total: usize, progress: Progress<'a>) -> Self {
        Self { stage, total, done: AtomicUsize::new(0), progress }
    }

    fn next(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.progress)(self.stage, done, self.total);
    }
}
