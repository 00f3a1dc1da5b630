//! Options of the joint solve.

use super::gain::GainPrior;
use crate::light::LightModel;
use crate::options::{OptionError, check, from_zero, positive};
use crate::register::Prior;
use serde::{Deserialize, Serialize};

/// Options of the joint solve. Lengths are relative to the visible radius, so they hold in any unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JointOptions {
    /// What the surface keeps.
    pub prior: Prior,
    /// Weight of shearing and anisotropy (or of the other priors) per visible area.
    pub conformal: f64,
    /// Weight of the log area ratio per visible area.
    pub stretch: f64,
    /// Weight of the Laplacian of the displacement from the posed template.
    pub smoothing: f64,
    /// Weight of all photometric samples together, in units of one sample for each of 334 vertices.
    pub photometric: f64,
    /// Bounds of the noise of the image model proportional to brightness, which is measured on the
    /// samples of the coarse shape.
    pub sigma_relative: [f64; 2],
    /// Noise of the image model, absolute, linear light.
    pub sigma_absolute: f64,
    /// Weigh the channels so that white glare cancels; else grey, and what may be glare is left out.
    pub colour: bool,
    /// Geman-McClure scale of the photometric residuals, in standard deviations.
    pub robust: f64,
    /// Geman-McClure scale of the matches, px.
    pub match_px: f64,
    /// Depth of the matches under a near light, which tells depth too, is held to the rigid pose within
    /// this fraction of the visible radius where the pose explains them; under a distant light the
    /// tolerance of eq. 3 holds.
    pub near_depth_hold: f64,
    /// Expected motion in depth under a near light, for the motion that a match shares with its
    /// neighbours and the pose does not explain.
    pub near_depth_motion: f64,
    /// Spread of the log gain about its expectation, where the exploration does not tell a smaller one.
    pub gain_sigma: f64,
    /// Spread of the ambient light about 0, where the exploration does not tell the exposure.
    pub ambient_sigma: f64,
    /// What is other where brightness does not tell distance: under a near light of unknown exposure.
    pub exposure_unknown: ExposureUnknown,
    /// Spread of the smooth log gain over the surface; 0 leaves it out.
    pub smooth_gain: f64,
    /// Its correlation length, of the visible radius.
    pub smooth_length: f64,
    /// Blurs of image and albedo, coarse to fine, as fractions of the image diagonal; at least one.
    pub blurs: Vec<f64>,
    /// Three samples a face as long as they are no more than this, else one.
    pub max_samples: usize,
    /// Samples within this many blur radii of a predicted contour are left out.
    pub contour_blurs: f64,
    /// Samples with less cosine towards the camera than this are left out.
    pub grazing: f64,
    /// Samples within this angle of the mirror direction are left out where there are highlights,
    /// degrees.
    pub specular_deg: f64,
    /// Weight of all points of the occluding contour together, in units of a hundred points, where an
    /// organ mask tells its outline.
    pub silhouette: f64,
    /// Noise of that outline, px.
    pub silhouette_px: f64,
    /// Weight of a saturated vertex under a near light, in units of one for each of 334 visible
    /// vertices. Under a distant light, where only the matches tell distance, highlights are no cue.
    pub specular: f64,
    /// Halo around saturated pixels, as a fraction of the image diagonal.
    pub halo: f64,
    /// Geman-McClure scale of shearing, anisotropy and log area ratio: tissue under a tool deforms
    /// strongly in a small place, and beyond this strain the prior no longer resists.
    pub strain: f64,
    /// Regions whose movement along the viewing rays is tried the other way, in every stage but the
    /// coarsest, whose blur hides the texture that tells them apart, and the last.
    pub mirrors: usize,
}

/// What of [`JointOptions`] is other where the light is near and the exposure is not known, and under a
/// distant light where a frame is followed: a stronger prior holds what brightness cannot tell, and smooth
/// errors of brightness are a field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExposureUnknown {
    /// Weight of the log area ratio per visible area.
    pub stretch: f64,
    /// Geman-McClure scale of shearing, anisotropy and log area ratio.
    pub strain: f64,
    /// Spread of the smooth log gain over the surface; 0 leaves it out.
    pub smooth_gain: f64,
}

