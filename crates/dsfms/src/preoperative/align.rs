//! The template's surface onto the preoperative one: a similarity, by the distance to the surface
//! itself.
//!
//! `Σᵢ ρ(d(T pᵢ)² / s²) / σ² + Σⱼ ρ(‖T lⱼ − mⱼ‖² / s²) / σₗ²`, `d` the distance to the nearest
//! place that faces alike, `s` the scale of `T = ct_from_template`, `ρ` Geman and McClure's. Its
//! derivative is that of the distance to the tangent plane (Chen and Medioni 1992); since places
//! are sought anew for every trial step, the cost is the true one and never rises (Fitzgibbon
//! 2003). Lengths are counted in template units: shrinking the template to a point gains nothing.
//! What has no place counts as far as the loss can.

use super::landmarks::LandmarkPair;
use super::options::ScaleRule;
use super::target::{SurfaceSample, Target, extent};
use crate::geometry::{Point3, SIGMA_OVER_MAD, Similarity, Vector3, median};
use crate::solver::{Loss, Options, Problem, Step, minimize};
use nalgebra::{SMatrix, SVector, Translation3, UnitQuaternion};
use rayon::prelude::*;

/// Turn, shift and growth about the middle of the placed template, in its size.
pub(super) type Seven = SVector<f64, 7>;
pub(super) type NormalMatrix = SMatrix<f64, 7, 7>;

/// Independent places that a whole surface counts for: errors of neighbours go together.
pub(super) const PLACES: f64 = 50.0;
/// The loss ends at so many standard deviations.
const CUT: f64 = 3.0;

/// How a pose is refined.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    /// Where the loss starts to give in at first, and at the least, template units.
    pub cut: [f64; 2],
    /// Standard deviation of a landmark, mm.
    pub landmark_sigma: f64,
    pub scale: ScaleRule,
    /// Accepted steps at a cut.
    pub steps: usize,
}

/// The template placed on the preoperative surface.
#[derive(Clone, Debug)]
pub struct Aligned {
    /// `ct_from_template`.
    pub similarity: Similarity,
    /// Distance of every sample from its place, mm; `None` where it has none.
    pub distances: Vec<Option<f64>>,
    /// Where the loss gives in, template units: beyond it a sample is no part of the overlap.
    pub cut: f64,
    /// Standard deviation that the distances show, template units.
    pub sigma: f64,
    /// Mean loss of the samples, 0 (all on the surface) to 1 (none).
    pub misfit: f64,
}

/// Distances over the overlap, mm.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Residual {
    /// Root mean square.
    pub rms: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Share of the template's area that lies on the preoperative surface.
    pub overlap: f64,
}

impl Residual {
    /// Of distances (mm), those above `limit` (mm) left out.
    pub fn of(distances: &[Option<f64>], limit: f64) -> Self {
        let mut near: Vec<f64> =
            distances.iter().flatten().copied().filter(|d| *d <= limit).collect();
        near.sort_unstable_by(f64::total_cmp);
        let count = near.len();
        let at = |share: f64| near.get((share * count as f64) as usize).copied().unwrap_or(0.0);
        let square = near.iter().map(|d| d * d).sum::<f64>() / count.max(1) as f64;
        let overlap = count as f64 / distances.len().max(1) as f64;
        Self { rms: square.sqrt(), median: at(0.5), p95: at(0.95), overlap }
    }
}

/// Refine `start` until neither the pose nor what is taken for noise changes. `noise`: of the
/// template's surface, in its unit.
#[doc(alias = "ICP")]
pub fn align(
    target: &Target,
    samples: &[SurfaceSample],
    landmarks: &[LandmarkPair],
    start: Similarity,
    noise: f64,
    options: &super::PreoperativeOptions,
) -> Aligned {
    let (_, size) = extent(samples.iter().map(|s| &s.point));
    let first = (options.max_deformation / start.scaling()).min(0.3 * size);
    let schedule = Schedule {
        cut: [first, CUT * noise],
        landmark_sigma: options.landmark_sigma,
        scale: options.scale,
        steps: 30,
    };
    refine(target, samples, landmarks, start, &schedule)
}

pub(super) fn refine(
    target: &Target,
    samples: &[SurfaceSample],
    landmarks: &[LandmarkPair],
    start: Similarity,
    schedule: &Schedule,
) -> Aligned {
    let mut fit = AlignmentProblem::new(target, samples, landmarks, schedule);
    let mut state = start;
    loop {
        fit.renew(&state);
        let options =
            Options { max_steps: schedule.steps, cost_tolerance: 1e-7, ..Options::default() };
        state = minimize(&mut fit, state, &options).0;
        let rows = fit.rows(&state);
        let sigma = shown_sigma(&rows, schedule.cut[1] / CUT);
        let next = (0.6 * fit.cut).max(CUT * sigma).min(fit.cut);
        if next > 0.95 * fit.cut {
            return fit.aligned(state, &rows, sigma);
        }
        fit.cut = next;
    }
}

