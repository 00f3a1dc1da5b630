//! The solve of eq. 3: rounds where the surface bends as a whole, the annealing of the loss, the
//! coarse start.

use super::coarse::{RegisterMemory, coarser, on_coarser};
use super::correspondence::Match;
use super::objective::{MotionProblem, hold};
use super::{Posed, RegisterOptions, Scene};
use crate::camera::Camera;
use crate::energy::{Unknowns, Workspace};
use crate::geometry::{Point3, median};
use crate::mesh::laplacian::Laplacian;
use crate::solver::{Loss, Options, Summary};
use std::borrow::Cow;

/// The coarse shape V′.
#[derive(Clone, Debug)]
pub struct Registered {
    /// Vertices in camera axes.
    pub vertices: Vec<Point3>,
    /// Matches that the shape explains, in the order given.
    pub kept: Vec<bool>,
    /// Median reprojection error of the kept matches, px.
    pub residual_px: f64,
    /// Tolerance used for the depth of the matches, length units.
    pub depth_sigma: f64,
    /// The last solve of the annealing.
    pub summary: Summary,
}

/// The matches that a shape explains; `kept`: which, in the order of `matches`.
pub(crate) fn kept_matches(matches: &[Match], kept: &[bool]) -> Vec<Match> {
    matches.iter().zip(kept).filter(|m| *m.1).map(|m| *m.0).collect()
}

/// Solves at most where matches tell that the surface bends as a whole.
const ROUNDS: usize = 4;

/// Another round is worth its time where the displacement found is larger than the expected one by
/// this factor.
const GROWTH: f64 = 1.1;

/// A step that lowers the cost by less than this part of it is the last.
pub(super) const TOLERANCE: f64 = 1e-4;

/// How far a coarse mesh is solved: what is left is less than its own error.
const COARSE_TOLERANCE: f64 = 1e-4;

/// Steps under one loss at most: a bound on time.
pub(super) const STEPS: usize = 15;

/// Solve eq. 3 from the one rigid pose, with what an earlier frame of the same template has left; a
/// memory of another template is made again. The start of eq. 4 and of the joint solve, whose
/// images judge depth better than the strain between matches does (`docs/results/scenes.md`).
pub fn register_in(
    memory: &mut RegisterMemory,
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    options: &RegisterOptions,
) -> Registered {
    let displacement = expected_displacement(scene, posed, options);
    in_rounds(memory, scene, matches, displacement, &losses(options), options)
}

/// The rounds of eq. 3 from one rigid pose.
pub(super) fn in_rounds(
    memory: &mut RegisterMemory,
    scene: &Scene,
    matches: &[Match],
    mut displacement: f64,
    losses: &[Loss],
    options: &RegisterOptions,
) -> Registered {
    let hold = hold(scene, options);
    let mut state = scene.posed.clone();
    let (mut reposed, mut round): (Option<Scene>, usize) = (None, 1);
    let summary = loop {
        let scene = reposed.as_ref().unwrap_or(scene);
        let problem = MotionProblem { scene, matches, displacement, options };
        let (next, summary) = problem.solve(memory, state, losses, TOLERANCE);
        state = next;
        let moved = displacement_of(scene, matches, &state, options);
        if displacement <= hold || moved <= GROWTH * displacement || round == ROUNDS {
            break summary;
        }
        let again = scene.reposed(&state);
        (displacement, round, reposed) = (moved, round + 1, Some(again));
    };
    Registered::of(scene, matches, state, hold.hypot(displacement), summary, options)
}

/// Tolerance for the depth of the matches in a frame whose shape is nearly known, length units:
/// that of [`super::register`], whose rounds the known shape replaces.
pub(crate) fn depth_tolerance(
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    near: &[Point3],
    options: &RegisterOptions,
) -> f64 {
    hold(scene, options).hypot(displacement_near(scene, matches, posed, near, options))
}

fn displacement_near(
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    near: &[Point3],
    options: &RegisterOptions,
) -> f64 {
    let displacement = expected_displacement(scene, posed, options);
    if displacement <= hold(scene, options) {
        return displacement;
    }
    displacement.max(displacement_of(scene, matches, near, options))
}

