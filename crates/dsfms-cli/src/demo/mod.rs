//! The demonstration: embedded scene, comparison with its truth, report.

pub mod report;
pub mod scene;
mod scene_files;
pub mod truth;

use dsfms::pipeline::Method;

/// The methods compared, in the order of the report.
pub const METHODS: [Method; 5] =
    [Method::Rigid, Method::Sfs, Method::Dsfm, Method::Dsfms, Method::Joint];
