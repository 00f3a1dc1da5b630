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

    /// Nine errors of ten are below this multiple of the expected one, and so is the zone of nine frames of ten:
    /// the root mean square over what is seen and moved by at least half of what moved most.
    pub fn bound(self) -> f64 {
        BOUNDS[self as usize]
    }
}

/// Largest `w · f`, the logarithm of 0.7: no vertex of the fitted cases was further off than 0.71
/// visible radii, so beyond that a prediction says no more than "lost".
pub const LARGEST: f64 = -0.35;

/// The multiple of the expected error that nine errors of ten of the fitted cases are below, or nine zones of ten
/// where that is larger: errors of a zone go together. In the order of [`WEIGHTS`].
const BOUNDS: [f64; 4] = [3.16, 2.78, 2.16, 2.19];

/// Made by the study `expected_error` on 30 synthetic cases and the choosing half of the generated scenes
/// (`docs/results/expected_error.md`): gamma regression with a logarithmic link and a level of its own for every
/// case, in which the zone counts as much as all of it, all distances to evidence at least 0.05; one row a model,
/// columns as [`super::NAMES`].
#[rustfmt::skip]
pub const WEIGHTS: [[f64; COUNT]; 4] = [
    [-5.619, 1.007, 0.113, 0.350, 0.000, 0.000, 0.050, 0.648, 1.575, 0.234, 0.000, 0.000, 0.000, 0.000, 0.338, 0.000, 0.000],
    [-7.112, 0.792, 0.073, 0.315, 0.050, 0.133, 0.050, 0.514, 0.114, 0.082, 0.247, 0.000, 1.331, 0.000, 0.442, 0.000, 0.211],
    [-6.586, 0.531, 0.191, 0.180, 0.207, 0.136, 0.050, 0.428, 0.934, 0.554, 0.126, 0.000, 0.080, 0.000, 0.293, 0.088, 0.049],
    [-7.220, 1.041, 0.197, 0.211, 0.310, 0.108, 0.050, 0.131, 0.690, 0.664, 0.217, 0.000, 0.800, 0.000, 0.134, 0.414, 0.035],
];
