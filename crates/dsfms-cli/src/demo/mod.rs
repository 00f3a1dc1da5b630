//! The demonstration: embedded scene, comparison with its truth, report.

pub mod report;
pub mod scene;
mod scene_files;
pub mod truth;
