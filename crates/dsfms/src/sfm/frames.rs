//! The frames as they come in: checks, features, what cannot be used, and progress.

use super::SfmOptions;
use super::error::SfmError;
use super::features::{Features2d, detect};
use super::reconstruction::NoPose;
use crate::camera::CameraModel;
use crate::image::{Frame, Mask, viewport};
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
    /// Neighbouring frames between which corners were followed by optical flow.
    OpticalFlow,
}

/// Receives the stage, the number of things done and of all things; may be called from any thread.
pub type SfmProgress<'a> = &'a (dyn Fn(SfmStage, usize, usize) + Sync);

/// Fewest features of a usable frame.
const MIN_FEATURES: usize = 30;

/// Check sizes, counts, camera and options.
pub(super) fn check_input(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    options: &SfmOptions,
) -> Result<(), SfmError> {
    options.validate()?;
    if frames.len() < 2 {
        return Err(SfmError::TooFewFrames(frames.len()));
    }
    check_sizes(frames, masks, camera)
}

/// Check the camera, that frames and masks are of its size, and that there is a mask for each frame
/// or none at all.
pub(crate) fn check_sizes(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
) -> Result<(), SfmError> {
    if !masks.is_empty() && masks.len() != frames.len() {
        return Err(SfmError::Count { what: "masks", found: masks.len(), frames: frames.len() });
    }
    camera.validate()?;
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

/// Where frames may be looked at: inside their masks and the viewport.
pub(super) struct ValidAreas<'a> {
    masks: &'a [Option<Mask>],
    lit: Option<Mask>,
}

impl<'a> ValidAreas<'a> {
    pub(super) fn new(frames: &[Frame], masks: &'a [Option<Mask>], options: &SfmOptions) -> Self {
        /// The blurred rim gives strong keypoints that move with the camera.
        const RIM_PX: f64 = 8.0;
        let lit = if options.find_viewport { viewport(frames) } else { None };
        Self { masks, lit: lit.map(|m| m.erode(RIM_PX)) }
    }

    /// That of a frame; `None` = everywhere.
    pub(super) fn of(&self, frame: usize) -> Option<Mask> {
        match (self.masks.get(frame).and_then(Option::as_ref), &self.lit) {
            (Some(own), Some(lit)) => Some(own.and(lit)),
            (own, lit) => own.or(lit.as_ref()).cloned(),
        }
    }
}

/// Features of every frame inside its valid area.
pub(super) fn detect_all(
    frames: &[Frame],
    areas: &ValidAreas,
    options: &SfmOptions,
    progress: SfmProgress,
) -> Vec<Features2d> {
    let count = Counter::new(SfmStage::Features, frames.len(), progress);
    let one = |(i, frame): (usize, &Frame)| {
        let features = detect(frame, areas.of(i).as_ref(), options);
        count.next();
        features
    };
    frames.par_iter().enumerate().with_max_len(1).map(one).collect()
}

/// Frames with too few features, and why.
pub(super) fn unusable(frames: &[Frame], features: &[Features2d]) -> Vec<(usize, NoPose)> {
    let reason = |(i, f): (usize, &Features2d)| {
        (f.len() < MIN_FEATURES).then(|| {
            let brightest = frames[i].rgb.iter().flatten().max().copied().unwrap_or(0);
            let why = match brightest < 16 {
                true => NoPose::Black { brightest },
                false => NoPose::FewFeatures { found: f.len(), needed: MIN_FEATURES },
            };
            (i, why)
        })
    };
    features.iter().enumerate().filter_map(reason).collect()
}

/// At least two frames must have features.
pub(super) fn check_usable(frames: &[Frame], rejected: &[(usize, NoPose)]) -> Result<(), SfmError> {
    let usable = frames.len() - rejected.len();
    if usable >= 2 {
        return Ok(());
    }
    let reasons: Vec<String> =
        rejected.iter().take(5).map(|(i, why)| format!("{}: {why}", frames[*i].name)).collect();
    Err(SfmError::TooFewFeatures { usable, frames: frames.len(), reasons: reasons.join("; ") })
}

/// Counts things done on several threads and reports them.
pub(super) struct Counter<'a> {
    stage: SfmStage,
    total: usize,
    done: AtomicUsize,
    progress: SfmProgress<'a>,
}

impl<'a> Counter<'a> {
    pub(super) fn new(stage: SfmStage, total: usize, progress: SfmProgress<'a>) -> Self {
        Self { stage, total, done: AtomicUsize::new(0), progress }
    }

    pub(super) fn next(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        (self.progress)(self.stage, done, self.total);
    }
}
