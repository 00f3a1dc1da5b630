//! Why template building fails.

use crate::dense::DenseError;
use crate::geometry::Point2;
use crate::mesh::remesh::RemeshError;
use crate::options::OptionError;
use crate::sfm::SfmError;
use crate::template::albedo::AlbedoError;

/// Why there is no template.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TemplateError {
    /// A field of the options out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// No given pose belongs to a frame.
    #[error(
        "none of the {frames} frames has a pose in the pose file; poses are matched to frames by file name or number"
    )]
    NoPoses {
        /// Frames given.
        frames: usize,
    },
    /// Known poses of too few frames to see depth.
    #[error(
        "{found} of the {frames} frames have a pose in the pose file, at least 2 are needed without a mesh; poses are matched to frames by file name or number"
    )]
    TooFewPoses {
        /// Frames with a pose.
        found: usize,
        /// Frames given.
        frames: usize,
    },
    /// Known poses that nothing in the frames agrees with.
    #[error(
        "no point of the {frames} frames agrees with the given poses and camera; expected camera_from_world (x right, y down, z forward) of these very frames; where none are given they are estimated"
    )]
    NoPoints {
        /// Frames with a pose.
        frames: usize,
    },
    /// Structure from motion failed.
    #[error("structure from motion: {0}")]
    Sfm(#[from] SfmError),
    /// Multi-view stereo failed.
    #[error("multi-view stereo: {0}")]
    Dense(#[from] DenseError),
    /// The stereo surface could not be remeshed.
    #[error("remeshing: {0}")]
    Remesh(#[from] RemeshError),
    /// The outlined frame has no pose.
    #[error(
        "the organ is outlined on frame {frame:?}, which is not registered; outline another frame"
    )]
    OutlineFrame {
        /// Name of the frame.
        frame: String,
    },
    /// The clicked pixel shows no surface.
    #[error(
        "pixel {:.1},{:.1} of frame {frame:?} shows no reconstructed surface; click the organ on another place or frame",
        pixel.x, pixel.y
    )]
    ClickBeside {
        /// Name of the frame.
        frame: String,
        /// The pixel.
        pixel: Point2,
    },
    /// The surface fills too little of the outlines: the organ was not reconstructed.
    #[error(
        "one connected surface fills only {percent:.0} % of the organ's outline; outline a frame that shows the organ whole, or give organ masks of all frames"
    )]
    EmptyOutline {
        /// Share of the outlines that it fills, per cent.
        percent: f64,
    },
    /// Nothing to measure the albedo in.
    #[error("albedo: {0}")]
    Albedo(#[from] AlbedoError),
}
