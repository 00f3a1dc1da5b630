//! Pictures beside the results: calibration, flattening, texture, albedo.

pub mod calibration;
pub mod measured;
pub mod organ;
pub mod preoperative;
pub mod template;

/// Size of the letters, px.
const TEXT: f64 = 15.0;
