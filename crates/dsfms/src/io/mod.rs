//! Files in and out: frames, masks, cameras, poses, matches.

pub mod camera;
pub mod error;
pub mod images;
pub mod masks;
pub mod matches;
pub mod names;
pub mod poses;
mod yaml;

pub use error::InputError;
