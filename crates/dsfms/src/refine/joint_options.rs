//! Options of the joint solve.

use super::PhotometricModel;
use crate::options::{OptionError, blurs, check, from_zero, positive};
use crate::register::PriorWeights;
use serde::{Deserialize, Serialize};

/// Options of the joint solve, whose cost stands in `refine/joint_objective.rs`. Lengths are
/// relative to the visible radius, so they hold in any unit. `shading`, `outline` and `highlights`
/// weigh a mean, in units of one match that is off by 1 px, so they hold for any number of samples,
/// contour points and vertices.
///
/// Measured on choosing scenes and clips (`docs/results/choices.md`): `shading` (half), `outline`,
/// `find_outline`, `follow_texture`, `finer_control`, `highlights` (none), `robust` (6, 12),
/// `strain`, `near_depth_hold`, `near_depth_motion`, `smooth_gain`, `blurs`, `look_again`,
/// `mirrors`; smoothing and blurs also in `docs/results/scenes.md`. Other values of `match_px`,
/// `silhouette_px`, `smooth_length` and `max_samples` are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JointOptions {
    /// What the surface keeps.
    pub prior: PriorWeights,
    /// Weight of the mean over the photometric samples: where all are off by their noise they cost
    /// like this many matches that are off by 1 px. Fewer than there are samples, since neighbours
    /// are off together.
    pub shading: f64,
    /// Weight of the mean over the points of the occluding contour, where an organ mask tells its
    /// outline, or colour does.
    pub outline: f64,
    /// Whether the outline is found by colour where no organ mask is given (one frame alone; not in
    /// tracking).
    pub find_outline: bool,
    /// Whether texture that moved farther than the blurs reach is followed, from the tissue that
    /// did not, where two looks leave brightness unexplained: they are done once more, the first
    /// by what is followed, and the lower cost stays (one frame alone; not in tracking). Where
    /// there is one look (`look_again` of 0, a template without descriptors) nothing is followed.
    pub follow_texture: bool,
    /// Whether the second look is solved on a control mesh that is finer where the first one bends
    /// it (meshes of more than 1,500 vertices, one frame alone; not in tracking). A frame takes a
    /// third longer; some scenes come nearer and some farther off (`docs/results/choices.md`).
    pub finer_control: bool,
    /// Weight of saturated vertices under a near light, over all that are seen. Under a distant
    /// light, where only the matches tell distance, highlights are no cue.
    pub highlights: f64,
    /// What brightness tells.
    pub image: PhotometricModel,
    /// Geman-McClure scale of the photometric residuals, in standard deviations.
    pub robust: f64,
    /// Geman-McClure scale of the matches, px.
    pub match_px: f64,
    /// Geman-McClure scale of shearing, anisotropy and log area ratio: tissue under a tool deforms
    /// strongly in a small place, and beyond this strain the prior no longer resists.
    pub strain: f64,
    /// Noise of the outline, px.
    pub silhouette_px: f64,
    /// Depth of the matches under a near light, which tells depth too, is held to the rigid pose
    /// within this fraction of the visible radius where the pose explains them; under a distant
    /// light the tolerance of eq. 3 holds.
    pub near_depth_hold: f64,
    /// Expected motion in depth under a near light, for the motion that a match shares with its
    /// neighbours and the pose does not explain.
    pub near_depth_motion: f64,
    /// What is other where brightness does not tell distance: under a near light of unknown
    /// exposure.
    pub exposure_unknown: ExposureUnknown,
    /// Spread of the smooth log gain over the surface; 0 leaves it out.
    pub smooth_gain: f64,
    /// Its correlation length, of the visible radius.
    pub smooth_length: f64,
    /// Blurs of image and albedo, coarse to fine, as fractions of the image diagonal; at least one.
    pub blurs: Vec<f64>,
    /// Coarsest blurs by which one frame alone is solved first, to find matches and outline again
    /// about that shape, before it is solved by the last of them and the finer ones; 0 leaves it
    /// out.
    pub look_again: usize,
    /// Three samples a face as long as they are no more than this, else one.
    pub max_samples: usize,
    /// Regions whose movement along the viewing rays is tried the other way, in the last stage but
    /// one: coarser ones hide the texture that tells them apart.
    pub mirrors: usize,
}

