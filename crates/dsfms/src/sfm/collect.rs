//! From the growing map to the value the stage returns.

use super::map::Map;
use super::reconstruction::{FoundModel, NoPose, ScenePoint, SparseReconstruction, TrackedPixel};
use crate::geometry::Point2;
use crate::image::Frame;

/// World axes of the first registered camera, median depth 50.
pub(super) fn normalise(map: &mut Map, first: usize) {
    /// About the mm at which a laparoscope looks, so that lengths read alike with and without a
    /// scale.
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

/// The reconstruction as the stage returns it; `others`: models that were left out.
pub(super) fn collect(
    map: Map,
    frames: &[Frame],
    rejected: Vec<(usize, NoPose)>,
    others: Vec<FoundModel>,
) -> SparseReconstruction {
    let models = std::iter::once(map.summary()).chain(others).collect();
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
    SparseReconstruction {
        points: points.collect(),
        rejected,
        models,
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
