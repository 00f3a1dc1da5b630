//! DSfMS: shading and specularities refine the coarse shape (paper §7, eq. 4).

mod asked;
mod contour;
mod cues;
pub mod evidence;
mod field;
mod foreign;
mod gain;
mod glare;
mod hold;
pub mod joint;
mod joint_objective;
pub mod joint_options;
mod look;
pub mod mirror;
mod objective;
pub mod options;
mod photometric_model;
mod printed;
mod samples;
mod solve;
pub mod video;

pub use asked::Comparison;
pub use evidence::{Evidence, Photograph};
pub use gain::AtMatches;
pub use joint::{Joined, join};
pub use joint_options::{ExposureUnknown, JointOptions};
pub use options::RefineOptions;
pub use photometric_model::PhotometricModel;
pub use printed::refine_printed;
pub use solve::{Refined, refine};
pub use video::{Carried, Near, NearFrame, VideoMemory, VideoOptions, join_near};
