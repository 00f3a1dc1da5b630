//! Beyond the paper: motion, prior and shading in one problem.
//!
//! Eq. 4 starts from V′ and can only bend what motion left straight. Here the matches, the conformal
//! prior and the brightness of samples inside faces decide together, from coarse blur to fine, so
//! that texture carries the surface along while shading turns its normals.

use super::Photograph;
use super::cues::Cues;
use super::field::GainField;
use super::gain::{GainPrior, log_gain_at};
use super::hold::hold;
use super::mirror::mirrored;
use super::samples::{Seen, look};
use crate::energy::{
    Boundary, EnergyTerm, FaceRings, GlobalsPrior, Objective, Photometric, Smoothing, Unknowns,
    Workspace,
};
use crate::geometry::Point3;
use crate::light::LightModel;
use crate::mesh::Topology;
use crate::options::{OptionError, check, from_zero, positive};
use crate::register::terms::{keep, motion, stay};
use crate::register::{Body, Match, Prior, Scene};
use crate::solver::{Loss, Options, Summary};
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

impl JointOptions {
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
            ("joint.smooth_gain", from_zero(&[self.smooth_gain]), "0 or more"),
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

/// Vertices, and samples, that the weights of per-vertex and photometric terms are stated for.
pub(super) const REFERENCE: f64 = 334.0;

/// The shape of the joint solve.
#[derive(Clone, Debug)]
pub struct Joined {
    /// Vertices in camera axes, of the mesh that was solved on.
    pub vertices: Vec<Point3>,
    /// Exposure gain of the frame relative to the albedo.
    pub gain: f64,
    /// Ambient light, linear.
    pub ambient: f64,
    /// Photometric samples of the last round.
    pub samples: usize,
    /// Mean of `|image − prediction| / image` over them.
    pub residual: f64,
    /// The last solve.
    pub summary: Summary,
}

impl Joined {
    /// On the full mesh of `body`, with the hidden side carried along by what is seen.
    pub fn settled(mut self, body: &Body, anchor: f64) -> Self {
        self.vertices = body.carried(&body.settled(self.vertices, anchor)).into_owned();
        self
    }
}

/// Solve motion, prior and shading together, from `start` (V′ of eq. 3, on the mesh of `body` that is
/// solved on, as the matches).
///
/// `depth_sigma` is eq. 3's tolerance for the depth of the matches under a distant light.
#[doc(alias("joint optimisation", "photometric refinement"))]
pub fn join(
    body: &Body,
    start: &[Point3],
    depth_sigma: f64,
    matches: &[Match],
    photo: &Photograph,
    options: &JointOptions,
) -> Joined {
    let scene = body.scene();
    let field = smooth_gain(scene, options);
    let mut state = Unknowns { vertices: start.to_vec(), globals: vec![0.0; 2] };
    let (mut last, mut prior, mut workspace) = (None, None, Workspace::default());
    // Without any blur the picture is taken as it is.
    let blurs = if options.blurs.is_empty() { &[0.0][..] } else { &options.blurs };
    let last_stage = blurs.len() - 1;
    let mut reposed: Option<Scene> = None;
    let rings = FaceRings::of(&scene.rest.topology);
    for (stage, &blur) in blurs.iter().enumerate() {
        let scene = reposed.as_ref().unwrap_or(scene);
        // The coarse stages find the shape that the smooth gain would explain away.
        let field = field.as_ref().filter(|_| stage == last_stage);
        let nodes = field.map_or(0, GainField::len);
        state.globals.resize(2 + nodes, 0.0);
        let full = body.carried(&state.vertices);
        let look = look(photo, body.full().rest, &full, blur, options);
        let cues = Cues::of(&look, body, &state.vertices, photo, options);
        let at_matches = (stage == 0).then(|| log_gain_at(&look, scene, matches, start)).flatten();
        let seen = Seen::of(look, body, &state.vertices, field, options);
        let (gain, hold) = prior.get_or_insert_with(|| {
            state.globals[0] = seen.log_gain;
            let (sigma, ambient) = (options.gain_sigma, options.ambient_sigma);
            let gain = GainPrior::of(photo.exposure, seen.log_gain, at_matches, sigma, ambient);
            // Brightness tells the distance from a near light as well as the exposure is known.
            let (light, slack) = (&photo.light.light, gain.slack(sigma));
            (gain, hold(scene, matches, &scene.posed, depth_sigma, light, options, slack))
        });
        let count = seen.samples.len();
        let shading =
            Photometric::new(photo.camera, photo.light, &seen.image, &rings, seen.samples);
        let problem = || {
            let held = held(scene, matches, options.match_px, 2 + nodes, options);
            let held = cues.on(held, options);
            shaded(held, scene, hold.clone(), shading.clone(), *gain, options)
        };
        let mirrors = if (1..last_stage).contains(&stage) { options.mirrors } else { 0 };
        let topology = &scene.rest.topology;
        let (next, summary) = settle(problem, &mut workspace, topology, start, state, mirrors);
        state = next;
        let residual = shading.mean_residual(topology, &state.vertices, &state.globals);
        last = Some((summary, count, residual));
        // A near light tells the distance of everything, so the shape now knows the pose better than
        // the matches did; under a distant one only the matches hold it.
        if matches!(photo.light.light, LightModel::Point(_)) {
            reposed = Some(scene.reposed(&state.vertices));
        }
    }
    let (summary, samples, residual) = last.expect("there is at least one blur");
    Joined {
        gain: state.globals[0].exp(),
        ambient: state.globals[1],
        vertices: state.vertices,
        samples,
        residual,
        summary,
    }
}

/// Minimise, then start again from the other answers to what moved since `coarse`; the lowest cost
/// stays.
fn settle<'a>(
    problem: impl Fn() -> Objective<'a>,
    workspace: &mut Workspace,
    topology: &Topology,
    coarse: &[Point3],
    state: Unknowns,
    mirrors: usize,
) -> (Unknowns, Summary) {
    let solver = Options { max_steps: 12, cost_tolerance: 1e-4, ..Options::default() };
    let mut best = problem().minimise_in(workspace, state, &solver);
    for vertices in mirrored(topology, coarse, &best.0.vertices, mirrors) {
        let other = Unknowns { vertices, globals: best.0.globals.clone() };
        let other = problem().minimise_in(workspace, other, &solver);
        if other.1.cost().1 < best.1.cost().1 {
            best = other;
        }
    }
    best
}

