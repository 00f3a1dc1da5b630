//! DSfM: from one image of the deformed organ and a few matches to a coarse shape (paper §6, eq.
//! 3).
//!
//! [`pose()`] places the rest shape rigidly, [`register`] deforms it. Every energy is normalised by
//! noise and by the **visible** area, so one set of weights serves any organ, mesh resolution and
//! unit.

mod at_rest;
mod coarse;
pub mod control;
mod correspondence;
mod error;
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

pub use at_rest::{KnownPoses, posed_from};
pub use coarse::RegisterMemory;
pub use control::{Body, Deformable};
pub use correspondence::Match;
pub use error::RegisterError;
pub use options::{CameraMotion, Prior, PriorWeights, RegisterOptions};
pub use pose::{Posed, pose, pose_near};
pub use printed::register_printed;
pub use scene::Scene;
pub use solve::{Registered, register_in, register_near};
pub use starts::register;
pub use volume::Volume;
