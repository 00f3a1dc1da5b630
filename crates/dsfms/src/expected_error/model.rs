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

    /// Nine errors of ten are below this multiple of the expected one.
    pub fn bound(self) -> f64 {
        BOUNDS[self as usize]
    }
}

/// Largest `w · f`, the logarithm of 0.7: no vertex of the fitted cases was further off than 0.71
/// visible radii, so beyond that a prediction says no more than "lost".
pub const LARGEST: f64 = -0.35;

/// Nine errors of ten of the fitted cases are below this multiple of the expected one; in the order of
/// [`WEIGHTS`].
const BOUNDS: [f64; 4] = [3.24, 2.84, 2.22, 2.00];

/// Made by the study `expected_error` on 30 synthetic cases and the choosing half of the generated scenes
/// (`docs/results/expected_error.md`): gamma regression with a logarithmic link and a level of its own for every
/// case, all distances to evidence at least 0.05; one row a model, columns as [`super::NAMES`].
#[rustfmt::skip]
pub const WEIGHTS: [[f64; COUNT]; 4] = [
    [-5.670, 0.571, 0.046, 0.332, 0.000, 0.000, 0.050, 0.935, 2.110, 0.189, 0.000, 0.000, 0.000, 0.000, 0.278, 0.000, 0.000],
    [-7.121, 0.258, 0.001, 0.281, 0.050, 0.193, 0.050, 0.868, 0.564, 0.066, 0.217, 0.000, 1.336, 0.000, 0.411, 0.000, 0.231],
    [-6.703, 0.489, 0.280, 0.137, 0.147, 0.120, 0.050, 0.470, 1.012, 0.548, 0.000, 0.080, 0.077, 0.000, 0.285, 0.116, 0.128],
    [-7.382, 1.127, 0.325, 0.183, 0.227, 0.119, 0.050, 0.230, 0.873, 0.523, 0.000, 0.105, 0.574, 0.000, 0.311, 0.335, 0.161],
];
