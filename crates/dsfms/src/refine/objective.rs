//! Eq. 4: boundary condition, reprojection, diffuse and specular vertices, smoothing.

use super::RefineOptions;
use super::evidence::{Evidence, Photograph, gather_on};
use super::gain::GainPrior;
use crate::energy::{
    Diffuse, GlobalsPrior, Objective, Reprojection, Smoothing, Specular, Stay, Unknowns, Workspace,
};
use crate::geometry::Point3;
use crate::register::terms::hold_depth;
use crate::register::{Body, Match, Scene};
use crate::solver::{Loss, Options, Summary};

/// The fine shape V″.
#[derive(Clone, Debug)]
pub struct Refined {
    /// Vertices in camera axes, of the mesh that was solved on.
    pub vertices: Vec<Point3>,
    /// Exposure gain of the frame relative to the albedo.
    pub gain: f64,
    /// Ambient light, linear.
    pub ambient: f64,
    /// Vertices that carried the diffuse condition in the last round.
    pub diffuse_vertices: usize,
    /// Vertices that carried the specular condition in the last round.
    pub specular_vertices: usize,
    /// The last solve.
    pub summary: Summary,
}

impl Refined {
    /// On the full mesh of `body`, with the hidden side carried along by what is seen.
    pub fn settled(mut self, body: &Body, anchor: f64) -> Self {
        self.vertices = body.carried(&body.settled(self.vertices, anchor)).into_owned();
        self
    }
}

/// Solve eq. 4 from the coarse shape V′, holding the depth of the matches it was built on; shape and
/// matches are on the mesh of `body` that is solved on.
#[doc(alias("eq. 4", "photometric refinement"))]
pub fn refine(
    body: &Body,
    coarse: &[Point3],
    matches: &[Match],
    photo: &Photograph,
    options: &RefineOptions,
) -> Refined {
    let scene = body.scene();
    let mut evidence = gather_on(body, coarse, photo, options);
    let (sigma, ambient) = (options.gain_sigma, options.ambient_sigma);
    let prior = GainPrior::of(photo.exposure, evidence.log_gain, None, sigma, ambient);
    let start = if options.literal { 0.0 } else { evidence.log_gain };
    let mut state = Unknowns { vertices: coarse.to_vec(), globals: vec![start, 0.0] };
    let rounds = if options.literal { 1 } else { options.rounds.max(1) };
    let (mut round, mut workspace) = (0, Workspace::default());
    loop {
        let objective = objective(scene, coarse, matches, photo, &evidence, prior, options);
        let solver = Options { max_steps: 20, cost_tolerance: 1e-5, ..Options::default() };
        let (next, summary) = objective.minimise_in(&mut workspace, state, &solver);
        round += 1;
        if round == rounds {
            return Refined {
                gain: next.globals[0].exp(),
                ambient: next.globals[1],
                vertices: next.vertices,
                diffuse_vertices: evidence.diffuse.len(),
                specular_vertices: evidence.specular.len(),
                summary,
            };
        }
        state = next;
        evidence = gather_on(body, &state.vertices, photo, options);
    }
}

/// The lines of eq. 4, with the repairs of DESIGN.md.
fn objective<'a>(
    scene: &'a Scene,
    coarse: &[Point3],
    matches: &[Match],
    photo: &Photograph<'a>,
    evidence: &'a Evidence,
    prior: GainPrior,
    options: &RefineOptions,
) -> Objective<'a> {
    let topology = &scene.rest.topology;
    let count = evidence.visible.iter().filter(|v| **v).count().max(1);
    let share = options.reference_count / count as f64;
    let seen = (0..coarse.len() as u32).filter(|&v| evidence.visible[v as usize]);
    // Brightness tells the distance from a near light as well as the exposure is known.
    let near = photo.light.light.tells_distance() && !options.literal;
    let slack = if near { prior.slack(options.gain_sigma) } else { 1.0 };
    let sigmas = vec![slack * options.depth_hold * scene.radius(); matches.len()];
    let boundary = hold_depth(scene, matches, coarse, sigmas);
    let reprojection = Reprojection::at(scene.camera, coarse, seen);
    let diffuse =
        Diffuse::new(photo.camera, photo.light, &evidence.image, topology, &evidence.diffuse);
    let specular = Specular::new(topology, &evidence.specular, 1.0);
    let literal = options.literal;
    let smoothing = if literal {
        Smoothing::of_position(&scene.laplacian, scene.visible_area)
    } else {
        Smoothing::of_displacement(&scene.laplacian, coarse, scene.visible_area)
    };
    let (depth_loss, diffuse_loss) = if literal {
        (Loss::Norm, Loss::Squared)
    } else {
        (Loss::Squared, Loss::Huber(options.huber))
    };
    // Printed form: no gain, no ambient; a spread of 10⁻⁶ holds them at 1 and 0.
    let [gain_sigma, ambient_sigma, gain_mean] = if literal {
        [1e-6, 1e-6, 0.0]
    } else {
        [prior.sigma, prior.ambient_sigma, prior.expected]
    };
    Objective::over(coarse.len(), 2)
        .plus(1.0, depth_loss, boundary)
        .plus(share * options.reprojection, Loss::Squared, reprojection)
        .plus(share * options.diffuse, diffuse_loss, diffuse)
        .plus(share * options.specular, Loss::Squared, specular)
        .plus(options.smoothing, Loss::Squared, smoothing)
        .plus(if literal { 0.0 } else { 3.0 }, Loss::Squared, stay(scene, coarse, evidence))
        .plus(1.0, Loss::Squared, GlobalsPrior::of(0, gain_mean, gain_sigma))
        .plus(1.0, Loss::Squared, GlobalsPrior::of(1, 0.0, ambient_sigma))
}

/// Hidden vertices stay near V′.
fn stay(scene: &Scene, coarse: &[Point3], evidence: &Evidence) -> Stay {
    let hidden: Vec<usize> = (0..coarse.len()).filter(|&v| !evidence.visible[v]).collect();
    Stay {
        vertices: hidden.iter().map(|&v| [v as u32]).collect(),
        reference: hidden.iter().map(|&v| coarse[v]).collect(),
        weights: hidden.iter().map(|&v| scene.laplacian.mass[v] / scene.visible_area).collect(),
        sigma: 0.04 * scene.radius(),
    }
}
