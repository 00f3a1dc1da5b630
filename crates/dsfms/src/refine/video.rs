//! The joint solve of a frame whose surface is nearly known: that of the previous frame.
//!
//! A shape that is right but for what happens in a twenty-fifth of a second needs no coarse blur,
//! no annealing and no other starts: a few steps at the finest blur, from the last shape, with the
//! memory of the last solve.

use super::Photograph;
use super::gain::AtMatches;
use super::joint::{Joined, with_exposure};
use super::joint_objective::JointProblem;
use super::joint_options::JointOptions;
use super::near_frame::{NearFrame, Told};
use super::samples::{ImageSamples, look};
use crate::energy::{FaceRings, Photometric, Unknowns, Workspace};
use crate::geometry::Point3;
use crate::mesh::Topology;
use crate::options::{OptionError, blurs, check, positive};
use crate::solver::Options;
use crate::template::Exposure;
use serde::{Deserialize, Serialize};

/// Options of the solve from the last shape.
///
/// Measured on clips 21 to 23: `steps`, `max_samples` and `least_blur_px`, together, as the
/// defaults have them and as [`realtime`](Self::realtime) does (`docs/results/choices.md`);
/// `tolerance` and `reduction` (`docs/performance.md`). Other values, and those of `blur`,
/// `blurs_after_gap` and `match_px`, are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VideoOptions {
    /// Blur of image and albedo, as a fraction of the image diagonal.
    pub blur: f64,
    /// Blurs before it, coarse to fine, where the last shape is that of many frames ago or the
    /// matches moved on from it by more than the blur.
    pub blurs_after_gap: Vec<f64>,
    /// Steps of the solver at each.
    pub steps: usize,
    /// A step that lowers the cost by less than this part of it is the last.
    pub tolerance: f64,
    /// The linear systems' residual is reduced by this factor: few good steps, since each costs a
    /// new linearisation.
    pub reduction: f64,
    /// Three samples a face as long as they are no more than this, else one.
    pub max_samples: usize,
    /// The picture that shading is read from is halved as long as its blur keeps this standard
    /// deviation, px.
    pub least_blur_px: f64,
    /// Geman-McClure scale of the matches, px: they start where the last frame ended, and are
    /// followed to a fraction of a pixel.
    pub match_px: f64,
}

impl Default for VideoOptions {
    fn default() -> Self {
        Self {
            blur: 0.0045,
            blurs_after_gap: vec![0.018, 0.009],
            steps: 4,
            tolerance: 1e-3,
            reduction: 0.03,
            max_samples: 8000,
            least_blur_px: 3.0,
            match_px: 1.5,
        }
    }
}

impl VideoOptions {
    /// For a live source: coarser and more than twice as fast.
    pub fn realtime() -> Self {
        Self {
            steps: 2,
            tolerance: 1e-2,
            max_samples: 3000,
            least_blur_px: 1.5,
            reduction: 0.1,
            ..Self::default()
        }
    }

    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[
            (
                "video.blur, blurs_after_gap",
                blurs(&[self.blur]) && blurs(&self.blurs_after_gap),
                "from 0 to 0.25",
            ),
            ("video.steps", self.steps >= 1, "at least 1"),
            (
                "video.tolerance, reduction, match_px, least_blur_px",
                positive(&[self.tolerance, self.reduction, self.match_px, self.least_blur_px]),
                "positive",
            ),
        ])
    }

    fn solver(&self) -> Options {
        Options {
            max_steps: self.steps,
            cost_tolerance: self.tolerance,
            reduction: self.reduction,
            ..Options::default()
        }
    }
}

/// What outlives a frame of the same template: symbolic factors and workspaces.
#[derive(Default)]
pub struct VideoMemory {
    workspace: Workspace,
    rings: Option<FaceRings>,
}

