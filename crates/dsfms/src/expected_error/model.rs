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

    /// Nine errors of ten are below this multiple of the expected one, and so is the zone of nine
    /// frames of ten: the root mean square over what is seen and moved by at least half of what
    /// moved most.
    pub fn bound(self) -> f64 {
        BOUNDS[self as usize]
    }
}

/// Largest `w · f`, the logarithm of 0.7: no vertex of the fitted cases was further off than 0.71
/// visible radii, so beyond that a prediction says no more than "lost".
pub const LARGEST: f64 = -0.35;

/// The multiple of the expected error that nine errors of ten of the fitted cases are below, or
/// nine zones of ten where that is larger: errors of a zone go together. In the order of
/// [`WEIGHTS`].
const BOUNDS: [f64; 4] = [3.21, 2.78, 2.21, 2.27];

/// Made by the study `expected_error` on 30 synthetic cases and the choosing half of the generated
/// scenes (`docs/results/expected_error.md`): gamma regression with a logarithmic link and a level
/// of its own for every case, in which the zone counts as much as all of it, all distances to
/// evidence at least 0.05; one row a model, columns as [`super::NAMES`].
#[rustfmt::skip]
pub const WEIGHTS: [[f64; COUNT]; 4] = [
    [-5.599, 1.010, 0.110, 0.321, 0.000, 0.000, 0.050, 0.659, 1.561, 0.194, 0.000, 0.000, 0.000, 0.000, 0.364, 0.000, 0.000],
    [-7.107, 0.802, 0.079, 0.295, 0.050, 0.123, 0.050, 0.518, 0.095, 0.057, 0.258, 0.000, 1.331, 0.000, 0.455, 0.000, 0.213],
    [-6.655, 0.569, 0.179, 0.175, 0.154, 0.151, 0.050, 0.422, 0.798, 0.557, 0.138, 0.000, 0.286, 0.000, 0.213, 0.107, 0.062],
    [-7.189, 1.035, 0.149, 0.123, 0.333, 0.000, 0.050, 0.056, 0.685, 0.711, 0.179, 0.061, 0.579, 0.000, 0.212, 0.239, 0.401],
];
