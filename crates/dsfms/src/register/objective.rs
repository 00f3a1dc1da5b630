//! Eq. 3: motion, shearing, anisotropy, smoothing.

use super::pose::rest_point;
use super::{Match, Posed, RegisterOptions, Scene};
use crate::camera::{Camera, CameraModel};
use crate::energy::{
    Anisotropy, Boundary, Motion, Objective, Shearing, Smoothing, Stay, Stretch, Unknowns,
    Workspace,
};
use crate::geometry::{Point3, Vector3};
use crate::mesh::decimate::decimate;
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

/// Solve eq. 3 from the rigid pose.
pub fn register(
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    options: &RegisterOptions,
) -> Registered {
    let depth_sigma = depth_sigma(scene, posed, options);
    let losses = losses(options);
    let coarse = coarse_start(scene, matches, depth_sigma, options, &losses);
    let (start, losses) = match coarse {
        Some(start) => (start, &losses[losses.len() - 1..]),
        None => (scene.posed.clone(), &losses[..]),
    };
    let (state, summary) = anneal(scene, matches, depth_sigma, options, start, losses);
    let errors = errors_px(scene, matches, &state);
    let limit = 3.0 * options.robust_px[1];
    let kept: Vec<bool> = errors.iter().map(|&e| e <= limit).collect();
    let mut inliers: Vec<f64> = errors.into_iter().filter(|&e| e <= limit).collect();
    inliers.sort_unstable_by(f64::total_cmp);
    let residual_px = inliers.get(inliers.len() / 2).copied().unwrap_or(f64::INFINITY);
    Registered { vertices: state, kept, residual_px, depth_sigma, summary }
}

/// Eq. 3 under one loss after another; only the last is solved to the end.
fn anneal(
    scene: &Scene,
    matches: &[Match],
    depth_sigma: f64,
    options: &RegisterOptions,
    start: Vec<Point3>,
    losses: &[Loss],
) -> (Vec<Point3>, Summary) {
    let mut state = Unknowns { vertices: start, globals: Vec::new() };
    let (mut summary, mut workspace) = (None, Workspace::default());
    for (k, &loss) in losses.iter().enumerate() {
        let cost_tolerance = if k + 1 < losses.len() { 1e-2 } else { 1e-5 };
        let solver = Options { max_steps: 15, cost_tolerance, ..Options::default() };
        let objective = objective(scene, matches, depth_sigma, options, loss);
        let (next, report) = objective.minimise_in(&mut workspace, state, &solver);
        (state, summary) = (next, Some(report));
    }
    (state.vertices, summary.expect("the annealing has at least one step"))
}

/// Meshes of more vertices are first solved on a coarse one.
const COARSE_ABOVE: usize = 900;

/// Vertices of the coarse mesh.
const COARSE: usize = 300;

/// The annealing on a mesh of some of the vertices, carried to all of them: it finds the matches
/// that count and all but the finest part of the shape. `None` for a mesh that is coarse already, or
/// that cannot be made coarser.
fn coarse_start(
    scene: &Scene,
    matches: &[Match],
    depth_sigma: f64,
    options: &RegisterOptions,
    losses: &[Loss],
) -> Option<Vec<Point3>> {
    if scene.posed.len() <= COARSE_ABOVE || options.literal {
        return None;
    }
    let decimated = decimate(scene.rest, COARSE)?;
    let coarse = scene.on_some(&decimated.mesh, &decimated.kept);
    let carried = |m: &Match| {
        let (point, near) = (rest_point(scene.rest, m), scene.face(m)[0]);
        let (face, barycentric) = decimated.locate(&point, near)?;
        Some(Match { face, barycentric, pixel: m.pixel })
    };
    let matches: Vec<Match> = matches.iter().filter_map(carried).collect();
    let start = coarse.posed.clone();
    let (found, _) = anneal(&coarse, &matches, depth_sigma, options, start, losses);
    let displacement: Vec<Vector3> =
        found.iter().zip(&coarse.posed).map(|(now, posed)| now - posed).collect();
    let carried = decimated.prolong(scene.rest, &displacement);
    let fine = scene.posed.iter().zip(carried).map(|(p, d)| p + d);
    Some(fine.collect())
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
    depth_sigma: f64,
    options: &RegisterOptions,
    loss: Loss,
) -> Objective<'a> {
    let (rest, area) = (&scene.faces, scene.visible_area);
    let motion = motion(scene, matches, options.match_sigma_px);
    let repaired = if options.literal { 0.0 } else { 1.0 };
    let smoothing = if options.literal {
        Smoothing::of_position(&scene.laplacian, area)
    } else {
        Smoothing::of_displacement(&scene.laplacian, &scene.posed, area)
    };
    Objective::over(scene.posed.len(), 0)
        .plus(1.0, loss, motion)
        .plus(options.conformal, Loss::Squared, Shearing { rest })
        .plus(options.conformal, Loss::Squared, Anisotropy { rest })
        .plus(options.smoothing, Loss::Squared, smoothing)
        .plus(repaired * options.stretch, Loss::Squared, Stretch { rest })
        .plus(repaired, Loss::Huber(1.0), hold_depth(scene, matches, &scene.posed, depth_sigma))
        .plus(repaired * options.stay, Loss::Squared, stay(scene))
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

/// How far matches may leave the depth of the rigid pose: a floor relative to the visible radius
/// plus the motion that the rigid pose cannot explain, carried to length units at the matches'
/// depth.
fn depth_sigma(scene: &Scene, posed: &Posed, options: &RegisterOptions) -> f64 {
    let [fx, fy] = scene.camera.focal;
    let depth = scene.posed.iter().map(|p| p.z).sum::<f64>() / scene.posed.len() as f64;
    let unexplained = (posed.median_px() - 1.5 * options.match_sigma_px).max(0.0);
    let motion = unexplained * depth / (0.5 * (fx + fy));
    (options.depth_hold * scene.radius()).hypot(options.depth_hold_motion * motion)
}

/// Reprojection error of every match on a shape, px; infinite behind the camera.
pub fn errors_px(scene: &Scene, matches: &[Match], shape: &[Point3]) -> Vec<f64> {
    let error = |m: &Match| {
        let seen = scene.camera.project(&scene.point(m, shape));
        seen.map_or(f64::INFINITY, |s| (s.pixel - m.pixel).norm())
    };
    matches.iter().map(error).collect()
}
