//! Bundle adjustment (paper §4) in double precision: poses, points and, under priors, the shared
//! intrinsics, from reprojection errors under a robust loss.
//!
//! ```text
//! min Σ ρ(‖(Π(T_v X_p) − x_vp)/σ_vp‖²) + Σ ((θ − θ₀)/σ_θ)²
//! ```
//!
//! Levenberg–Marquardt; points or poses, whichever leaves the smaller system, are eliminated (Schur
//! complement) and the reduced system is dense, which suits up to about 200 views or 400 points.
//! Gauge: fixed views hold the frame; the scale, when fewer than two are fixed, is held by the damping
//! alone. All sums run over a fixed partition in a fixed order, so the result has the same bits at any
//! number of threads.

use super::intrinsics::{self, COUNT, RefineIntrinsics};
use super::resection::{pose_jacobian, retract};
use super::schur::{Eliminate, Layout, Row, Step, solve};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3};
use crate::solver::{Loss, Stop, Summary, TermCost};
use rayon::prelude::*;
use std::time::Instant;

/// One sighting of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BundleObservation {
    /// Index of the view.
    pub view: usize,
    /// Index of the point.
    pub point: usize,
    /// Where it was seen, px.
    pub pixel: Point2,
    /// Standard deviation of `pixel`, px.
    pub sigma_px: f64,
}

/// The unknowns and what was seen; [`adjust`] changes the unknowns in place.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// Shared camera.
    pub camera: CameraModel,
    /// About what the priors on the intrinsics are centred: the camera as it was given, not as
    /// an earlier adjustment left it, else repeated adjustments could drift away.
    pub prior: CameraModel,
    /// `camera_from_world` of every view.
    pub poses: Vec<Isometry>,
    /// Views whose pose is not changed.
    pub fixed: Vec<bool>,
    /// Points in world axes.
    pub points: Vec<Point3>,
    /// Sightings, in any order.
    pub observations: Vec<BundleObservation>,
}

/// Options of [`adjust`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BundleOptions {
    /// Loss on the squared error in units of σ.
    pub loss: Loss,
    /// Largest number of linearisations.
    pub max_steps: usize,
    /// Stop when an accepted step lowers the cost by less than this fraction.
    pub cost_tolerance: f64,
    /// Intrinsics to refine.
    pub refine: RefineIntrinsics,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self {
            loss: Loss::Huber(1.0),
            max_steps: 50,
            cost_tolerance: 1e-7,
            refine: RefineIntrinsics::default(),
        }
    }
}

/// Why there was nothing to adjust.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BundleError {
    /// An index of an observation is out of range.
    #[error("observation {0} names view {1} and point {2}, which do not both exist")]
    Index(usize, usize, usize),
    /// A point has no projection at the start.
    #[error("{0} observations cannot be projected at the start (point behind the camera)")]
    Infeasible(usize),
    /// No free unknown is observed.
    #[error("nothing to adjust: no observations")]
    Empty,
}