/// Solve eq. 3 from a shape near the solution (that of the previous frame): the last loss alone,
/// and no rounds.
pub fn register_near(
    memory: &mut RegisterMemory,
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    near: &[Point3],
    options: &RegisterOptions,
) -> Registered {
    let displacement = displacement_near(scene, matches, posed, near, options);
    let problem = MotionProblem { scene, matches, displacement, options };
    let losses = losses(options);
    let start = Unknowns { vertices: near.to_vec(), globals: Vec::new() };
    // Few good steps: a start this near needs no more, and the next frame continues.
    let solver =
        Options { max_steps: 4, cost_tolerance: 1e-3, reduction: 0.03, ..Options::default() };
    let problem = problem.objective(losses[losses.len() - 1]);
    let (state, summary) = problem.minimise_in(&mut memory.workspace, start, &solver);
    let vertices = state.vertices;
    let depth_sigma = hold(scene, options).hypot(displacement);
    Registered::of(scene, matches, vertices, depth_sigma, summary, options)
}

impl Registered {
    pub(super) fn of(
        scene: &Scene,
        matches: &[Match],
        vertices: Vec<Point3>,
        depth_sigma: f64,
        summary: Summary,
        options: &RegisterOptions,
    ) -> Self {
        let (kept, residual_px) = explained(scene, matches, &vertices, options);
        Self { vertices, kept, residual_px, depth_sigma, summary }
    }
}

/// Which matches a shape explains, and their median reprojection error, px.
pub fn explained(
    scene: &Scene,
    matches: &[Match],
    shape: &[Point3],
    options: &RegisterOptions,
) -> (Vec<bool>, f64) {
    let errors = errors_px(scene, matches, shape);
    let limit = limit_px(options);
    let kept = errors.iter().map(|&e| e <= limit).collect();
    let mut inliers: Vec<f64> = errors.into_iter().filter(|&e| e <= limit).collect();
    (kept, median(&mut inliers).unwrap_or(f64::INFINITY))
}

impl MotionProblem<'_> {
    /// Anneal on a coarser mesh where there is one, else here from `start`, and solve the last loss
    /// here.
    pub(super) fn solve(
        &self,
        memory: &mut RegisterMemory,
        start: Vec<Point3>,
        losses: &[Loss],
        tolerance: f64,
    ) -> (Vec<Point3>, Summary) {
        let (start, losses) = match self.coarse_start(memory, losses) {
            Some(start) => (start, &losses[losses.len() - 1..]),
            None => (start, losses),
        };
        self.anneal(&mut memory.workspace, start, losses, tolerance)
    }

    /// The annealing on a mesh of some of the vertices, carried to all of them: it finds the
    /// matches that count and all but the finest part of the shape. `None` where there is no
    /// coarser mesh.
    fn coarse_start(&self, memory: &mut RegisterMemory, losses: &[Loss]) -> Option<Vec<Point3>> {
        let Self { scene, displacement, options, .. } = *self;
        let (decimated, memory) = coarser(&mut memory.coarse, scene)?;
        let laplacian = Cow::Owned(Laplacian::new(&decimated.mesh));
        let coarse = scene.on_some(&decimated.mesh, &decimated.kept, laplacian);
        let matches = &on_coarser(decimated, scene.rest, self.matches);
        let problem = MotionProblem { scene: &coarse, matches, displacement, options };
        let (found, _) = problem.solve(memory, coarse.posed.clone(), losses, COARSE_TOLERANCE);
        let carried = decimated.prolong(scene.rest, &coarse.displacement(&found));
        Some(scene.posed.iter().zip(carried).map(|(p, d)| p + d).collect())
    }

    /// Solve under one loss after another; only the last to the given tolerance, since the others
    /// merely lead there.
    fn anneal(
        &self,
        workspace: &mut Workspace,
        start: Vec<Point3>,
        losses: &[Loss],
        tolerance: f64,
    ) -> (Vec<Point3>, Summary) {
        let mut state = Unknowns { vertices: start, globals: Vec::new() };
        let mut summary = None;
        for (k, &loss) in losses.iter().enumerate() {
            let cost_tolerance = if k + 1 < losses.len() { 1e-2 } else { tolerance };
            let solver = Options { max_steps: STEPS, cost_tolerance, ..Options::default() };
            let (next, report) = self.objective(loss).minimise_in(workspace, state, &solver);
            (state, summary) = (next, Some(report));
        }
        (state.vertices, summary.expect("the annealing has at least one step"))
    }
}