/// What of [`JointOptions`] is other where the light is near and the exposure is not known, and
/// under a distant light where a frame is followed: a stronger prior holds what brightness cannot
/// tell, and smooth errors of brightness are a field. Measured where the exposure is known, beside
/// the defaults of [`JointOptions`] (`docs/results/scenes.md`); where it is unknown other values
/// are not measured.
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
    /// The same under a near light of unknown exposure.
    pub(super) fn without_exposure(&self) -> Self {
        let ExposureUnknown { stretch, strain, smooth_gain } = self.exposure_unknown;
        Self { prior: PriorWeights { stretch, ..self.prior }, strain, smooth_gain, ..self.clone() }
    }

    /// Those of the look before matches and outline are found again, and of the one after, which
    /// begins by the last blur of the first; `None` where there is one look.
    pub(crate) fn looks(&self) -> Option<[Self; 2]> {
        let first = self.look_again.min(self.blurs.len());
        let by = |blurs: &[f64]| Self { blurs: blurs.to_vec(), ..self.clone() };
        (first > 0).then(|| [by(&self.blurs[..first]), by(&self.blurs[first - 1..])])
    }

    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let weights = [self.shading, self.outline, self.highlights];
        let scales = [self.robust, self.match_px, self.silhouette_px, self.strain];
        let unknown = &self.exposure_unknown;
        check(&[
            (
                "joint.prior.conformal, stretch, smoothing, hidden",
                self.prior.is_valid(),
                "0 or more",
            ),
            ("joint.shading, outline, highlights", from_zero(&weights), "0 or more"),
            ("joint.robust, match_px, silhouette_px, strain", positive(&scales), "positive"),
            ("joint.near_depth_hold", positive(&[self.near_depth_hold]), "positive"),
            ("joint.near_depth_motion", from_zero(&[self.near_depth_motion]), "0 or more"),
            (
                "joint.smooth_gain, joint.exposure_unknown.stretch, smooth_gain",
                from_zero(&[self.smooth_gain, unknown.stretch, unknown.smooth_gain]),
                "0 or more",
            ),
            ("joint.exposure_unknown.strain", positive(&[unknown.strain]), "positive"),
            ("joint.smooth_length", positive(&[self.smooth_length]), "positive"),
            (
                "joint.blurs",
                !self.blurs.is_empty() && blurs(&self.blurs),
                "one blur or more, each from 0 to 0.25",
            ),
        ])?;
        self.image.validate([
            "joint.image.sigma_absolute, sigma_relative",
            "joint.image.sigma_relative",
            "joint.image.gain_sigma, ambient_sigma",
            "joint.image.contour_blurs, grazing, specular_deg, halo",
        ])
    }
}

impl Default for JointOptions {
    fn default() -> Self {
        Self {
            prior: PriorWeights {
                conformal: 1e4,
                stretch: 3e2,
                smoothing: 30.0,
                ..PriorWeights::default()
            },
            // 4 for each sample and 1 for each highlight of 334 (the vertices of the patch of
            // docs/results/ext), 1 for each of 100 points of a contour: weights of means, which
            // hold for any mesh.
            shading: 1336.0,
            outline: 100.0,
            find_outline: true,
            follow_texture: true,
            finer_control: false,
            highlights: 334.0,
            image: PhotometricModel::default(),
            robust: 3.0,
            match_px: 4.0,
            strain: 0.1,
            silhouette_px: 2.0,
            near_depth_hold: 0.07,
            near_depth_motion: 100.0,
            exposure_unknown: ExposureUnknown::default(),
            smooth_gain: 0.0,
            smooth_length: 0.3,
            blurs: vec![0.018, 0.009, 0.0045, 0.003],
            look_again: 2,
            max_samples: 8000,
            mirrors: 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::JointOptions;

    #[test]
    fn the_first_look_is_by_the_coarsest_blurs_and_the_second_goes_on() {
        let options = JointOptions::default();
        let blurs = |look_again: usize| {
            let looks = JointOptions { look_again, ..options.clone() }.looks();
            looks.map(|looks| looks.map(|look| look.blurs))
        };
        let all = options.blurs.as_slice();
        assert_eq!(blurs(2), Some([all[..2].to_vec(), all[1..].to_vec()]));
        assert_eq!(blurs(0), None);
        assert_eq!(blurs(99), Some([all.to_vec(), all[3..].to_vec()]));
    }

    #[test]
    fn no_blur_at_all_is_refused() {
        let options: JointOptions = toml::from_str("blurs = []").unwrap();
        assert!(options.validate().unwrap_err().to_string().contains("one blur or more"));
        assert_eq!(JointOptions::default().validate(), Ok(()));
    }
}
