//! What structure from motion returns.

use super::RefineIntrinsics;
use super::bundle::{
    Bundle, BundleError, BundleObservation, BundleOptions, Covariance, covariance,
};
use super::features::{Features2d, sigma_of_scale};
use super::options::LAST_LOSS;
use crate::camera::CameraModel;
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

/// Why a frame has no pose.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[non_exhaustive]
pub enum NoPose {
    /// Nothing is to be seen.
    #[error("the frame is black (brightest value {brightest} of 255)")]
    Black {
        /// Of its three channels.
        brightest: u8,
    },
    /// Nothing to find it by.
    #[error("{found} features inside the valid area, at least {needed} are needed")]
    FewFeatures {
        /// Features.
        found: usize,
        /// Fewest of a usable frame.
        needed: usize,
    },
    /// Poses are known, and its own is not among them.
    #[error("no pose was given for it")]
    NotGiven,
    /// It is of another model than the largest.
    #[error(
        "it belongs to a separate model of {frames} frames that shares too few points with the largest"
    )]
    OtherModel {
        /// Frames of that model.
        frames: usize,
    },
    /// No other frame shows the same.
    #[error("no other frame matches it")]
    Unmatched,
    /// Its matches agree on no pose.
    #[error("{matching} frames match it, but too few reconstructed points agree on a pose")]
    Disagreement {
        /// Frames that match it.
        matching: usize,
    },
}

/// Camera poses and sparse points. The world has the axes of the first registered camera and,
/// unless poses were given, such a scale that the median depth is 50 units.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SparseReconstruction {
    /// `camera_from_world` per frame; `None` where it was rejected.
    pub poses: Vec<Option<Isometry>>,
    /// Index of each rejected frame and why.
    pub rejected: Vec<(usize, NoPose)>,
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

impl SparseReconstruction {
    /// Number of registered frames.
    pub fn registered(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    /// Number of sightings of all points.
    pub fn sightings(&self) -> usize {
        self.points.iter().map(|p| p.track.len()).sum()
    }

    /// Covariance of the poses of the registered frames, in their order, and of the points, as
    /// [`bundle::covariance`](super::bundle::covariance) defines them; lengths in the units of the
    /// poses.
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
