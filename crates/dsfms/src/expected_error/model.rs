//! The fitted weights.

use super::features::COUNT;

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

    /// Whether brightness shapes the surface.
    pub(super) fn reads_shading(self) -> bool {
        matches!(self, Self::Shading | Self::Joint)
    }

    /// Nine errors of ten are below this multiple of the expected one, and so is the zone of nine
    /// frames of ten: the root mean square over what is seen and moved by at least half of what
    /// moved most.
    pub fn bound(self) -> f64 {
        BOUNDS[self as usize]
    }
}

/// Largest `w · f`, the logarithm of 0.7: one vertex in 450 of the fitted cases is farther off than
/// 0.7 visible radii by eq. 3 or eq. 4, and none by joint, so beyond that a prediction says no more
/// than "lost".
pub const LARGEST: f64 = -0.35;

/// How much farther off a grey frame is than a coloured one of the same features: joint's zones of
/// grey versions of the frames of six choosing scenes are 1.8 times as far off as stated in the
/// median (`docs/results/exposure.md`).
pub(super) const GREY: f64 = 2.0;

/// The multiple of the expected error that nine errors of ten of the fitted cases are below, or
/// nine zones of ten where that is larger: errors of a zone go together. In the order of
/// [`WEIGHTS`].
const BOUNDS: [f64; 4] = [2.90, 2.44, 2.16, 2.18];

/// Made by the study `expected_error` on 30 synthetic cases, clips, and the choosing half and drawn
/// ones of the generated scenes (`docs/results/expected_error.md`): gamma regression with a
/// logarithmic link and a level of its own for every case, in which the zone counts as much as all
/// of it, all distances to evidence at least 0.05; one row a model, columns as [`super::NAMES`].
#[rustfmt::skip]
pub const WEIGHTS: [[f64; COUNT]; 4] = [
    [-5.859, 1.358, 0.000, 0.591, 0.000, 0.000, 0.050, 0.698, 1.317, 0.815, 0.000, 0.000, 0.000, 0.000, 0.115, 0.000, 0.000],
    [-6.935, 0.907, 0.000, 0.415, 0.050, 0.158, 0.050, 0.543, 0.005, 0.704, 0.278, 0.000, 0.945, 0.000, 0.469, 0.000, 0.541],
    [-6.382, 0.169, 0.172, 0.050, 0.240, 0.171, 0.050, 0.408, 0.508, 0.953, 0.000, 0.035, 0.565, 0.000, 0.335, 0.270, 0.000],
    [-7.253, 0.869, 0.209, 0.085, 0.285, 0.000, 0.050, 0.000, 0.749, 0.986, 0.244, 0.000, 0.415, 0.000, 0.303, 0.659, 0.529],
];