impl VideoMemory {
    /// Made for a template's topology, where it is not yet.
    fn ready(&mut self, topology: &Topology, vertices: usize) -> (&mut Workspace, &FaceRings) {
        let Self { workspace, rings } = self;
        let rings = rings.get_or_insert_with(|| {
            let rings = FaceRings::of(topology);
            // Whatever face comes into view, the system has its blocks.
            *workspace = Workspace::reserved(vertices, 2, rings.stencils());
            rings
        });
        (workspace, rings)
    }
}

/// A shape near that of the frame, and the ambient light that went with it.
#[derive(Clone, Copy, Debug)]
pub struct Near<'a> {
    /// Vertices in camera axes, of the mesh that is solved on.
    pub shape: &'a [Point3],
    /// Linear light.
    pub ambient: f64,
    /// The shape is that of many frames ago, or the matches moved on from it by more than the blur.
    pub gap: bool,
}

/// Solve motion, prior and shading together, from a shape near the solution. An exposure that is
/// held and scales the surface is taken for unknown.
pub fn join_near(
    memory: &mut VideoMemory,
    frame: &NearFrame,
    near: Near,
    joint: &JointOptions,
    video: &VideoOptions,
) -> Joined {
    with_exposure(frame, |frame| near_told(memory, frame, near, joint, video))
}

/// The many matches of a followed frame tell the exposure themselves where they are at rest.
fn exposure_here(photo: &Photograph, at_matches: Option<AtMatches>) -> Option<Exposure> {
    let here = |at: AtMatches| photo.exposure.map(|e| Exposure { log_gain: at.log_gain, ..e });
    at_matches.filter(AtMatches::calm).map_or_else(|| photo.told_exposure(), here)
}

/// Solve with the exposure as the photograph tells it; `true` where brightness told distance.
fn near_told(
    memory: &mut VideoMemory,
    frame: &NearFrame,
    near: Near,
    joint: &JointOptions,
    video: &VideoOptions,
) -> (Joined, bool) {
    let joint = &JointOptions { max_samples: video.max_samples, ..joint.clone() };
    let solver = video.solver();
    let NearFrame { body, matches, posed, photo, .. } = *frame;
    let scene = body.scene();
    let topology = &scene.rest.topology;
    let (workspace, rings) = memory.ready(topology, near.shape.len());
    let mut state = Unknowns { vertices: near.shape.to_vec(), globals: vec![0.0, near.ambient] };
    let (mut last, mut told) = (None, None);
    let before = if near.gap { &video.blurs_after_gap[..] } else { &[] };
    // Coarse stages have yet to bring the matches within reach.
    let before = before.iter().map(|&blur| (blur, joint.match_px));
    for (blur, match_px) in before.chain([(video.blur, video.match_px)]) {
        let full = body.carried(&state.vertices);
        let look = look(photo, body.full().rest, &full, blur, joint);
        // Where only the pose puts the matches: a shape that a wrong exposure has moved agrees with
        // it.
        let at = || AtMatches::of(&look, scene, matches, [posed; 2]);
        let at_matches = told.is_none().then(at).flatten();
        let seen = ImageSamples::of(look, body, &state.vertices, joint);
        let Told { gain, hold, options, .. } = told.get_or_insert_with(|| {
            let exposure = exposure_here(photo, at_matches);
            Told::of(frame, exposure, seen.log_gain, at_matches, joint, false)
        });
        let samples = seen.samples.len();
        let shading = Photometric::new(photo.camera, photo.light, &seen.image, rings, seen.samples);
        state.globals[0] = shading.log_gain(topology, &state.vertices, state.globals[1]);
        let problem = JointProblem {
            scene,
            matches,
            match_px,
            depth: hold,
            shading: &shading,
            hidden: &scene.posed,
            cues: None,
            gain: *gain,
            nodes: 0,
            options,
        };
        let (next, summary) = problem.objective().minimise_in(workspace, state, &solver);
        state = next;
        let residual = shading.mean_residual(topology, &state.vertices, &state.globals);
        last = Some((summary, samples, residual));
    }
    let last = last.expect("there is at least one blur");
    let told = told.expect("there is at least one blur");
    let gain = told.gain;
    (Joined::of(state, last, &told), gain.tells_distance(&photo.light.light, &joint.image))
}