/// Root mean square distance of the matches that a shape explains from where the rigid pose puts
/// them, length units.
fn displacement_of(
    scene: &Scene,
    matches: &[Match],
    shape: &[Point3],
    options: &RegisterOptions,
) -> f64 {
    let (errors, limit_px) = (errors_px(scene, matches, shape), limit_px(options));
    let squares: Vec<f64> = matches
        .iter()
        .zip(errors)
        .filter(|(_, error)| *error <= limit_px)
        .map(|(m, _)| (scene.point(m, shape) - scene.point(m, &scene.posed)).norm_squared())
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// A match further from a shape than this many of the last Geman-McClure scales is not explained by
/// it: nine tenths of the loss are spent there.
pub(crate) const EXPLAINED: f64 = 3.0;

/// The largest distance in the image at which a match is explained, px.
pub(crate) fn limit_px(options: &RegisterOptions) -> f64 {
    EXPLAINED * options.robust_px[1]
}

/// Losses of the annealing, coarse to fine.
fn losses(options: &RegisterOptions) -> Vec<Loss> {
    losses_from(options.robust_px[0], options)
}

/// The same from another coarsest scale, px.
pub(super) fn losses_from(coarse: f64, options: &RegisterOptions) -> Vec<Loss> {
    /// Finest scale over the coarsest: ten steps, whatever is asked for.
    const FINEST: f64 = 1e-4;
    let [coarse, fine] = [coarse, options.robust_px[1]].map(|px| px / options.match_sigma_px);
    let fine = fine.max(FINEST * coarse);
    let mut scales = vec![coarse];
    while scales[scales.len() - 1] > fine {
        scales.push((scales[scales.len() - 1] * 0.4).max(fine));
    }
    scales.into_iter().map(Loss::GemanMcClure).collect()
}

/// `d` from what neighbouring matches share in the image and the rigid pose cannot explain, carried
/// to length units at the depth of the surface.
pub(super) fn expected_displacement(
    scene: &Scene,
    posed: &Posed,
    options: &RegisterOptions,
) -> f64 {
    // Before a camera at rest it is what tissue moves across the line of sight, and says nothing of
    // depth.
    if posed.at_rest {
        return 0.0;
    }
    let [fx, fy] = scene.camera.focal;
    let depth = scene.posed.iter().map(|p| p.z).sum::<f64>() / scene.posed.len() as f64;
    options.depth_hold_motion * (posed.shared_motion_px * depth / (0.5 * (fx + fy)))
}

/// Reprojection error of every match on a shape, px; infinite behind the camera.
pub(crate) fn errors_px(scene: &Scene, matches: &[Match], shape: &[Point3]) -> Vec<f64> {
    let error = |m: &Match| {
        let seen = scene.camera.project(&scene.point(m, shape));
        seen.map_or(f64::INFINITY, |s| (s.pixel - m.pixel).norm())
    };
    matches.iter().map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::LightModel;
    use crate::register::pose;
    use crate::synth::{Case, CaseOptions, Draw};

    #[test]
    fn starting_on_a_coarse_mesh_ends_where_annealing_on_the_fine_one_does() {
        let options = CaseOptions {
            vertices: 1200,
            extension: 0.05,
            light: LightModel::Collinear,
            draw: Draw { count: 100, sigma_px: 1.0 },
            pull: true,
        };
        let mut case = Case::new(&options, 3);
        // One match in ten is wrong.
        case.matches.iter_mut().step_by(10).for_each(|m| m.pixel.x += 40.0);
        let options = RegisterOptions::default();
        let rest = &case.template.mesh;
        let posed = pose(&case.camera, rest, &case.matches, &options, 0).unwrap();
        let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
        let scene = Scene::new(&case.camera, rest, rigid);
        let mut memory = RegisterMemory::default();
        let found = register_in(&mut memory, &scene, &case.matches, &posed, &options);
        let displacement = expected_displacement(&scene, &posed, &options);
        let problem = MotionProblem {
            scene: &scene,
            matches: &case.matches,
            displacement,
            options: &options,
        };
        let start = scene.posed.clone();
        let (all, _) = problem.anneal(&mut Workspace::default(), start, &losses(&options), 1e-7);
        let squares = found.vertices.iter().zip(&all).map(|(a, b)| (a - b).norm_squared());
        let rms = (squares.sum::<f64>() / all.len() as f64).sqrt();
        // A match of 1 px is worth 0.1 mm here.
        assert!(rms < 0.01, "{rms} mm");
        let again = register_in(&mut memory, &scene, &case.matches, &posed, &options);
        assert_eq!(found.vertices, again.vertices);
    }
}
