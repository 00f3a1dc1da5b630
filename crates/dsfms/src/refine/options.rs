//! Weights of eq. 4.

use super::PhotometricModel;
use crate::options::{OptionError, blurs, check, from_zero, positive};
use serde::{Deserialize, Serialize};

/// Options of eq. 4, its weights named as the paper names them. λ₄, λ₅ and λ₆ weigh the mean over
/// the vertices that are seen, in units of one match whose depth is off by its tolerance, so they
/// hold at any mesh resolution.
///
/// Measured (`docs/results/ablation`): `lambda_4` a hundred times as large, no `lambda_6`, no
/// `huber`, one of `rounds`. Other values of these, and of `lambda_5`, `lambda_7`, `hidden`,
/// `depth_hold` and `blur`, are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RefineOptions {
    /// Reprojection, px⁻². Small: held tightly, vertices cannot move to where the image says.
    pub lambda_4: f64,
    /// Diffuse vertices.
    pub lambda_5: f64,
    /// Specular vertices.
    pub lambda_6: f64,
    /// Smoothing: the Laplacian of the displacement from V′.
    pub lambda_7: f64,
    /// Weight that holds vertices that are not seen to V′, per visible area, within a twenty-fifth
    /// of the visible radius.
    pub hidden: f64,
    /// Tolerance of the matches' depth as a fraction of the visible radius.
    pub depth_hold: f64,
    /// Blur of image and rendered albedo, as a fraction of the image diagonal.
    pub blur: f64,
    /// What brightness tells.
    pub image: PhotometricModel,
    /// Huber threshold of the diffuse condition, in standard deviations.
    pub huber: f64,
    /// Solves, each with visibility and albedo rendered again.
    pub rounds: usize,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            lambda_4: 3.0,
            lambda_5: 300.0,
            lambda_6: 3000.0,
            lambda_7: 30.0,
            hidden: 3.0,
            depth_hold: 0.012,
            blur: 0.0045,
            image: PhotometricModel {
                gain_sigma: 0.3,
                ambient_sigma: 0.05,
                grazing: 0.2,
                specular_deg: 8.0,
                ..PhotometricModel::default()
            },
            huber: 2.0,
            rounds: 3,
        }
    }
}

impl RefineOptions {
    /// The same as eq. 4 is printed: grey, and only saturated vertices are left out of the diffuse
    /// ones.
    pub fn as_printed(&self) -> Self {
        let image = PhotometricModel {
            grazing: f64::NEG_INFINITY,
            contour_blurs: 0.0,
            specular_deg: 0.0,
            colour: false,
            ..self.image
        };
        Self { image, ..self.clone() }
    }

    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let weights = [self.lambda_4, self.lambda_5, self.lambda_6, self.lambda_7, self.hidden];
        check(&[
            (
                "refine.lambda_4, lambda_5, lambda_6, lambda_7, hidden",
                from_zero(&weights),
                "0 or more",
            ),
            ("refine.depth_hold", positive(&[self.depth_hold]), "positive"),
            ("refine.huber", positive(&[self.huber]), "positive"),
            ("refine.blur", blurs(&[self.blur]), "from 0 to 0.25"),
        ])?;
        self.image.validate([
            "refine.image.sigma_absolute, sigma_relative",
            "refine.image.sigma_relative",
            "refine.image.gain_sigma, ambient_sigma",
            "refine.image.contour_blurs, grazing, specular_deg, halo",
        ])
    }
}
