//! Options of the light's estimation.

use super::super::photometric::{ObservationBounds, VALID_BOUNDS};
use crate::light::Coat;
use crate::light::coat::{PLAUSIBLE, WET_TISSUE};
use crate::options::{OptionError, check, positive};
use serde::{Deserialize, Serialize};

/// Options of [`super::fit_light`]. Other values than the defaults are not measured; what they
/// reach is in `docs/results/template.md` (albedo).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightFitOptions {
    /// Which observations count.
    pub bounds: ObservationBounds,
    /// Rounds of one-ring averaging of the vertex normals.
    pub normal_smoothing: usize,
    /// Number of surface spots tried, at least 100.
    pub spots: usize,
    /// Prior standard deviation of a frame's log gain; small where the exposure is fixed.
    pub gain_sigma: f64,
    /// Whether light reflected from all around is estimated too.
    pub ambient: bool,
    /// Prior standard deviation of the light's offset from its initial place, relative to the
    /// median distance of the surface.
    pub offset_sigma: f64,
    /// Refractive index of the wet film on the organ, at least 1 (1 = Lambert without a film);
    /// default that of wet tissue.
    pub refractive_index: f64,
    /// Vignetting of the lens.
    pub vignetting: Vignetting,
}

/// What is known of the vignetting `1 + a r²`, r in focal lengths from the principal point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Vignetting {
    /// `a`, e.g. of a picture of an evenly lit wall; 0 = none.
    Known(f64),
    /// Nothing: every light is tried without it and with an `a` of its own.
    Estimated,
}

impl Default for Vignetting {
    fn default() -> Self {
        Self::Known(0.0)
    }
}

impl Default for LightFitOptions {
    fn default() -> Self {
        Self {
            bounds: ObservationBounds::default(),
            normal_smoothing: 1,
            spots: 3000,
            gain_sigma: 0.3,
            ambient: true,
            offset_sigma: 0.1,
            refractive_index: WET_TISSUE,
            vignetting: Vignetting::default(),
        }
    }
}

impl LightFitOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let vignetting = match self.vignetting {
            Vignetting::Known(a) => a,
            Vignetting::Estimated => 0.0,
        };
        let coat = Coat { refractive_index: self.refractive_index, ambient: 0.0, vignetting };
        check(&[
            ("light.bounds", self.bounds.are_valid(), VALID_BOUNDS),
            ("light.spots", self.spots >= 100, "at least 100"),
            (
                "light.gain_sigma, offset_sigma",
                positive(&[self.gain_sigma, self.offset_sigma]),
                "positive",
            ),
            ("light.refractive_index, vignetting", coat.is_plausible(), PLAUSIBLE),
        ])
    }
}
