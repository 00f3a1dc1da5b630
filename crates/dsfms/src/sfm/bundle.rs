//! Bundle adjustment (paper §4) in double precision: poses, points and, under priors, intrinsics
//! that all views share, some, or none, from reprojection errors under a robust loss.
//!
//! ```text
//! min Σ ρ(‖(Π_c(v)(T_v X_p) − x_vp)/σ_vp‖²) + Σ_c Σ ((θ_c − θ₀_c)/σ_θ)²
//! ```
//!
//! Levenberg–Marquardt; points or poses, whichever leaves the smaller system, are eliminated (Schur
//! complement) and the reduced system is dense, which suits up to about 200 views or 400 points.
//! Gauge: fixed views hold the frame; the scale, when fewer than two are fixed, is held by the
//! damping alone. All sums run over a fixed partition in a fixed order, so the result has the same
//! bits at any number of threads.

mod covariance;
mod problem;

pub use covariance::{Covariance, covariance};
pub use problem::{Bundle, BundleError, BundleObservation, BundleOptions};

use super::intrinsics::{self, COUNT};
use super::resection::{pose_jacobian, retract};
use super::schur::{BundleLayout, BundleRow, Eliminate, solve};
use crate::camera::{Camera, CameraModel};
use crate::geometry::Vector3;
use crate::solver::{Loss, Options, Problem, Step, Summary, minimize};
use nalgebra::Vector6;
use rayon::prelude::*;

/// Minimise the bundle's cost in place; never returns a state that costs more than the start.
///
/// # Errors
/// An option out of its bounds, a bundle without observations, with indices that do not exist, or
/// with points behind their cameras.
#[doc(alias("bundle adjustment", "BA"))]
pub fn adjust(bundle: &mut Bundle, options: &BundleOptions) -> Result<Summary, BundleError> {
    options.validate()?;
    check_cameras(bundle)?;
    let layout = BundleLayout::new(bundle, &options.refine.active());
    sort(bundle, layout.eliminate)?;
    for camera in &mut bundle.cameras {
        *camera = intrinsics::prepared(camera, &options.refine);
    }
    let both = bundle.cameras.iter().zip(&bundle.priors);
    let offset = both.map(|(c, prior)| intrinsics::difference(c, prior)).collect();
    let (prior, loss) = (IntrinsicsPrior::new(bundle, options), options.loss);
    let mut adjustment = Adjustment { layout, prior, loss, rows: Vec::new(), normal: Vec::new() };
    let solver = Options {
        max_steps: options.max_steps,
        cost_tolerance: options.cost_tolerance,
        initial_damping: 1e-4,
        // Nothing else holds the scale.
        least_damping: 1e-12,
        fastest: 1.0,
        ..Options::default()
    };
    let start = Adjusted { bundle: bundle.clone(), offset };
    let (end, summary) = minimize(&mut adjustment, start, &solver);
    if summary.terms.is_empty() {
        return Err(BundleError::Infeasible(count_infeasible(bundle)));
    }
    *bundle = end.bundle;
    Ok(summary)
}

/// The problem, and its last linearisation.
struct Adjustment {
    layout: BundleLayout,
    prior: IntrinsicsPrior,
    loss: Loss,
    rows: Vec<BundleRow>,
    /// Of the priors: second derivative and gradient of each active intrinsic.
    normal: Vec<(f64, f64)>,
}

/// A bundle, and how far its intrinsics are from the middle of their priors.
#[derive(Clone)]
struct Adjusted {
    bundle: Bundle,
    offset: Vec<[f64; COUNT]>,
}

impl Problem for Adjustment {
    type State = Adjusted;

    fn costs(&self, state: &Adjusted) -> Option<Vec<f64>> {
        let reprojection = reprojection_cost(&state.bundle, self.loss)?;
        Some(vec![reprojection, self.prior.cost(&state.offset)])
    }

    fn labels(&self) -> Vec<&'static str> {
        vec!["reprojection (bundle adjustment)", "prior on the intrinsics"]
    }

    fn linearise(&mut self, state: &Adjusted) -> f64 {
        self.rows = linearise(&state.bundle, self.loss);
        self.normal = self.prior.normal(&state.offset);
        f64::INFINITY
    }

    fn step(&mut self, damping: f64) -> Option<Step> {
        solve(&self.rows, &self.layout, &self.normal, damping)
    }

    /// `delta`: six numbers a pose, three a point, then the active intrinsics of every camera.
    fn retract(&self, state: &Adjusted, delta: &[f64]) -> Adjusted {
        let mut moved = state.clone();
        let (poses, rest) = delta.split_at(6 * state.bundle.poses.len());
        let (points, intrinsics) = rest.split_at(3 * state.bundle.points.len());
        for (v, d) in poses.chunks_exact(6).enumerate() {
            if !state.bundle.fixed[v] {
                let pose = &mut moved.bundle.poses[v];
                *pose = retract(pose, &Vector6::from_column_slice(d));
            }
        }
        for (point, d) in moved.bundle.points.iter_mut().zip(points.chunks_exact(3)) {
            *point += Vector3::new(d[0], d[1], d[2]);
        }
        let active = &self.layout.intrinsics;
        for (c, camera) in moved.bundle.cameras.iter_mut().enumerate() {
            let mut change = [0.0; COUNT];
            for (&k, d) in active.iter().zip(&intrinsics[c * active.len()..]) {
                change[k] = *d;
            }
            *camera = intrinsics::retract(camera, &change);
            moved.offset[c] = std::array::from_fn(|k| state.offset[c][k] + change[k]);
        }
        moved
    }
}

