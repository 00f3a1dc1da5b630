//! The unknowns of a bundle adjustment, what was seen, and what is wrong with them.

use super::super::intrinsics::RefineIntrinsics;
use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3};
use crate::options::{OptionError, check, from_zero};
use crate::solver::Loss;

/// One sighting of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BundleObservation {
    /// Index of the view.
    pub view: usize,
    /// Index of the point.
    pub point: usize,
    /// Where it was seen, px.
    pub pixel: Point2,
    /// Standard deviation of `pixel`, px.
    pub sigma_px: f64,
}

/// The unknowns and what was seen; [`adjust`](super::adjust) changes the unknowns in place.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// Cameras, each of one view or of several.
    pub cameras: Vec<CameraModel>,
    /// About what the priors on the intrinsics of each camera are centred: the camera as it was
    /// given, not as an earlier adjustment left it, else repeated adjustments could drift away.
    pub priors: Vec<CameraModel>,
    /// Index of the camera of every view.
    pub camera_of: Vec<usize>,
    /// `camera_from_world` of every view.
    pub poses: Vec<Isometry>,
    /// Views whose pose is not changed.
    pub fixed: Vec<bool>,
    /// Points in world axes.
    pub points: Vec<Point3>,
    /// Sightings, in any order.
    pub observations: Vec<BundleObservation>,
}

/// Options of [`adjust`](super::adjust).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BundleOptions {
    /// Loss on the squared error in units of σ.
    pub loss: Loss,
    /// Largest number of linearisations.
    pub max_steps: usize,
    /// Stop when an accepted step lowers the cost by less than this fraction.
    pub cost_tolerance: f64,
    /// Intrinsics to refine.
    pub refine: RefineIntrinsics,
    /// Factor on the standard deviations of their priors, positive; infinite = no priors.
    pub prior_scale: f64,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self {
            loss: Loss::Huber(1.0),
            max_steps: 50,
            cost_tolerance: 1e-7,
            refine: RefineIntrinsics::default(),
            prior_scale: 1.0,
        }
    }
}

impl BundleOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[
            ("cost_tolerance", from_zero(&[self.cost_tolerance]), "0 or more"),
            ("prior_scale", self.prior_scale > 0.0, "positive, or inf for no priors"),
        ])
    }
}

/// Why there was nothing to adjust.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BundleError {
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// A view has no camera, or a camera no prior.
    #[error(
        "every view needs a camera and every camera a prior: {views} views name {named} of {cameras} cameras with {priors} priors"
    )]
    Cameras {
        /// Number of poses.
        views: usize,
        /// Cameras of views that exist.
        named: usize,
        /// Number of cameras.
        cameras: usize,
        /// Number of priors.
        priors: usize,
    },
    /// An index of an observation is out of range.
    #[error("observation {0} names view {1} and point {2}, which do not both exist")]
    Index(usize, usize, usize),
    /// A point has no projection at the start.
    #[error("{0} observations cannot be projected at the start (point behind the camera)")]
    Infeasible(usize),
    /// No free unknown is observed.
    #[error("nothing to adjust: no observations")]
    Empty,
    /// There is no covariance.
    #[error(
        "the sightings do not determine all poses and points; use more of them, from different places"
    )]
    Undetermined,
}
