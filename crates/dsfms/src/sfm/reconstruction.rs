//! What structure from motion returns, and how it fails.

use super::RefineIntrinsics;
use super::bundle::{
    Bundle, BundleError, BundleObservation, BundleOptions, Covariance, covariance,
};
use super::features::Features2d;
use super::map::sigma_of_scale;
use super::reconstruct::LAST_LOSS;
use crate::camera::{CameraError, CameraModel};
use crate::geometry::{Isometry, Point2, Point3};
use serde::{Deserialize, Serialize};

/// Where a scene point was seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackedPixel {
    /// Index of the frame.
    pub frame: usize,
    /// Index into the frame's features.
    pub feature: usize,
    /// Position, px.
    pub pixel: Point2,
}

/// A sparse point of the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScenePoint {
    /// Position in world axes.
    pub position: Point3,
    /// Mean encoded colour of its pixels.
    pub rgb: [u8; 3],
    /// Sightings, by frame; at least two.
    pub track: Vec<TrackedPixel>,
    /// Mean distance of the sightings from the projection, px.
    pub error_px: f64,
}

/// Frames that share points, and how many points they found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FoundModel {
    /// Indices of the frames, ascending.
    pub frames: Vec<usize>,
    /// Number of points.
    pub points: usize,
}

/// Camera poses and sparse points. The world has the axes of the first registered camera and,
/// unless poses were given, such a scale that the median depth is 50 units.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Reconstruction {
    /// `camera_from_world` per frame; `None` where it was rejected.
    pub poses: Vec<Option<Isometry>>,
    /// Index of each rejected frame and why.
    pub rejected: Vec<(usize, String)>,
    /// The models that the frames fell into, which share too few points to be one: first that of
    /// `poses` and `points`, the one of most frames, then those that were left out.
    pub models: Vec<FoundModel>,
    /// Points, in a fixed order.
    pub points: Vec<ScenePoint>,
    /// The camera, refined where the options ask for it.
    pub camera: CameraModel,
    /// Root mean square reprojection error of each frame, px; 0 where there are no sightings.
    pub reprojection_px: Vec<f64>,
    /// Features of every frame; not serialised.
    #[serde(skip)]
    pub features: Vec<Features2d>,
}

impl Reconstruction {
    /// Number of registered frames.
    pub fn registered(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    /// Number of sightings of all points.
    pub fn sightings(&self) -> usize {
        self.points.iter().map(|p| p.track.len()).sum()
    }

    /// Covariance of the poses of the registered frames, in their order, and of the points, as
    /// [`bundle::covariance`](super::bundle::covariance) defines them; lengths in the units of the poses.
    ///
    /// `refined`: the intrinsics that were refined.
    ///
    /// # Errors
    /// [`BundleError::Undetermined`] where the sightings are too few.
    pub fn covariance(&self, refined: RefineIntrinsics) -> Result<Covariance, BundleError> {
        let mut view_of = vec![usize::MAX; self.poses.len()];
        let registered = (0..self.poses.len()).filter(|&f| self.poses[f].is_some());
        registered.enumerate().for_each(|(view, frame)| view_of[frame] = view);
        let sighting = |point: usize, seen: &TrackedPixel| {
            let scale = self.features[seen.frame].scale[seen.feature] as f64;
            let (view, sigma_px) = (view_of[seen.frame], sigma_of_scale(scale));
            BundleObservation { view, point, pixel: seen.pixel, sigma_px }
        };
        let points = self.points.iter().enumerate();
        let poses: Vec<Isometry> = self.poses.iter().flatten().copied().collect();
        let bundle = Bundle {
            cameras: vec![self.camera.clone()],
            priors: vec![self.camera.clone()],
            camera_of: vec![0; poses.len()],
            fixed: vec![false; poses.len()],
            poses,
            observations: points
                .flat_map(|(i, p)| p.track.iter().map(move |seen| (i, seen)))
                .map(|(i, seen)| sighting(i, seen))
                .collect(),
            points: self.points.iter().map(|p| p.position).collect(),
        };
        let options = BundleOptions { loss: LAST_LOSS, refine: refined, ..Default::default() };
        covariance(&bundle, &options)
    }

    /// Mean reprojection error over all sightings, px.
    pub fn mean_reprojection_px(&self) -> f64 {
        let total: f64 = self.points.iter().map(|p| p.error_px * p.track.len() as f64).sum();
        total / self.sightings().max(1) as f64
    }
}

/// Why there is no reconstruction.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SfmError {
    /// Fewer than two frames.
    #[error("structure from motion needs at least 2 frames (8 or more are advised), found {0}")]
    TooFewFrames(usize),
    /// Slices of different lengths.
    #[error("{found} {what} for {frames} frames; give one per frame, or none")]
    Count {
        /// `masks` or `poses`.
        what: &'static str,
        /// Number given.
        found: usize,
        /// Number of frames.
        frames: usize,
    },
    /// A frame and the camera differ in size.
    #[error(
        "frame {frame}: {found:?} px, but the camera is for {expected:?} px; use frames and camera of one resolution"
    )]
    Size {
        /// Name of the frame.
        frame: String,
        /// Its size.
        found: [usize; 2],
        /// Size in the camera.
        expected: [usize; 2],
    },
    /// A mask and its frame differ in size.
    #[error("mask of frame {frame}: {found:?} px, but the frame has {expected:?} px")]
    MaskSize {
        /// Name of the frame.
        frame: String,
        /// Size of the mask.
        found: [usize; 2],
        /// Size of the frame.
        expected: [usize; 2],
    },
    /// The intrinsics make no sense.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Not enough frames with features.
    #[error(
        "only {usable} of {frames} frames can be used: {reasons}; check the exposure and the masks (white = valid), or lower contrast_threshold"
    )]
    TooFewFeatures {
        /// Frames with enough features.
        usable: usize,
        /// All frames.
        frames: usize,
        /// Frame names with their reasons.
        reasons: String,
    },
    /// No pair of frames starts a model.
    #[error(
        "no two frames see the same tissue from different places ({pairs} pairs match, the largest median parallax is {parallax_deg:.2}°, at least {needed_deg}° are needed); use frames in which the camera moves sideways"
    )]
    NoInitialPair {
        /// Verified pairs.
        pairs: usize,
        /// Largest median parallax of a pair, degrees.
        parallax_deg: f64,
        /// Smallest parallax accepted.
        needed_deg: f64,
    },
    /// An option is out of range.
    #[error("option {field} must be {bound}")]
    Option {
        /// Field of [`SfmOptions`](super::SfmOptions).
        field: &'static str,
        /// What it must be.
        bound: &'static str,
    },
}