/// Gaussian prior on the refined intrinsics of every camera about their starting values.
struct IntrinsicsPrior {
    sigmas: Vec<[f64; COUNT]>,
    active: Vec<usize>,
}

impl IntrinsicsPrior {
    fn new(bundle: &Bundle, options: &BundleOptions) -> Self {
        let per_view = bundle.observations.len() as f64 / bundle.poses.len().max(1) as f64;
        let sigmas = |camera: &CameraModel| {
            intrinsics::prior_sigmas(camera, per_view).map(|sigma| sigma * options.prior_scale)
        };
        let sigmas = bundle.cameras.iter().map(sigmas).collect();
        Self { sigmas, active: options.refine.active() }
    }

    /// `1/σ²` of every active parameter, camera by camera.
    fn weights(&self) -> impl Iterator<Item = f64> {
        self.sigmas.iter().flat_map(|sigmas| self.active.iter().map(|&k| sigmas[k].powi(-2)))
    }

    /// Offset and deviation of every active parameter, camera by camera.
    fn pairs(&self, offset: &[[f64; COUNT]]) -> impl Iterator<Item = (f64, f64)> {
        let cameras = offset.iter().zip(&self.sigmas);
        cameras.flat_map(|(offset, sigmas)| self.active.iter().map(|&k| (offset[k], sigmas[k])))
    }

    fn cost(&self, offset: &[[f64; COUNT]]) -> f64 {
        self.pairs(offset).map(|(offset, sigma)| (offset / sigma).powi(2)).sum()
    }

    /// Second derivative and gradient (halved) for each active parameter.
    fn normal(&self, offset: &[[f64; COUNT]]) -> Vec<(f64, f64)> {
        self.pairs(offset).map(|(offset, s)| (s.powi(-2), s.powi(-2) * offset)).collect()
    }
}

fn check_cameras(bundle: &Bundle) -> Result<(), BundleError> {
    let [views, cameras, priors] = [bundle.poses.len(), bundle.cameras.len(), bundle.priors.len()];
    let named = bundle.camera_of.iter().filter(|c| **c < cameras).count();
    let good = named == views && bundle.camera_of.len() == views && priors == cameras;
    if good { Ok(()) } else { Err(BundleError::Cameras { views, named, cameras, priors }) }
}

fn sort(bundle: &mut Bundle, by: Eliminate) -> Result<(), BundleError> {
    if bundle.observations.is_empty() {
        return Err(BundleError::Empty);
    }
    for (i, o) in bundle.observations.iter().enumerate() {
        if o.view >= bundle.poses.len() || o.point >= bundle.points.len() {
            return Err(BundleError::Index(i, o.view, o.point));
        }
    }
    match by {
        Eliminate::Points => bundle.observations.sort_by_key(|o| (o.point, o.view)),
        Eliminate::Poses => bundle.observations.sort_by_key(|o| (o.view, o.point)),
    }
    Ok(())
}

/// Squared error in units of σ; `None` behind the camera.
fn squared_error(bundle: &Bundle, o: &BundleObservation) -> Option<f64> {
    let camera = &bundle.cameras[bundle.camera_of[o.view]];
    let seen = camera.project(&(bundle.poses[o.view] * bundle.points[o.point]))?;
    Some((seen.pixel - o.pixel).norm_squared() / (o.sigma_px * o.sigma_px))
}

/// `Σ ρ`, summed in a fixed order; `None` when a point has no projection (an infeasible step).
fn reprojection_cost(bundle: &Bundle, loss: Loss) -> Option<f64> {
    let chunk = |chunk: &[BundleObservation]| -> Option<f64> {
        chunk.iter().map(|o| squared_error(bundle, o).map(|s| loss.evaluate(s).0)).sum()
    };
    let parts: Vec<Option<f64>> = bundle.observations.par_chunks(2048).map(chunk).collect();
    parts.into_iter().sum::<Option<f64>>().filter(|c| c.is_finite())
}

fn count_infeasible(bundle: &Bundle) -> usize {
    bundle.observations.iter().filter(|o| squared_error(bundle, o).is_none()).count()
}

/// Residual and derivatives of every observation, scaled by `√ρ′/σ`.
fn linearise(bundle: &Bundle, loss: Loss) -> Vec<BundleRow> {
    let row = |o: &BundleObservation| -> Option<BundleRow> {
        let pose = &bundle.poses[o.view];
        let camera = bundle.camera_of[o.view];
        let local = pose * bundle.points[o.point];
        let seen = bundle.cameras[camera].project(&local)?;
        let residual = seen.pixel - o.pixel;
        let weight = loss.evaluate(residual.norm_squared() / (o.sigma_px * o.sigma_px)).1;
        let scale = weight.sqrt() / o.sigma_px;
        Some(BundleRow {
            view: o.view,
            point: o.point,
            camera,
            residual: residual * scale,
            by_pose: pose_jacobian(&seen.jacobian, &local) * scale,
            by_point: seen.jacobian * pose.rotation.to_rotation_matrix().matrix() * scale,
            by_intrinsics: intrinsics::jacobian(&bundle.cameras[camera], &local, &seen.pixel)
                * scale,
        })
    };
    bundle.observations.par_iter().with_min_len(512).filter_map(row).collect()
}

#[cfg(test)]
mod tests;
