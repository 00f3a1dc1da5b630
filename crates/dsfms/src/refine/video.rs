//! The joint solve of a frame whose surface is nearly known: that of the frame before.
//!
//! A shape that is right but for what happens in a twenty-fifth of a second needs no coarse blur, no
//! annealing and no other starts: a few steps at the finest blur, from the last shape, with the
//! memory of the last solve.

use super::Photograph;
use super::gain::GainPrior;
use super::hold::hold;
use super::joint::{JointOptions, held, shaded};
use super::samples::{Seen, look};
use crate::energy::{FaceRings, Photometric, Unknowns, Workspace};
use crate::geometry::Point3;
use crate::register::{Body, Match, Scene};
use crate::solver::Options;
use serde::{Deserialize, Serialize};

/// Options of the solve from the last shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VideoOptions {
    /// Blur of image and albedo, as a fraction of the image diagonal.
    pub blur: f64,
    /// Blurs before it, coarse to fine, where the last shape is that of many frames ago.
    pub blurs_after_gap: Vec<f64>,
    /// Steps of the solver at each.
    pub steps: usize,
    /// A step that lowers the cost by less than this part of it is the last.
    pub tolerance: f64,
    /// The linear systems' residual is reduced by this factor: few good steps, since each costs a new
    /// linearisation.
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
}

/// What outlives a frame of the same template: symbolic factors and workspaces.
#[derive(Default)]
pub struct VideoMemory {
    workspace: Workspace,
    rings: Option<FaceRings>,
}

/// A shape near that of the frame, and the ambient light that went with it.
#[derive(Clone, Copy, Debug)]
pub struct Near<'a> {
    /// Vertices in camera axes.
    pub shape: &'a [Point3],
    /// Linear light.
    pub ambient: f64,
    /// The shape is that of many frames ago.
    pub gap: bool,
}

/// The shape of a frame.
#[derive(Clone, Debug)]
pub struct Carried {
    /// Vertices in camera axes.
    pub vertices: Vec<Point3>,
    /// Ambient light, linear.
    pub ambient: f64,
    /// Photometric samples.
    pub samples: usize,
    /// Mean of `|image − prediction| / image` over them.
    pub residual: f64,
    /// Steps taken.
    pub steps: usize,
}

/// A frame to solve from a shape near it.
pub struct NearFrame<'a> {
    /// The rest shape posed where bending is counted from, and what of it is seen.
    pub scene: &'a Scene<'a>,
    /// Where the template's points are.
    pub matches: &'a [Match],
    /// The rest shape where the matches pose it: their depth is held to it.
    pub posed: &'a [Point3],
    /// Eq. 3's tolerance for the depth of the matches, under a distant light.
    pub depth_sigma: f64,
    /// The image.
    pub photo: &'a Photograph<'a>,
}

/// Solve motion, prior and shading together, from a shape near the solution.
pub fn join_near(
    memory: &mut VideoMemory,
    frame: &NearFrame,
    near: Near,
    joint: &JointOptions,
    video: &VideoOptions,
) -> Carried {
    let joint = JointOptions { max_samples: video.max_samples, ..joint.clone() };
    let solver = Options {
        max_steps: video.steps,
        cost_tolerance: video.tolerance,
        reduction: video.reduction,
        ..Options::default()
    };
    let start = Unknowns { vertices: near.shape.to_vec(), globals: vec![0.0, near.ambient] };
    let VideoMemory { workspace, rings } = memory;
    let rings = &*rings.get_or_insert_with(|| {
        let rings = FaceRings::of(&frame.scene.rest.topology);
        // Whatever face comes into view, the system has its blocks.
        *workspace = Workspace::reserved(near.shape.len(), 2, rings.stencils());
        rings
    });
    let mut found = (start, 0, 0.0, 0);
    let before = if near.gap { &video.blurs_after_gap[..] } else { &[] };
    let (matches, light) = (frame.matches, &frame.photo.light.light);
    let hold = hold(frame.scene, matches, frame.posed, frame.depth_sigma, light, &joint, 1.0);
    for (stage, &blur) in before.iter().chain([&video.blur]).enumerate() {
        // Coarse stages have yet to bring the matches within reach.
        let match_px = if stage < before.len() { joint.match_px } else { video.match_px };
        let (mut state, _, _, steps) = found;
        let NearFrame { scene, photo, .. } = *frame;
        let body = Body::plain(scene);
        let look = look(photo, scene.rest, &state.vertices, blur, &joint);
        let seen = Seen::of(look, &body, &state.vertices, None, &joint);
        let topology = &scene.rest.topology;
        let (image, samples) = (&seen.image, seen.samples);
        let count = samples.len();
        let shading = Photometric::new(photo.camera, photo.light, image, rings, samples);
        state.globals[0] = shading.log_gain(topology, &state.vertices, state.globals[1]);
        let expected = photo.exposure.map_or(seen.log_gain, |e| e.log_gain);
        let held = held(scene, matches, match_px, 2, &joint);
        let gain = GainPrior::free(expected, joint.gain_sigma, joint.ambient_sigma);
        let problem = shaded(held, scene, hold.clone(), shading.clone(), gain, &joint);
        let (state, summary) = problem.minimise_in(workspace, state, &solver);
        let residual = shading.mean_residual(topology, &state.vertices, &state.globals);
        found = (state, count, residual, steps + summary.iterations);
    }
    let (state, samples, residual, steps) = found;
    Carried { vertices: state.vertices, ambient: state.globals[1], samples, residual, steps }
}
