//! Eq. 3: motion, shearing, anisotropy, smoothing.

use super::{Match, Posed, Prior, RegisterOptions, Scene};
use crate::camera::{Camera, CameraModel};
use crate::energy::{
    Anisotropy, Arap, Boundary, Isometric, Motion, Objective, Shearing, Smoothing, Stay, Stretch,
    Unknowns,
};
use crate::geometry::Point3;
use crate::solver::{Loss, Options, Summary};

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

/// Solves at most where matches tell that the surface bends as a whole.
const ROUNDS: usize = 4;

/// Solve eq. 3 from the rigid pose.
///
/// Where neighbouring matches share a motion that the pose does not explain and that the depth hold
/// would not allow, the surface bends as a whole and no part of it gives the pose: the solve is then
/// repeated from the rest shape posed anew, with smoothing and depth hold loosened to the motion
/// found, until that no longer grows.
pub fn register(
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    options: &RegisterOptions,
) -> Registered {
    let hold = options.depth_hold * scene.radius();
    let mut motion = options.depth_hold_motion * unexplained_motion(scene, posed);
    let mut state = Unknowns { vertices: scene.posed.clone(), globals: Vec::new() };
    let (mut reposed, mut round): (Option<Scene>, usize) = (None, 1);
    let summary = loop {
        let scene = reposed.as_ref().unwrap_or(scene);
        let (next, summary) = anneal(scene, matches, motion, options, state);
        state = next;
        let moved = displacement(scene, matches, &state.vertices, 3.0 * options.robust_px[1]);
        if options.literal || motion <= hold || moved <= 1.1 * motion || round == ROUNDS {
            break summary;
        }
        let anew = scene.reposed(&state.vertices);
        (motion, round, reposed) = (moved, round + 1, Some(anew));
    };
    let errors = errors_px(scene, matches, &state.vertices);
    let limit = 3.0 * options.robust_px[1];
    let kept: Vec<bool> = errors.iter().map(|&e| e <= limit).collect();
    let mut inliers: Vec<f64> = errors.into_iter().filter(|&e| e <= limit).collect();
    inliers.sort_unstable_by(f64::total_cmp);
    let residual_px = inliers.get(inliers.len() / 2).copied().unwrap_or(f64::INFINITY);
    let depth_sigma = hold.hypot(motion);
    Registered { vertices: state.vertices, kept, residual_px, depth_sigma, summary }
}

/// One solve of eq. 3, coarse to fine, for a surface expected to move by `motion`.
fn anneal(
    scene: &Scene,
    matches: &[Match],
    motion: f64,
    options: &RegisterOptions,
    mut state: Unknowns,
) -> (Unknowns, Summary) {
    let depth_sigma = (options.depth_hold * scene.radius()).hypot(motion);
    let solver = Options { max_steps: 15, cost_tolerance: 1e-5, ..Options::default() };
    let mut summary = None;
    for loss in losses(options) {
        let smoothing = smoothing_weight(options, motion / scene.radius());
        let objective = objective(scene, matches, [depth_sigma, smoothing], options, loss);
        let (next, report) = objective.minimise(state, &solver);
        (state, summary) = (next, Some(report));
    }
    (state, summary.expect("the annealing has at least one step"))
}

/// Root mean square distance of the matches that a shape explains within `limit_px` from where the
/// rigid pose puts them, length units.
fn displacement(scene: &Scene, matches: &[Match], shape: &[Point3], limit_px: f64) -> f64 {
    let errors = errors_px(scene, matches, shape);
    let squares: Vec<f64> = matches
        .iter()
        .zip(errors)
        .filter(|(_, error)| *error <= limit_px)
        .map(|(m, _)| (scene.point(m, shape) - scene.point(m, &scene.posed)).norm_squared())
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// Losses of the annealing, coarse to fine; one unsquared norm for the printed form.
fn losses(options: &RegisterOptions) -> Vec<Loss> {
    if options.literal {
        return vec![Loss::Norm];
    }
    let [coarse, fine] = options.robust_px.map(|px| px / options.match_sigma_px);
    let mut scales = vec![coarse];
    while scales[scales.len() - 1] > fine {
        scales.push((scales[scales.len() - 1] * 0.4).max(fine));
    }
    scales.into_iter().map(Loss::GemanMcClure).collect()
}

/// The lines of eq. 3, with the repairs of DESIGN.md.
fn objective<'a>(
    scene: &'a Scene,
    matches: &[Match],
    [depth_sigma, smoothing_weight]: [f64; 2],
    options: &RegisterOptions,
    loss: Loss,
) -> Objective<'a> {
    let area = scene.visible_area;
    let motion = motion(scene, matches, options.match_sigma_px);
    let repaired = if options.literal { 0.0 } else { 1.0 };
    let smoothing = if options.literal {
        Smoothing::of_position(&scene.laplacian, area)
    } else {
        Smoothing::of_displacement(&scene.laplacian, &scene.posed, area)
    };
    let motion = Objective::over(scene.posed.len(), 0).plus(1.0, loss, motion);
    let weights = [options.conformal, repaired * options.stretch];
    keep(motion, scene, options.prior, Loss::Squared, weights)
        .plus(smoothing_weight, Loss::Squared, smoothing)
        .plus(repaired, Loss::Huber(1.0), hold_depth(scene, matches, &scene.posed, depth_sigma))
        .plus(repaired * options.stay, Loss::Squared, stay(scene))
}