impl Default for ExposureUnknown {
    fn default() -> Self {
        Self { stretch: 4e3, strain: 0.2, smooth_gain: 0.01 }
    }
}

impl JointOptions {
    /// Whether brightness tells distance: a near light, and its exposure known.
    pub(super) fn tells_distance(&self, gain: &GainPrior, light: &LightModel) -> bool {
        light.tells_distance() && gain.is_told(self.gain_sigma)
    }

    /// The same under a near light of unknown exposure.
    pub(super) fn without_exposure(&self) -> Self {
        let ExposureUnknown { stretch, strain, smooth_gain } = self.exposure_unknown;
        Self { stretch, strain, smooth_gain, ..self.clone() }
    }

    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let weights = [
            self.conformal,
            self.stretch,
            self.smoothing,
            self.photometric,
            self.silhouette,
            self.specular,
        ];
        let noise = [self.sigma_absolute, self.sigma_relative[0], self.sigma_relative[1]];
        let scales = [self.robust, self.match_px, self.silhouette_px, self.strain];
        check(&[
            (
                "joint.conformal, stretch, smoothing, photometric, silhouette, specular",
                from_zero(&weights),
                "0 or more",
            ),
            ("joint.sigma_absolute, sigma_relative", positive(&noise), "positive"),
            (
                "joint.sigma_relative",
                self.sigma_relative[0] <= self.sigma_relative[1],
                "a lower and an upper bound",
            ),
            ("joint.robust, match_px, silhouette_px, strain", positive(&scales), "positive"),
            ("joint.near_depth_hold", positive(&[self.near_depth_hold]), "positive"),
            ("joint.near_depth_motion", from_zero(&[self.near_depth_motion]), "0 or more"),
            (
                "joint.gain_sigma, ambient_sigma",
                positive(&[self.gain_sigma, self.ambient_sigma]),
                "positive",
            ),
            (
                "joint.smooth_gain, joint.exposure_unknown.stretch, smooth_gain",
                from_zero(&[
                    self.smooth_gain,
                    self.exposure_unknown.stretch,
                    self.exposure_unknown.smooth_gain,
                ]),
                "0 or more",
            ),
            (
                "joint.exposure_unknown.strain",
                positive(&[self.exposure_unknown.strain]),
                "positive",
            ),
            ("joint.smooth_length", positive(&[self.smooth_length]), "positive"),
            (
                "joint.blurs",
                !self.blurs.is_empty() && from_zero(&self.blurs),
                "one blur or more, each 0 or more",
            ),
            (
                "joint.contour_blurs, grazing, specular_deg, halo",
                from_zero(&[self.contour_blurs, self.grazing, self.specular_deg, self.halo]),
                "0 or more",
            ),
        ])
    }
}

impl Default for JointOptions {
    fn default() -> Self {
        Self {
            prior: Prior::Conformal,
            conformal: 1e4,
            stretch: 3e2,
            smoothing: 30.0,
            photometric: 4.0,
            sigma_relative: [0.01, 0.1],
            sigma_absolute: 0.002,
            colour: true,
            robust: 3.0,
            match_px: 4.0,
            near_depth_hold: 0.07,
            near_depth_motion: 100.0,
            gain_sigma: 0.1,
            ambient_sigma: 0.02,
            exposure_unknown: ExposureUnknown::default(),
            smooth_gain: 0.0,
            smooth_length: 0.3,
            blurs: vec![0.018, 0.009, 0.0045, 0.003],
            max_samples: 8000,
            contour_blurs: 1.5,
            grazing: 0.25,
            specular_deg: 12.0,
            silhouette: 1.0,
            silhouette_px: 2.0,
            specular: 1.0,
            halo: 0.02,
            strain: 0.1,
            mirrors: 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::JointOptions;

    #[test]
    fn no_blur_at_all_is_refused() {
        let options: JointOptions = toml::from_str("blurs = []").unwrap();
        assert!(options.validate().unwrap_err().to_string().contains("one blur or more"));
        assert_eq!(JointOptions::default().validate(), Ok(()));
    }
}
