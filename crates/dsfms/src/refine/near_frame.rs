//! A frame of the joint solve, and what the first look at it tells.

use super::Photograph;
use super::depth_prior::depth_prior;
use super::gain::{AtMatches, GainPrior};
use super::joint_options::JointOptions;
use crate::energy::Boundary;
use crate::geometry::Point3;
use crate::register::{Body, Match};
use crate::template::Exposure;

/// A frame whose shape matches and shading tell together; matches and shapes are those of the mesh
/// of `body` that is solved on.
pub struct NearFrame<'a> {
    /// The rest shape posed where bending is counted from, and what of it is seen.
    pub body: &'a Body<'a>,
    /// Where the template's points are.
    pub matches: &'a [Match],
    /// The rest shape where the matches pose it: their depth is held to it.
    pub posed: &'a [Point3],
    /// Eq. 3's tolerance for the depth of the matches, under a distant light.
    pub depth_sigma: f64,
    /// The image.
    pub photo: &'a Photograph<'a>,
}

/// What the first look at a frame tells of its exposure, and what holds its depth.
pub(super) struct Told {
    pub(super) gain: GainPrior,
    pub(super) at_matches: Option<AtMatches>,
    pub(super) hold: Boundary,
    /// Those of the whole, or what they are without an exposure.
    pub(super) options: JointOptions,
}

impl Told {
    /// `exposure`: what is expected of it; `log_gain`: what all samples show; `distant`: the light
    /// tells no distance, and nothing need take the place of that.
    pub(super) fn of(
        frame: &NearFrame,
        exposure: Option<Exposure>,
        log_gain: f64,
        at_matches: Option<AtMatches>,
        options: &JointOptions,
        distant: bool,
    ) -> Self {
        let NearFrame { body, matches, posed, depth_sigma, photo } = *frame;
        let light = &photo.light.light;
        let gain = GainPrior::of(exposure, log_gain, at_matches, &options.image);
        // Brightness tells the distance from a near light as well as the exposure is known.
        let slack = gain.slack(options.image.gain_sigma);
        let hold = depth_prior(body.scene(), matches, posed, depth_sigma, light, options, slack);
        let known = distant || gain.tells_distance(light, &options.image);
        let options = if known { options.clone() } else { options.without_exposure() };
        Self { gain, at_matches, hold, options }
    }
}
