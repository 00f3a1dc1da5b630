//! Options of the albedo.

use super::combine::Combine;
use super::photometric::{ObservationBounds, VALID_BOUNDS};
use crate::light::Coat;
use crate::light::coat::{PLAUSIBLE, WET_TISSUE};
use crate::options::{OptionError, check, positive};
use serde::{Deserialize, Serialize};

/// Options of [`estimate_albedo`](super::albedo::estimate_albedo). What the defaults reach is in
/// `docs/results/template.md` (albedo); other values are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AlbedoOptions {
    /// Which observations count.
    pub bounds: ObservationBounds,
    /// How views are combined.
    pub combine: Combine,
    /// Rounds of one-ring averaging of the vertex normals.
    pub normal_smoothing: usize,
    /// Texels per pixel (by length) of the closest view that sees a face, `> 0`.
    pub texels_per_px: f64,
    /// Largest resolution of one face, `1..=256`.
    pub max_resolution: u16,
    /// Largest number of texels in all; resolutions shrink evenly to fit.
    pub max_texels: usize,
    /// Prior standard deviation of a frame's log gain (exposure control: about 0.3).
    pub gain_sigma: f64,
    /// Number of surface spots on which gains are solved.
    pub gain_spots: usize,
    /// Light from all around that the organ reflects, in units of the shading (0 = none).
    pub ambient: f64,
    /// Vignetting `a` of the lens, `1 + a r²` with r in focal lengths from the principal point (0 =
    /// none).
    pub vignetting: f64,
    /// Refractive index of the wet film on the organ, at least 1 (1 = Lambert without a film);
    /// default that of wet tissue.
    pub refractive_index: f64,
}

impl Default for AlbedoOptions {
    fn default() -> Self {
        Self {
            bounds: ObservationBounds::default(),
            combine: Combine::Robust,
            normal_smoothing: 1,
            texels_per_px: 1.0,
            max_resolution: 64,
            max_texels: 3_000_000,
            gain_sigma: 0.3,
            gain_spots: 6000,
            ambient: 0.0,
            vignetting: 0.0,
            refractive_index: WET_TISSUE,
        }
    }
}

impl AlbedoOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[
            ("albedo.bounds", self.bounds.are_valid(), VALID_BOUNDS),
            ("albedo.texels_per_px", positive(&[self.texels_per_px]), "positive"),
            ("albedo.max_resolution", (1..=256).contains(&self.max_resolution), "from 1 to 256"),
            ("albedo.max_texels", (1..=1 << 28).contains(&self.max_texels), "from 1 to 2^28"),
            ("albedo.gain_sigma", positive(&[self.gain_sigma]), "positive"),
            ("albedo.ambient", self.ambient.is_finite(), "a number"),
            ("albedo.refractive_index, vignetting", self.coat().is_plausible(), PLAUSIBLE),
        ])
    }

    /// Tissue and lens as the options describe them.
    pub fn coat(&self) -> Coat {
        let Self { refractive_index, ambient, vignetting, .. } = *self;
        Coat { refractive_index, ambient, vignetting }
    }
}
