//! Why there is no registration.

use crate::options::OptionError;

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
