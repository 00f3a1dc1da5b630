//! What the stages decided and with which figures, for a log (`tracing`); nothing is measured for
//! it alone.

use super::{Progress, Reconstruction, StageReport};
use crate::dense::{DepthMap, PosedFrame};
use crate::geometry::median;
use crate::image::Frame;
use crate::sfm::{self, SfmOptions};
use crate::template::light_fit::LightFit;
use tracing::{debug, info};

/// Frames registered and left out, with the thresholds they met.
pub(super) fn sparse(
    frames: &[Frame],
    found: &sfm::SparseReconstruction,
    options: &SfmOptions,
    progress: &dyn Progress,
) {
    progress.note(&format!(
        "{} of {} frames registered; fx {:.1} px; {} points; {:.2} px error",
        found.registered(),
        frames.len(),
        found.camera.focal[0],
        found.points.len(),
        found.mean_reprojection_px()
    ));
    info!(
        frames = frames.len(),
        registered = found.registered(),
        points = found.points.len(),
        sightings = found.sightings(),
        error_px = found.mean_reprojection_px(),
        focal_px = found.camera.focal[0],
        max_reprojection_px = options.max_reprojection_px,
        "camera poses"
    );
    for (frame, why) in &found.rejected {
        info!(frame = %frames[*frame].name, %why, "frame left out");
    }
    for (i, model) in found.models.iter().enumerate() {
        info!(frames = model.frames.len(), points = model.points, kept = i == 0, "model");
    }
    for (i, frame) in frames.iter().enumerate().filter(|(i, _)| found.poses[*i].is_some()) {
        let features = found.features[i].len();
        debug!(frame = %frame.name, features, error_px = found.reprojection_px[i], "frame registered");
    }
}

/// Which of the registered frames get depth maps.
pub(super) fn views(views: &[PosedFrame], registered: usize, max_frames: usize) {
    info!(frames = views.len(), registered, max_frames, "frames for stereo");
    for view in views {
        debug!(frame = %view.frame.name, masked = view.organ.is_some(), "frame for stereo");
    }
}

/// How much of each grid has depth, and how well it is known.
pub(super) fn maps(views: &[PosedFrame], maps: &[DepthMap], progress: &dyn Progress) {
    let mut filled = Vec::new();
    for (view, map) in views.iter().zip(maps) {
        let mut sigma: Vec<f64> =
            map.sigma.iter().filter(|s| s.is_finite()).map(|s| f64::from(*s)).collect();
        filled.push(sigma.len() as f64 / map.depth.len().max(1) as f64);
        let [width, height] = map.camera.size;
        let (share, sigma) = (filled[filled.len() - 1], median(&mut sigma));
        debug!(frame = %view.frame.name, width, height, share, sigma, "depth map");
    }
    let share = median(&mut filled).unwrap_or_default();
    info!(maps = maps.len(), median_share = share, "depth maps");
    progress.note(&format!(
        "{} depth maps, {:.0} % of their pixels filled",
        maps.len(),
        100.0 * share
    ));
}

/// The light chosen, and what else was tried.
pub(super) fn light(fit: &LightFit, progress: &dyn Progress) {
    let [spots, observations] = fit.observations;
    info!(
        light = ?fit.light,
        ambient = fit.ambient,
        vignetting = fit.vignetting,
        residual = fit.relative_residual,
        spots,
        observations,
        "light"
    );
    if let Some(best) = fit.candidates.first() {
        let residual = 100.0 * fit.relative_residual;
        progress.note(&format!("light: {}, {residual:.1} % residual at {spots} spots", best.name));
    }
    for candidate in &fit.candidates {
        debug!(?candidate, "light tried");
    }
}

/// Matches, stages and verdict of one frame.
pub(super) fn reconstruction(frame: &Frame, result: &Reconstruction) {
    for stage in &result.stages {
        self::stage(frame, stage);
    }
    let kept = result.matches.iter().filter(|m| m.1).count();
    info!(
        frame = %frame.name,
        matches = result.matches.len(),
        kept,
        gain = result.gain,
        verdict = result.verdict.level.label(),
        seconds = result.stages.iter().map(|s| s.seconds).sum::<f64>(),
        "surface"
    );
    for reason in &result.verdict.reasons {
        info!(frame = %frame.name, %reason, "doubt");
    }
    debug!(frame = %frame.name, evidence = ?result.evidence, "evidence");
}

/// What share of an outline found by colour is known.
pub(super) fn outline(frame: &Frame, marked: f64) {
    info!(frame = %frame.name, marked, "outline by colour");
}

fn stage(frame: &Frame, stage: &StageReport) {
    let (name, seconds) = (&stage.name, stage.seconds);
    let Some(summary) = &stage.summary else {
        debug!(frame = %frame.name, stage = %name, seconds, "stage");
        return;
    };
    let (before, after) = summary.cost();
    let (steps, refused, stop) = (summary.iterations, summary.refused, &summary.stop);
    debug!(frame = %frame.name, stage = %name, seconds, before, after, steps, refused, ?stop, "solve");
}