/// What the surface keeps of its rest shape, with the loss of its strains; the second weight is that
/// of stretch and counts for the conformal prior alone.
pub fn keep<'a>(
    objective: Objective<'a>,
    scene: &'a Scene,
    prior: Prior,
    loss: Loss,
    [weight, stretch]: [f64; 2],
) -> Objective<'a> {
    let rest = &scene.faces;
    match prior {
        Prior::Conformal => objective
            .plus(weight, loss, Shearing { rest })
            .plus(weight, loss, Anisotropy { rest })
            .plus(stretch, loss, Stretch { rest }),
        Prior::Isometric => objective.plus(weight, loss, Isometric { rest }),
        Prior::Arap => {
            let arap = Arap::new(&scene.laplacian, &scene.posed, scene.visible_area);
            objective.plus(weight, loss, arap)
        }
    }
}

/// The motion term of a scene.
pub fn motion<'a>(scene: &Scene<'a>, matches: &[Match], sigma_px: f64) -> Motion<'a, CameraModel> {
    Motion {
        camera: scene.camera,
        faces: matches.iter().map(|m| scene.face(m)).collect(),
        barycentrics: matches.iter().map(|m| m.barycentric).collect(),
        pixels: matches.iter().map(|m| m.pixel).collect(),
        sigma_px,
    }
}

/// The depth of the matches held to that of a shape.
pub fn hold_depth(scene: &Scene, matches: &[Match], shape: &[Point3], sigma: f64) -> Boundary {
    Boundary {
        faces: matches.iter().map(|m| scene.face(m)).collect(),
        barycentrics: matches.iter().map(|m| m.barycentric).collect(),
        depths: matches.iter().map(|m| scene.point(m, shape).z).collect(),
        sigma,
    }
}

/// Hidden vertices held to the rigid pose, each by its share of the visible area, within a
/// twenty-fifth of the visible radius.
pub fn stay(scene: &Scene) -> Stay {
    let hidden: Vec<usize> = (0..scene.posed.len()).filter(|&v| !scene.visible[v]).collect();
    Stay {
        vertices: hidden.iter().map(|&v| [v as u32]).collect(),
        reference: hidden.iter().map(|&v| scene.posed[v]).collect(),
        weights: hidden.iter().map(|&v| scene.laplacian.mass[v] / scene.visible_area).collect(),
        sigma: 0.04 * scene.radius(),
    }
}

/// Motion that neighbouring matches share and the rigid pose cannot explain, carried to length units
/// at the depth of the surface.
fn unexplained_motion(scene: &Scene, posed: &Posed) -> f64 {
    let [fx, fy] = scene.camera.focal;
    let depth = scene.posed.iter().map(|p| p.z).sum::<f64>() / scene.posed.len() as f64;
    posed.shared_motion_px * depth / (0.5 * (fx + fy))
}

/// The weight of smoothing where matches say that the surface bends as a whole by `motion` (of the
/// visible radius). A disc of radius 1 that bulges by `d` has a Laplacian of `8 d` (up to its
/// profile), whose expectation the weight should not contradict: `1/λ′ = 1/λ + (8 d)²`.
fn smoothing_weight(options: &RegisterOptions, motion: f64) -> f64 {
    let contradiction = if options.literal { 0.0 } else { (8.0 * motion).powi(2) };
    options.smoothing / (1.0 + options.smoothing * contradiction)
}

/// Reprojection error of every match on a shape, px; infinite behind the camera.
pub fn errors_px(scene: &Scene, matches: &[Match], shape: &[Point3]) -> Vec<f64> {
    let error = |m: &Match| {
        let seen = scene.camera.project(&scene.point(m, shape));
        seen.map_or(f64::INFINITY, |s| (s.pixel - m.pixel).norm())
    };
    matches.iter().map(error).collect()
}
