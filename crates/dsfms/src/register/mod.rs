//! DSfM: from one image of the deformed organ and a few matches to a coarse shape (paper §6, eq.
//! 3).
//!
//! [`pose()`] places the rest shape rigidly, [`register`] deforms it. Every energy is normalised by
//! noise and by the **visible** area, so one set of weights serves any organ, mesh resolution and
//! unit.

mod at_rest;
mod coarse;
pub mod control;
pub mod find;
mod fineness;
mod objective;
pub mod options;
pub mod pose;
mod printed;
pub mod scene;
pub mod solve;
mod starts;
mod terms;
pub mod volume;

use crate::geometry::Point2;
use crate::options::OptionError;
pub use at_rest::{KnownPoses, posed_from};
pub use coarse::RegisterMemory;
pub use control::{Body, Deformable};
pub use options::{CameraMotion, Prior, PriorWeights, RegisterOptions};
pub use pose::{Posed, pose, pose_near};
pub use printed::register_printed;
pub use scene::Scene;
pub use solve::{Registered, register_in, register_near};
pub use starts::register;
pub use volume::Volume;

/// A correspondence between a template point and a pixel of the deformed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// 0-based face of the template.
    pub face: u32,
    /// Barycentrics on that face.
    pub barycentric: [f64; 3],
    /// Position in the frame, px.
    pub pixel: Point2,
}

/// Why a frame cannot be registered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// Fewer matches than a pose needs.
    #[error(
        "{found} usable matches, at least {needed} are needed; give more, or check that the frame shows \
         the organ"
    )]
    TooFewMatches {
        /// Matches left after checks.
        found: usize,
        /// Minimum.
        needed: usize,
    },
    /// A rigid pose explains too few of the matches.
    #[error(
        "no pose of the template explains the matches ({inliers} of {found} agree); check the \
         camera file, that the matches belong to this template, and that the frame shows the organ"
    )]
    NoPose {
        /// Agreeing matches.
        inliers: usize,
        /// All matches.
        found: usize,
    },
    /// The camera is said to be at rest, and stands in none of the views.
    #[error(
        "the camera is said to be at rest, but of the {views} views of the template none has more than {agree} of the {found} \
         matches where the organ at rest is; let it move (camera_motion), or pose a frame of this camera"
    )]
    NoView {
        /// Agreeing matches of the nearest view.
        agree: usize,
        /// All matches.
        found: usize,
        /// Views of the template.
        views: usize,
    },
}
