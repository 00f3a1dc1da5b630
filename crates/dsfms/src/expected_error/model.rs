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

/// Made by `cargo run --release --example expected_error -- 30` (gamma regression with a logarithmic link
/// on a seed that no other experiment uses, all distances to evidence at least 0.05); one row a model,
/// columns as [`super::NAMES`].
#[rustfmt::skip]
pub const WEIGHTS: [[f64; COUNT]; 4] = [
    [-6.253, 1.595, 0.011, 0.620, 0.000, 0.000, 0.050, 0.427, 0.000, 0.400, 0.000, 0.000, 0.000, 0.000, 0.654, 0.000, 0.000],
    [-7.450, 0.730, 0.039, 0.481, 0.136, 0.035, 0.061, 0.538, 0.000, 0.388, 0.525, 0.000, 0.750, 0.000, 0.980, 0.000, 0.304],
    [-6.689, 0.979, 0.311, 0.050, 0.123, 0.000, 0.092, 1.336, 0.000, 0.519, 0.000, 0.000, 0.449, 0.000, 0.256, 0.000, 0.043],
    [-6.576, 0.300, 0.218, 0.050, 0.050, 0.000, 0.198, 0.581, 1.824, 0.000, 0.000, 0.036, 0.887, 0.000, 0.473, 0.047, 0.000],
];