/// What the nearest of the samples show, at least `least`: those that have no place do not speak.
fn shown_sigma(rows: &[Option<SampleRow>], least: f64) -> f64 {
    let mut values: Vec<f64> = rows.iter().flatten().map(|r| r.residual.abs()).collect();
    (SIGMA_OVER_MAD * median(&mut values).unwrap_or(0.0)).max(least)
}

/// A distance in template units and its derivative.
#[derive(Clone, Copy, Debug)]
pub(super) struct SampleRow {
    pub residual: f64,
    pub derivative: Seven,
}

/// The problem at one cut of the loss.
pub(super) struct AlignmentProblem<'a> {
    target: &'a Target<'a>,
    samples: &'a [SurfaceSample],
    landmarks: &'a [LandmarkPair],
    pub cut: f64,
    /// Middle and size of the samples, template frame.
    pub middle: Point3,
    pub size: f64,
    bounds: [f64; 2],
    landmark_mm: f64,
    /// Standard deviation of a landmark, template units; fixed while a cut lasts.
    landmark_sigma: f64,
    matrix: NormalMatrix,
    gradient: Seven,
    ahead: Option<(Similarity, Vec<Option<SampleRow>>)>,
}

impl<'a> AlignmentProblem<'a> {
    pub(super) fn new(
        target: &'a Target<'a>,
        samples: &'a [SurfaceSample],
        landmarks: &'a [LandmarkPair],
        schedule: &Schedule,
    ) -> Self {
        let (middle, size) = extent(samples.iter().map(|s| &s.point));
        Self {
            target,
            samples,
            landmarks,
            cut: schedule.cut[0].max(schedule.cut[1]),
            middle,
            size,
            bounds: schedule.scale.bounds(),
            landmark_mm: schedule.landmark_sigma,
            landmark_sigma: schedule.landmark_sigma,
            matrix: NormalMatrix::zeros(),
            gradient: Seven::zeros(),
            ahead: None,
        }
    }

    fn renew(&mut self, state: &Similarity) {
        self.landmark_sigma = self.landmark_mm / state.scaling();
        self.ahead = None;
    }

    pub(super) fn rows(&self, state: &Similarity) -> Vec<Option<SampleRow>> {
        let (scale, centre) = (state.scaling(), state * self.middle);
        let row = |sample: &SurfaceSample| {
            let at = state * sample.point;
            let hit = self.target.hit(&at, &(state.isometry.rotation * sample.normal))?;
            let residual = hit.distance / scale;
            let y = (at - centre) / (scale * self.size);
            let derivative = along(&y, &hit.direction, residual / self.size) * self.size;
            Some(SampleRow { residual, derivative })
        };
        self.samples.par_iter().map(row).collect()
    }

    /// Residuals of the landmarks, template units, and derivatives row by row.
    pub(super) fn landmark_rows(&self, state: &Similarity) -> Vec<(Vector3, [Seven; 3])> {
        let (scale, centre) = (state.scaling(), state * self.middle);
        let row = |pair: &LandmarkPair| {
            let at = state * pair.template;
            let residual = (at - pair.ct) / scale;
            let y = (at - centre) / (scale * self.size);
            let axis =
                |k: usize| along(&y, &Vector3::ith(k, 1.0), residual[k] / self.size) * self.size;
            (residual, [axis(0), axis(1), axis(2)])
        };
        self.landmarks.iter().map(row).collect()
    }

    /// Weight of a sample's square, of a landmark's square.
    pub(super) fn weights(&self) -> [f64; 2] {
        let sigma = self.cut / CUT;
        let surface = PLACES / (self.samples.len().max(1) as f64 * sigma * sigma);
        [surface, 1.0 / (self.landmark_sigma * self.landmark_sigma)]
    }

    pub(super) fn losses(&self) -> [Loss; 2] {
        [Loss::GemanMcClure(self.cut), Loss::GemanMcClure(2.0 * CUT * self.landmark_sigma)]
    }

    fn costs_of(&self, state: &Similarity, rows: &[Option<SampleRow>]) -> Vec<f64> {
        let [surface, landmarks] = self.losses();
        let [ws, wl] = self.weights();
        // What has no place is as far as the loss can tell.
        let cost = |row: &Option<SampleRow>| {
            row.map_or(self.cut * self.cut, |r| surface.evaluate(r.residual * r.residual).0)
        };
        let of_surface: f64 = rows.iter().map(cost).sum();
        let residuals = self.landmark_rows(state);
        let of_landmarks: f64 =
            residuals.iter().map(|(r, _)| landmarks.evaluate(r.norm_squared()).0).sum();
        vec![ws * of_surface, wl * of_landmarks]
    }

    /// Whether the scale may not go the way the gradient wants it to.
    fn scale_is_held(&self, state: &Similarity) -> bool {
        let [low, high] = self.bounds;
        let (scale, rises) = (state.scaling(), self.gradient[6] < 0.0);
        low == high || (scale >= high && rises) || (scale <= low && !rises)
    }

