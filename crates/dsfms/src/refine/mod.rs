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
mod look;
pub mod mirror;
pub mod objective;
pub mod options;
mod samples;
pub mod video;

pub use asked::Comparison;
pub use evidence::{Evidence, Photograph};
pub use joint::{Joined, JointOptions, join};
pub use objective::{Refined, refine};
pub use options::RefineOptions;
pub use video::{Carried, Near, NearFrame, VideoMemory, VideoOptions, join_near};
