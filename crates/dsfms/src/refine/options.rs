//! Weights of eq. 4.

use crate::options::{OptionError, check, from_zero, positive};
use serde::{Deserialize, Serialize};

/// Options of eq. 4. Weights of per-vertex terms are shared among the vertices that carry them, so
/// that they hold at any mesh resolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RefineOptions {
    /// λ₄: weight of the reprojection condition, px⁻². Small: held tightly, vertices cannot move to
    /// where the image says.
    pub reprojection: f64,
    /// λ₅: weight of the diffuse condition.
    pub diffuse: f64,
    /// λ₆: weight of the specular condition.
    pub specular: f64,
    /// λ₇: weight of the Laplacian of the displacement from V′.
    pub smoothing: f64,
    /// Tolerance of the matches' depth as a fraction of the visible radius.
    pub depth_hold: f64,
    /// Number of vertices that the weights λ₄, λ₅, λ₆ were stated for.
    pub reference_count: f64,
    /// Blur of image and rendered albedo, as a fraction of the image diagonal.
    pub blur: f64,
    /// Noise of the image model: absolute part, linear light.
    pub sigma_absolute: f64,
    /// Noise of the image model: bounds of the part proportional to brightness, which is measured on
    /// the coarse shape.
    pub sigma_relative: [f64; 2],
    /// Weigh the channels so that white glare cancels; else grey, and what may be glare is left out.
    pub colour: bool,
    /// Huber threshold of the diffuse condition, in standard deviations.
    pub huber: f64,
    /// Spread of the log gain about its expectation.
    pub gain_sigma: f64,
    /// Spread of the ambient light about 0, linear light.
    pub ambient_sigma: f64,
    /// Vertices with less shading cosine than this are grazing and left out.
    pub grazing: f64,
    /// Vertices within this angle of the mirror direction are left out of the diffuse condition,
    /// degrees, where the frame shows highlights at all.
    pub specular_deg: f64,
    /// Vertices within this many blur radii of a predicted contour are left out.
    pub contour_blurs: f64,
    /// Halo around saturated pixels that is left out, as a fraction of the image diagonal.
    pub halo: f64,
    /// Solves, each with visibility and albedo rendered anew.
    pub rounds: usize,
}

impl RefineOptions {
    /// The same as eq. 4 is printed: grey, and only saturated vertices are left out of the diffuse ones.
    pub fn as_printed(&self) -> Self {
        Self {
            grazing: f64::NEG_INFINITY,
            contour_blurs: 0.0,
            specular_deg: 0.0,
            colour: false,
            ..self.clone()
        }
    }

    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let weights = [self.reprojection, self.diffuse, self.specular, self.smoothing];
        let noise = [self.sigma_absolute, self.sigma_relative[0], self.sigma_relative[1]];
        check(&[
            ("refine.reprojection, diffuse, specular, smoothing", from_zero(&weights), "0 or more"),
            ("refine.depth_hold", positive(&[self.depth_hold]), "positive"),
            ("refine.reference_count", positive(&[self.reference_count]), "positive"),
            ("refine.sigma_absolute, sigma_relative", positive(&noise), "positive"),
            (
                "refine.sigma_relative",
                self.sigma_relative[0] <= self.sigma_relative[1],
                "a lower and an upper bound",
            ),
            ("refine.huber", positive(&[self.huber]), "positive"),
            (
                "refine.gain_sigma, ambient_sigma",
                positive(&[self.gain_sigma, self.ambient_sigma]),
                "positive",
            ),
            (
                "refine.blur, grazing, specular_deg, contour_blurs, halo",
                from_zero(&[
                    self.blur,
                    self.grazing,
                    self.specular_deg,
                    self.contour_blurs,
                    self.halo,
                ]),
                "0 or more",
            ),
        ])
    }
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            reprojection: 0.01,
            diffuse: 1.0,
            specular: 10.0,
            smoothing: 30.0,
            depth_hold: 0.012,
            reference_count: 300.0,
            blur: 0.0045,
            sigma_absolute: 0.002,
            sigma_relative: [0.01, 0.1],
            colour: true,
            huber: 2.0,
            gain_sigma: 0.3,
            ambient_sigma: 0.05,
            grazing: 0.2,
            specular_deg: 8.0,
            contour_blurs: 1.5,
            halo: 0.02,
            rounds: 3,
        }
    }
}