    fn aligned(&self, state: Similarity, rows: &[Option<SampleRow>], sigma: f64) -> Aligned {
        let scale = state.scaling();
        let loss = self.losses()[0];
        let share = |row: &Option<SampleRow>| {
            row.map_or(1.0, |r| loss.evaluate(r.residual * r.residual).0 / (self.cut * self.cut))
        };
        let misfit = rows.iter().map(share).sum::<f64>() / rows.len().max(1) as f64;
        let distances = rows.iter().map(|r| r.map(|r| r.residual * scale)).collect();
        Aligned { similarity: state, distances, cut: self.cut, sigma, misfit }
    }
}

/// Derivative of `u·(T p) / (s ℓ)` by turn, shift and growth; `own`: the residual in sizes, which a
/// growth of `s` makes smaller.
fn along(y: &Vector3, u: &Vector3, own: f64) -> Seven {
    let turn = y.cross(u);
    Seven::from([turn.x, turn.y, turn.z, u.x, u.y, u.z, u.dot(y) - own])
}

/// Move a pose by turn, shift and growth about where it puts `middle`.
pub(super) fn moved(state: &Similarity, middle: &Point3, size: f64, delta: &[f64]) -> Similarity {
    let turn = UnitQuaternion::new(Vector3::new(delta[0], delta[1], delta[2]));
    let growth = delta[6].clamp(-0.3, 0.3).exp();
    let centre = (state * middle).coords;
    let shift = Vector3::new(delta[3], delta[4], delta[5]) * (size * state.scaling()) + centre;
    let motion =
        Similarity::from_parts(Translation3::from(shift - growth * (turn * centre)), turn, growth);
    motion * state
}

impl Problem for AlignmentProblem<'_> {
    type State = Similarity;

    fn costs(&self, state: &Similarity) -> Option<Vec<f64>> {
        Some(self.costs_of(state, &self.rows(state)))
    }

    fn trial(&mut self, state: &Similarity) -> Option<Vec<f64>> {
        let rows = self.rows(state);
        let costs = self.costs_of(state, &rows);
        self.ahead = Some((*state, rows));
        Some(costs)
    }

    fn labels(&self) -> Vec<&'static str> {
        vec!["surface", "landmarks"]
    }

    fn linearise(&mut self, state: &Similarity) -> f64 {
        let rows = match self.ahead.take() {
            Some((at, rows)) if at == *state => rows,
            _ => self.rows(state),
        };
        let [surface, landmarks] = self.losses();
        let [ws, wl] = self.weights();
        let of_landmarks = self.landmark_rows(state);
        (self.matrix, self.gradient) = (NormalMatrix::zeros(), Seven::zeros());
        let mut add = |weight: f64, residual: f64, derivative: &Seven| {
            self.matrix += derivative * derivative.transpose() * weight;
            self.gradient += derivative * (weight * residual);
        };
        for row in rows.iter().flatten() {
            let weight = ws * surface.evaluate(row.residual * row.residual).1;
            add(weight, row.residual, &row.derivative);
        }
        for (residual, derivatives) in of_landmarks {
            let weight = wl * landmarks.evaluate(residual.norm_squared()).1;
            (0..3).for_each(|k| add(weight, residual[k], &derivatives[k]));
        }
        if self.scale_is_held(state) {
            self.matrix.row_mut(6).fill(0.0);
            self.matrix.column_mut(6).fill(0.0);
            (self.matrix[(6, 6)], self.gradient[6]) = (1.0, 0.0);
        }
        self.gradient.norm()
    }

    fn step(&mut self, damping: f64) -> Option<Step> {
        // An open direction gets a floor, and stays where it is.
        let floor = 1e-9 * self.matrix.diagonal().max() + f64::MIN_POSITIVE;
        let diagonal = self.matrix.diagonal().map(|d| damping * d + floor);
        let damped = self.matrix + NormalMatrix::from_diagonal(&diagonal);
        let delta = damped.cholesky()?.solve(&-self.gradient);
        let predicted = -(2.0 * self.gradient.dot(&delta) + (self.matrix * delta).dot(&delta));
        Some(Step { delta: delta.as_slice().to_vec(), predicted })
    }

    fn retract(&self, state: &Similarity, delta: &[f64]) -> Similarity {
        let mut next = moved(state, &self.middle, self.size, delta);
        let scale = next.scaling();
        let [low, high] = self.bounds;
        let within = scale.clamp(low, high);
        if within != scale {
            // About the placed middle, which stays.
            let centre = (next * self.middle).coords;
            let ratio = within / scale;
            let shift = centre + (next.isometry.translation.vector - centre) * ratio;
            next =
                Similarity::from_parts(Translation3::from(shift), next.isometry.rotation, within);
        }
        next
    }
}
