//! Pictures beside the results: calibration, flattening, texture, albedo.

pub mod calibration;
pub mod organ;
pub mod plot;
pub mod preoperative;
pub mod template;
pub mod text;
