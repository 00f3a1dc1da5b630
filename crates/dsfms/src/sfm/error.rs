//! Why there is no reconstruction.

use crate::camera::CameraError;
use crate::options::OptionError;

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
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
}
