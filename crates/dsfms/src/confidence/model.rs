//! The fitted weights.

use super::COUNT;

/// Which weights apply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Eq. 3 on a template without albedo.
    Motion,
    /// Eq. 3 on a template with albedo, which the image is compared with afterwards.
    MotionSeen,
    /// Eq. 4.
    Shading,
    /// The joint solve.
    Joint,
}

impl Model {
    /// All, in the order of [`WEIGHTS`].
    pub const ALL: [Self; 4] = [Self::Motion, Self::MotionSeen, Self::Shading, Self::Joint];

    /// `w` of every feature; all but the first, the constant, are at least 0.
    pub fn weights(self) -> &'static [f64; COUNT] {
        &WEIGHTS[self as usize]
    }
}

/// Largest `w · f`, the logarithm of 0.17: no vertex of the fitted cases was further off than 0.17
/// visible radii, so beyond that a prediction says no more than "lost".
pub const LARGEST: f64 = -1.772;

/// Made by `cargo run --release --example confidence -- 30` (gamma regression with a logarithmic link
/// on a seed that no other experiment uses, all distances to evidence at least 0.05); one row a model,
/// columns as [`super::NAMES`].
#[rustfmt::skip]
pub const WEIGHTS: [[f64; COUNT]; 4] = [
    [-6.253, 1.595, 0.011, 0.620, 0.000, 0.000, 0.050, 0.427, 0.000, 0.400, 0.000, 0.000, 0.000, 0.000, 0.654, 0.000, 0.000],
    [-7.412, 0.715, 0.043, 0.494, 0.120, 0.000, 0.050, 0.554, 0.000, 0.418, 0.455, 0.000, 0.805, 0.000, 0.897, 0.000, 0.247],
    [-6.679, 1.083, 0.045, 0.207, 0.167, 0.000, 0.076, 1.508, 0.000, 0.533, 0.076, 0.000, 0.401, 0.000, 0.357, 0.000, 0.010],
    [-6.473, 0.229, 0.285, 0.050, 0.050, 0.000, 0.216, 0.820, 1.775, 0.000, 0.000, 0.008, 0.485, 0.000, 0.587, 0.000, 0.042],
];
