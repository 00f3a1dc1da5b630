//! The joint solve of a frame whose surface is nearly known: that of the frame before.
//!
//! A shape that is right but for what happens in a twenty-fifth of a second needs no coarse blur, no
//! annealing and no other starts: a few steps at the finest blur, from the last shape, with the
//! memory of the last solve.

use super::Photograph;
use super::joint::{JointOptions, depth_tolerance, look, objective};
use crate::energy::{Photometric, Unknowns, Workspace};
use crate::geometry::Point3;
use crate::register::{Match, Scene};
use crate::solver::Options;
use serde::{Deserialize, Serialize};

/// Options of the solve from the last shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VideoOptions {
    /// Blurs of image and albedo, coarse to fine, as fractions of the image diagonal.
    pub blurs: Vec<f64>,
    /// Steps of the solver at each.
    pub steps: usize,
    /// A step that lowers the cost by less than this part of it is the last.
    pub tolerance: f64,
    /// Three samples a face as long as they are no more than this, else one.
    pub max_samples: usize,
}

impl Default for VideoOptions {
    fn default() -> Self {
        Self { blurs: vec![0.0045], steps: 4, tolerance: 1e-3, max_samples: 3000 }
    }
}

/// What outlives a frame of the same template: symbolic factors and workspaces.
#[derive(Default)]
pub struct VideoMemory {
    workspace: Workspace,
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

/// Solve motion, prior and shading together, from a shape and an ambient light near the solution.
///
/// `depth_sigma` is eq. 3's tolerance for the depth of the matches under a distant light.
#[expect(clippy::too_many_arguments, reason = "one problem, its start and its memory")]
pub fn join_near(
    memory: &mut VideoMemory,
    scene: &Scene,
    (start, ambient): (&[Point3], f64),
    depth_sigma: f64,
    matches: &[Match],
    photo: &Photograph,
    joint: &JointOptions,
    video: &VideoOptions,
) -> Carried {
    let hold = depth_tolerance(scene, depth_sigma, &photo.light.light, joint);
    let joint = JointOptions { max_samples: video.max_samples, ..joint.clone() };
    let solver =
        Options { max_steps: video.steps, cost_tolerance: video.tolerance, ..Options::default() };
    let mut state = Unknowns { vertices: start.to_vec(), globals: vec![0.0, ambient] };
    let (mut samples, mut residual, mut steps) = (0, 0.0, 0);
    for &blur in &video.blurs {
        let look = look(photo, scene.rest, &state.vertices, blur, &joint);
        state.globals[0] = look.log_gain;
        let gain = photo.expected_log_gain.unwrap_or(look.log_gain);
        let problem = objective(scene, matches, hold, photo, &look, gain, &joint);
        let (next, summary) = problem.minimise_in(&mut memory.workspace, state, &solver);
        (state, steps) = (next, steps + summary.iterations);
        let topology = &scene.rest.topology;
        samples = look.samples.len();
        let seen = Photometric::new(photo.camera, photo.light, &look.image, topology, look.samples);
        residual = seen.mean_residual(&state.vertices, &state.globals);
    }
    Carried { vertices: state.vertices, ambient: state.globals[1], samples, residual, steps }
}