/// Minimise the bundle's cost in place; never returns a state that costs more than the start.
pub fn adjust(bundle: &mut Bundle, options: &BundleOptions) -> Result<Summary, BundleError> {
    let began = Instant::now();
    let layout = Layout::new(bundle, &options.refine.active());
    sort(bundle, layout.eliminate)?;
    bundle.camera = intrinsics::prepared(&bundle.camera, &options.refine);
    let per_view = bundle.observations.len() as f64 / bundle.poses.len().max(1) as f64;
    let prior = Prior {
        sigmas: intrinsics::prior_sigmas(&bundle.camera, per_view),
        active: options.refine.active(),
    };
    let mut offset = intrinsics::difference(&bundle.camera, &bundle.prior);
    let prior_before = prior.cost(&offset);
    let mut cost = reprojection_cost(bundle, options.loss)
        .ok_or_else(|| BundleError::Infeasible(count_infeasible(bundle)))?;
    let before = cost;
    let (mut accepted, mut refused, mut damping, mut growth) = (0, 0, 1e-4, 2.0);
    let mut stop = Stop::StepLimit;
    'outer: for _ in 0..options.max_steps {
        let rows = linearise(bundle, options.loss);
        loop {
            let total = cost + prior.cost(&offset);
            let trial = solve(&rows, &layout, &prior.normal(&offset), damping).map(|step| {
                let (trial, trial_offset) = apply(bundle, &layout, &offset, &step);
                (reprojection_cost(&trial, options.loss), trial, trial_offset, step.promise)
            });
            if let Some((Some(trial_cost), trial, trial_offset, promise)) = trial {
                let gained = total - trial_cost - prior.cost(&trial_offset);
                if gained > 0.0 {
                    let quality = gained / promise.max(1e-300);
                    damping =
                        (damping * (1.0 - (2.0 * quality - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-12);
                    growth = 2.0;
                    (*bundle, offset, cost) = (trial, trial_offset, trial_cost);
                    accepted += 1;
                    if gained <= options.cost_tolerance * total {
                        stop = Stop::Cost;
                        break 'outer;
                    }
                    break;
                }
                if promise <= 1e-12 * total {
                    stop = Stop::Gradient;
                    break 'outer;
                }
            }
            refused += 1;
            damping *= growth;
            growth *= 2.0;
            if damping > 1e12 {
                stop = Stop::NoProgress;
                break 'outer;
            }
        }
    }
    let term = |label: &str, before, after| TermCost { label: label.into(), before, after };
    Ok(Summary {
        stop,
        iterations: accepted,
        refused,
        terms: vec![
            term("reprojection (bundle adjustment)", before, cost),
            term("prior on the intrinsics", prior_before, prior.cost(&offset)),
        ],
        seconds: began.elapsed().as_secs_f64(),
    })
}

/// Gaussian prior on the refined intrinsics about their starting values.
struct Prior {
    sigmas: [f64; COUNT],
    active: Vec<usize>,
}

impl Prior {
    fn cost(&self, offset: &[f64; COUNT]) -> f64 {
        self.active.iter().map(|&k| (offset[k] / self.sigmas[k]).powi(2)).sum()
    }

    /// Second derivative and gradient (halved) for each active parameter.
    fn normal(&self, offset: &[f64; COUNT]) -> Vec<(f64, f64)> {
        let weight = |k: &usize| self.sigmas[*k].powi(-2);
        self.active.iter().map(|k| (weight(k), weight(k) * offset[*k])).collect()
    }
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
    let seen = bundle.camera.project(&(bundle.poses[o.view] * bundle.points[o.point]))?;
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
fn linearise(bundle: &Bundle, loss: Loss) -> Vec<Row> {
    let row = |o: &BundleObservation| -> Option<Row> {
        let pose = &bundle.poses[o.view];
        let local = pose * bundle.points[o.point];
        let seen = bundle.camera.project(&local)?;
        let residual = seen.pixel - o.pixel;
        let weight = loss.evaluate(residual.norm_squared() / (o.sigma_px * o.sigma_px)).1;
        let scale = weight.sqrt() / o.sigma_px;
        Some(Row {
            view: o.view,
            point: o.point,
            residual: residual * scale,
            by_pose: pose_jacobian(&seen.jacobian, &local) * scale,
            by_point: seen.jacobian * pose.rotation.to_rotation_matrix().matrix() * scale,
            by_intrinsics: intrinsics::jacobian(&bundle.camera, &local, &seen.pixel) * scale,
        })
    };
    bundle.observations.par_iter().with_min_len(512).filter_map(row).collect()
}

/// The bundle after a step.
fn apply(
    bundle: &Bundle,
    layout: &Layout,
    offset: &[f64; COUNT],
    step: &Step,
) -> (Bundle, [f64; COUNT]) {
    let mut moved = bundle.clone();
    for ((pose, d), fixed) in moved.poses.iter_mut().zip(&step.poses).zip(&bundle.fixed) {
        if !fixed {
            *pose = retract(pose, d);
        }
    }
    for (point, d) in moved.points.iter_mut().zip(&step.points) {
        *point += d;
    }
    let mut change = [0.0; COUNT];
    for (&k, d) in layout.intrinsics.iter().zip(&step.intrinsics) {
        change[k] = *d;
    }
    moved.camera = intrinsics::retract(&bundle.camera, &change);
    (moved, std::array::from_fn(|k| offset[k] + change[k]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;
    use crate::geometry::{Vector3, align_similarity};
    use crate::sfm::random::Random;
    use crate::sfm::triangulation::centre_of;

    /// Eight cameras on an arc about 80 points, seen without noise.
    fn scene() -> Bundle {
        let camera = CameraModel {
            size: [640, 480],
            focal: [548.0, 549.0],
            centre: [316.4, 243.2],
            lens: Lens::Pinhole,
        };
        let mut random = Random::new(1, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        let points: Vec<_> =
            (0..80).map(|_| Point3::new(30.0 * unit(), 30.0 * unit(), 20.0 * unit())).collect();
        let poses: Vec<_> = (0..8)
            .map(|i| {
                let turn = Vector3::new(0.1 * unit(), 0.12 * (i as f64 - 3.5), 0.1 * unit());
                Isometry::new(Vector3::new(unit(), unit(), 60.0 + 6.0 * unit()), turn)
            })
            .collect();
        let mut observations = Vec::new();
        for (view, pose) in poses.iter().enumerate() {
            for (point, p) in points.iter().enumerate() {
                let pixel = camera.project(&(pose * p)).unwrap().pixel;
                observations.push(BundleObservation { view, point, pixel, sigma_px: 1.0 });
            }
        }
        let mut fixed = vec![false; 8];
        fixed[0] = true;
        Bundle { prior: camera.clone(), camera, poses, fixed, points, observations }
    }

    fn disturbed(truth: &Bundle) -> Bundle {
        let mut bundle = truth.clone();
        let mut random = Random::new(2, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        for pose in &mut bundle.poses[1..] {
            let step = nalgebra::Vector6::from_fn(|i, _| unit() * if i < 3 { 0.02 } else { 1.0 });
            *pose = retract(pose, &step);
        }
        bundle.points.iter_mut().for_each(|p| *p += Vector3::new(unit(), unit(), unit()));
        bundle
    }

    fn centre_error(a: &Bundle, b: &Bundle) -> f64 {
        let centres = |s: &Bundle| s.poses.iter().map(centre_of).collect::<Vec<_>>();
        let (from, to) = (centres(a), centres(b));
        let fit = align_similarity(&from, &to).unwrap();
        from.iter().zip(&to).map(|(f, t)| (fit * f - t).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn converges_to_the_truth() {
        let truth = scene();
        let mut bundle = disturbed(&truth);
        let summary = adjust(&mut bundle, &BundleOptions::default()).unwrap();
        assert!(summary.cost().1 < 1e-12 * summary.cost().0, "{summary:?}");
        assert!(centre_error(&bundle, &truth) < 1e-6);
        assert_eq!(bundle.poses[0], truth.poses[0]);
    }

    #[test]
    fn outliers_are_outvoted_by_the_robust_loss() {
        let truth = scene();
        let mut bundle = disturbed(&truth);
        bundle.observations.iter_mut().step_by(29).for_each(|o| o.pixel.x += 25.0);
        let options = BundleOptions { loss: Loss::GemanMcClure(2.0), ..Default::default() };
        adjust(&mut bundle, &BundleOptions::default()).unwrap();
        adjust(&mut bundle, &options).unwrap();
        assert!(centre_error(&bundle, &truth) < 0.02, "{}", centre_error(&bundle, &truth));
    }

    #[test]
    fn a_wrong_focal_length_is_recovered() {
        let truth = scene();
        let mut bundle = disturbed(&truth);
        bundle.camera.focal = bundle.camera.focal.map(|f| 1.04 * f);
        let refine = RefineIntrinsics { focal: true, ..Default::default() };
        let options = BundleOptions { refine, cost_tolerance: 1e-12, ..Default::default() };
        adjust(&mut bundle, &options).unwrap();
        assert!((bundle.camera.focal[0] / 548.0 - 1.0).abs() < 5e-3, "{:?}", bundle.camera.focal);
    }

    #[test]
    fn either_elimination_gives_the_same_step() {
        let mut bundle = disturbed(&scene());
        bundle.camera.focal = bundle.camera.focal.map(|f| 1.01 * f);
        // Not every view sees every point.
        bundle.observations.retain(|o| (o.view + 3 * o.point) % 5 != 0);
        let mut layout = Layout::new(&bundle, &[0, 1]);
        assert_eq!(layout.eliminate, Eliminate::Points);
        let mut steps = Vec::new();
        for eliminate in [Eliminate::Points, Eliminate::Poses] {
            layout.eliminate = eliminate;
            sort(&mut bundle, eliminate).unwrap();
            let rows = linearise(&bundle, Loss::Huber(1.0));
            steps.push(solve(&rows, &layout, &[(3.0, 0.5), (2.0, -1.0)], 1e-3).unwrap());
        }
        let [a, b] = [&steps[0], &steps[1]];
        let near = |x: &[f64], y: &[f64]| x.iter().zip(y).all(|(x, y)| (x - y).abs() < 1e-7);
        assert!(a.poses.iter().zip(&b.poses).all(|(x, y)| near(x.as_slice(), y.as_slice())));
        assert!(a.points.iter().zip(&b.points).all(|(x, y)| near(x.as_slice(), y.as_slice())));
        assert!(near(&a.intrinsics, &b.intrinsics) && a.intrinsics[0].abs() > 1e-4);
        assert!((a.promise / b.promise - 1.0).abs() < 1e-9);
        assert_eq!(a.poses[0].norm(), 0.0);
    }

    #[test]
    fn many_views_of_few_points_converge_too() {
        let mut truth = scene();
        truth.points.truncate(12);
        truth.observations.retain(|o| o.point < 12);
        let mut bundle = disturbed(&truth);
        assert_eq!(Layout::new(&bundle, &[]).eliminate, Eliminate::Poses);
        let summary = adjust(&mut bundle, &BundleOptions::default()).unwrap();
        assert!(summary.cost().1 < 1e-12 * summary.cost().0, "{summary:?}");
        assert!(centre_error(&bundle, &truth) < 1e-6);
    }

    #[test]
    fn bad_input_is_refused() {
        let mut bundle = scene();
        bundle.observations[3].view = 99;
        assert!(matches!(
            adjust(&mut bundle, &BundleOptions::default()),
            Err(BundleError::Index(3, 99, 3))
        ));
        let mut bundle = scene();
        bundle.points[0].z = -1000.0;
        let result = adjust(&mut bundle, &BundleOptions::default());
        assert_eq!(result.unwrap_err(), BundleError::Infeasible(8));
    }
}
