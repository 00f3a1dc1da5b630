//! Why no surface came out.

use crate::options::OptionError;

/// Failures of multi-view stereo.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DenseError {
    /// Stereo needs two views.
    #[error("dense reconstruction needs at least 2 posed frames, found {found}")]
    TooFewFrames {
        /// Frames given.
        found: usize,
    },
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// Frame, camera and masks must have one size.
    #[error("frame `{frame}`: {what} is {found:?} px but the camera is {expected:?} px")]
    SizeMismatch {
        /// Name of the frame.
        frame: String,
        /// `image`, `valid mask` or `organ mask`.
        what: &'static str,
        /// Size found.
        found: [usize; 2],
        /// Size of the camera.
        expected: [usize; 2],
    },
    /// The lens cannot be turned into a pinhole.
    #[error(
        "frame `{frame}`: no sightline at the centre of the image; check the camera's intrinsics and distortion"
    )]
    NoSightline {
        /// Name of the frame.
        frame: String,
    },
    /// Nothing matched.
    #[error(
        "no depth was found in any of the {frames} frames: check poses and masks, or that the frames overlap and differ in viewpoint"
    )]
    NoDepth {
        /// Frames tried.
        frames: usize,
    },
    /// Depth was found, but not two frames' worth of surface.
    #[error(
        "the depth maps of {frames} frames hold no surface that enough of them agree on; lower `min_support` or add frames"
    )]
    NoSurface {
        /// Frames fused.
        frames: usize,
    },
}