/// The problem without what the image says: matches, and what the surface keeps of its rest shape.
pub(super) fn held<'a>(
    scene: &'a Scene,
    matches: &[Match],
    match_px: f64,
    globals: usize,
    options: &JointOptions,
) -> Objective<'a> {
    let matched = Objective::over(scene.posed.len(), globals).plus_as(
        "motion",
        1.0,
        Loss::GemanMcClure(match_px),
        motion(scene, matches, 1.0),
    );
    let strain = Loss::GemanMcClure(options.strain);
    keep(matched, scene, options.prior, strain, [options.conformal, options.stretch])
}

/// The photometric condition on top, with smoothing, what holds depth and the hidden side, and the
/// priors of gain and ambient light.
pub(super) fn shaded<'a>(
    held: Objective<'a>,
    scene: &'a Scene,
    hold: Boundary,
    photometric: impl EnergyTerm<1> + 'a,
    gain: GainPrior,
    options: &JointOptions,
) -> Objective<'a> {
    let share = REFERENCE / photometric.count().max(1) as f64;
    let smoothing = Smoothing::of_displacement(&scene.laplacian, &scene.posed, scene.visible_area);
    let nodes = (2..held.globals()).map(|k| [k]).collect();
    let field = GlobalsPrior { indices: nodes, mean: 0.0, sigma: options.smooth_gain };
    held.plus(options.smoothing, Loss::Squared, smoothing)
        .plus(share * options.photometric, Loss::GemanMcClure(options.robust), photometric)
        .plus_as("hold of depth", 1.0, Loss::Huber(1.0), hold)
        .plus(3.0, Loss::Squared, stay(scene))
        .plus(1.0, Loss::Squared, GlobalsPrior::of(0, gain.expected, gain.sigma))
        .plus(1.0, Loss::Squared, GlobalsPrior::of(1, 0.0, gain.ambient_sigma))
        .plus(1.0, Loss::Squared, field)
}

/// The field of smooth gain over what is seen of a scene.
pub(super) fn smooth_gain(scene: &Scene, options: &JointOptions) -> Option<GainField> {
    let seen = (0..scene.visible.len()).filter(|&v| scene.visible[v]);
    let points: Vec<Point3> = seen.map(|v| scene.rest.positions[v]).collect();
    let length = options.smooth_length * scene.radius();
    (options.smooth_gain > 0.0).then(|| GainField::over(&points, length))?
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
