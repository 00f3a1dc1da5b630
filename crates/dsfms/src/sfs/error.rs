//! Why there is no depth map.

use crate::options::OptionError;

/// Why there is no depth map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SfsError {
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// Frame, masks and camera differ.
    #[error(
        "the frame or a mask is {found:?} px but the camera says {expected:?}; use the camera of this resolution"
    )]
    SizeMismatch {
        /// Size of the frame or mask.
        found: [usize; 2],
        /// Size in the camera.
        expected: [usize; 2],
    },
    /// Nothing to solve.
    #[error(
        "only {found} nodes of the depth map see the organ, at least {needed} are needed; check the pose and the masks"
    )]
    TooSmall {
        /// Usable nodes.
        found: usize,
        /// Fewest that make sense.
        needed: usize,
    },
}
