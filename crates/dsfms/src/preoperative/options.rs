//! Options of the registration of a preoperative surface.

use crate::options::{OptionError, check, positive};
use serde::{Deserialize, Serialize};

/// What is known of the scale between template and preoperative surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleRule {
    /// Nothing: a template in template units.
    Free,
    /// mm on both sides, but for this fraction either way.
    Within(f64),
    /// mm on both sides.
    Fixed,
}

impl ScaleRule {
    /// Bounds of the scale.
    pub fn bounds(self) -> [f64; 2] {
        match self {
            Self::Free => [0.0, f64::INFINITY],
            Self::Within(share) => [1.0 / (1.0 + share), 1.0 + share],
            Self::Fixed => [1.0, 1.0],
        }
    }

    /// Whether landmarks alone have to find a scale.
    pub(crate) fn is_free(self) -> bool {
        self == Self::Free
    }
}

/// How a preoperative surface is registered. What the defaults reach is in
/// `docs/results/register_ct.md`; other values are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PreoperativeOptions {
    /// Scale between the two surfaces.
    pub scale: ScaleRule,
    /// Standard deviation of a picked landmark, mm of the preoperative surface, both picks
    /// together.
    pub landmark_sigma: f64,
    /// Standard deviation of the template's surface, of its size (root mean square distance from
    /// the middle); what the template says of itself counts more.
    pub noise: f64,
    /// Whether the preoperative surface bends after the similarity.
    pub deform: bool,
    /// How far it may bend, mm; also how far apart the surfaces are still taken for the same place.
    pub max_deformation: f64,
    /// Strain that tissue is expected to show, of length; the bending prior.
    pub strain: f64,
    /// Smallest share of the template's area that must lie on the preoperative surface.
    pub min_overlap: f64,
    /// Expected error of a target above which the result is degraded, mm.
    pub max_target_error: f64,
    /// Seed of the draws among many landmarks.
    pub seed: u64,
}

impl Default for PreoperativeOptions {
    fn default() -> Self {
        Self {
            scale: ScaleRule::Free,
            landmark_sigma: 4.0,
            noise: 0.01,
            deform: true,
            max_deformation: 15.0,
            strain: 0.05,
            min_overlap: 0.5,
            max_target_error: 10.0,
            seed: 0,
        }
    }
}

impl PreoperativeOptions {
    /// The first field out of its bounds.
    ///
    /// # Errors
    /// [`OptionError`] names it.
    pub fn validate(&self) -> Result<(), OptionError> {
        let within = match self.scale {
            ScaleRule::Within(share) => positive(&[share]) && share < 1.0,
            _ => true,
        };
        let share = self.min_overlap > 0.0 && self.min_overlap <= 1.0;
        check(&[
            ("scale", within, "a share above 0 and below 1"),
            ("landmark_sigma", positive(&[self.landmark_sigma]), "above 0 mm"),
            ("noise", positive(&[self.noise]), "above 0"),
            ("max_deformation", positive(&[self.max_deformation]), "above 0 mm"),
            ("strain", positive(&[self.strain]), "above 0"),
            ("min_overlap", share, "above 0 and at most 1"),
            ("max_target_error", positive(&[self.max_target_error]), "above 0 mm"),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_named() {
        assert_eq!(PreoperativeOptions::default().validate(), Ok(()));
        let bad = PreoperativeOptions { landmark_sigma: 0.0, ..Default::default() };
        assert_eq!(bad.validate().unwrap_err().field, "landmark_sigma");
        let bad = PreoperativeOptions { scale: ScaleRule::Within(1.5), ..Default::default() };
        assert_eq!(bad.validate().unwrap_err().field, "scale");
    }
}
