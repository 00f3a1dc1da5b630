//! DSfMS: shading and specularities refine the coarse shape (paper §7, eq. 4).

mod contour;
mod cues;
mod depth_prior;
pub mod evidence;
mod field;
mod gain;
mod glare;
pub mod joint;
mod joint_objective;
pub mod joint_options;
mod look;
pub mod mirror;
mod near_frame;
mod objective;
mod occluders;
pub mod options;
mod photograph;
mod photometric_model;
mod printed;
mod samples;
mod solve;
mod support;
pub mod video;

pub(crate) use contour::outline_distance;
pub use evidence::ShadingEvidence;
pub use gain::AtMatches;
pub use joint::{Joined, join};
pub use joint_options::{ExposureUnknown, JointOptions};
pub use near_frame::NearFrame;
pub use options::RefineOptions;
pub use photograph::Photograph;
pub use photometric_model::PhotometricModel;
pub use printed::refine_printed;
pub use solve::{Refined, refine};
pub use support::Comparison;
pub use video::{Near, VideoMemory, VideoOptions, join_near};
