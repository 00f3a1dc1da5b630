//! Albedo, gains and light parameters from logarithms of brightness, with the albedo eliminated.
//!
//! For observation `o` of surface spot `i` in view `v`
//!
//! ```text
//! r_o = ln I_o − ln m(o; θ) − g_v − a_i
//! ```
//!
//! with `m` the model shading, `g` log gains and `a` log albedos. `Σ w ρ(r/σ)` (Tukey) plus
//! quadratic priors on `g` and `θ` is minimised by Levenberg–Marquardt on `(θ, g)`; every `a_i` is
//! the robust mean of its spot's residuals and leaves by its Schur complement (variable
//! projection).

use super::photometric::SpotObservation;
use crate::geometry::robust::{robust_scale, tukey_loss, tukey_mean, tukey_weight};
use crate::solver::{Options, Problem, Step, minimize};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Smallest noise of a log residual: an image of 8 bits never gives less.
const SCALE_FLOOR: f64 = 0.005;
/// Noise assumed before the first fit.
const SCALE_START: f64 = 0.2;

/// The shading model `m(o; θ)`.
pub(super) trait ShadingModel: Sync {
    /// What a choice of θ amounts to, worked out once for all observations.
    type At: Send + Sync;
    /// The model at θ.
    fn at(&self, theta: &[f64]) -> Self::At;
    /// `ln m`; finite for every θ.
    fn log_shading(&self, observation: &SpotObservation, at: &Self::At) -> f64;
    /// Steps for central differences, one per parameter.
    fn steps(&self) -> Vec<f64>;
    /// Prior mean and standard deviation of every parameter.
    fn priors(&self) -> Vec<(f64, f64)>;
    /// Nearest admissible parameters.
    fn clamp(&self, _theta: &mut [f64]) {}
}

/// Observations grouped by surface spot.
pub(super) struct LogLinear<'a, M> {
    pub model: &'a M,
    /// One entry per surface spot.
    pub spots: &'a [Vec<SpotObservation>],
    /// Prior mean and standard deviation of every view's log gain.
    pub gain_priors: Vec<(f64, f64)>,
}

/// Where the minimisation ended.
#[derive(Clone, Debug)]
pub(super) struct LogFit {
    pub theta: Vec<f64>,
    pub log_gains: Vec<f64>,
    /// Robust standard deviation of the log residuals.
    pub scale: f64,
}

impl<M: ShadingModel> LogLinear<'_, M> {
    /// Minimise from `theta`; the noise is re-estimated between rounds.
    pub(super) fn solve(&self, theta: &[f64]) -> LogFit {
        let mut x: Vec<f64> = theta.to_vec();
        self.model.clamp(&mut x);
        x.extend(self.gain_priors.iter().map(|p| p.0));
        let mut scale = SCALE_START;
        let options = Options {
            max_steps: 15,
            cost_tolerance: 1e-7,
            initial_damping: 1e-3,
            fastest: 1.0,
            ..Options::default()
        };
        for _ in 0..4 {
            scale = self.scale(&x, scale).clamp(SCALE_FLOOR, scale);
            let model = (DMatrix::zeros(0, 0), DVector::zeros(0));
            x = minimize(&mut LogRound { fit: self, scale, model }, x, &options).0;
        }
        let scale = self.scale(&x, scale).max(SCALE_FLOOR);
        let log_gains = x.split_off(theta.len());
        LogFit { theta: x, log_gains, scale }
    }

    /// `Σ w ρ` and the number of observations at a fit, for a common noise `scale`.
    pub(super) fn loss(&self, fit: &LogFit, scale: f64) -> (f64, usize) {
        let at = self.model.at(&fit.theta);
        let per_spot = self.per_spot(|spot| {
            let r = self.residuals(spot, &at, &fit.log_gains, scale);
            r.iter().map(|&r| tukey_loss(r, scale)).sum::<f64>()
        });
        (per_spot.iter().sum(), self.spots.iter().map(Vec::len).sum())
    }

    fn per_spot<T: Send>(&self, f: impl Fn(&[SpotObservation]) -> T + Sync) -> Vec<T> {
        self.spots.par_iter().map(|spot| f(spot)).collect()
    }

    fn parameters(&self) -> usize {
        self.model.steps().len()
    }

    /// Residuals of one spot with its own log albedo removed.
    fn residuals(
        &self,
        spot: &[SpotObservation],
        at: &M::At,
        gains: &[f64],
        scale: f64,
    ) -> Vec<f64> {
        let mut r: Vec<f64> = spot
            .iter()
            .map(|o| o.grey().ln() - self.model.log_shading(o, at) - gains[o.view])
            .collect();
        let mut samples: Vec<_> = r.iter().zip(spot).map(|(&r, o)| (r, o.weight)).collect();
        let centre = tukey_mean(&mut samples, scale);
        r.iter_mut().for_each(|r| *r -= centre);
        r
    }

    fn scale(&self, x: &[f64], scale: f64) -> f64 {
        let (theta, gains) = x.split_at(self.parameters());
        let at = self.model.at(theta);
        let residuals = self.per_spot(|spot| {
            let n = spot.len() as f64;
            // The mean of n observations takes one degree of freedom.
            let unbias = (n / (n - 1.0).max(1.0)).sqrt();
            self.residuals(spot, &at, gains, scale)
                .into_iter()
                .map(|r| r * unbias)
                .collect::<Vec<_>>()
        });
        let scale = robust_scale(residuals.into_iter().flatten());
        if scale.is_finite() { scale } else { SCALE_START }
    }

    fn prior(&self) -> Vec<(f64, f64)> {
        let mut prior = self.model.priors();
        prior.extend_from_slice(&self.gain_priors);
        prior
    }

    fn cost(&self, x: &[f64], scale: f64) -> f64 {
        let (theta, gains) = x.split_at(self.parameters());
        let at = self.model.at(theta);
        let data: f64 = self
            .per_spot(|spot| {
                let r = self.residuals(spot, &at, gains, scale);
                r.iter().zip(spot).map(|(&r, o)| o.weight * tukey_loss(r, scale)).sum::<f64>()
            })
            .iter()
            .sum();
        data + x.iter().zip(self.prior()).map(|(x, (m, s))| ((x - m) / s).powi(2)).sum::<f64>()
    }

    /// Gauss–Newton matrix and descent direction of the reduced problem.
    fn linearise(&self, x: &[f64], scale: f64) -> (DMatrix<f64>, DVector<f64>) {
        let n = x.len();
        let (mut h, mut g) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (i, (mean, sigma)) in self.prior().into_iter().enumerate() {
            h[(i, i)] += 1.0 / (sigma * sigma);
            g[i] += (mean - x[i]) / (sigma * sigma);
        }
        let around = self.around(&x[..self.parameters()]);
        for rows in self.per_spot(|spot| self.rows(spot, &around, x, scale)) {
            rows.accumulate(&mut h, &mut g);
        }
        (h, g)
    }

    /// The model at θ and at one step to both sides of every parameter.
    fn around(&self, theta: &[f64]) -> CentralDifferences<M::At> {
        let moved = |j: usize, step: f64| {
            let mut moved = theta.to_vec();
            moved[j] += step;
            self.model.at(&moved)
        };
        let steps = self.model.steps();
        let sides =
            steps.iter().enumerate().map(|(j, &h)| (moved(j, h), moved(j, -h), h)).collect();
        CentralDifferences { centre: self.model.at(theta), sides }
    }

    /// Rows of one spot.
    fn rows(
        &self,
        spot: &[SpotObservation],
        around: &CentralDifferences<M::At>,
        x: &[f64],
        scale: f64,
    ) -> SpotRows {
        let k = self.parameters();
        let residuals = self.residuals(spot, &around.centre, &x[k..], scale);
        let log = |o, at| self.model.log_shading(o, at);
        let rows = spot
            .iter()
            .zip(&residuals)
            .map(|(o, &r)| {
                let slopes =
                    around.sides.iter().map(|(u, d, h)| (log(o, u) - log(o, d)) / (2.0 * h));
                let mut entries: Vec<(usize, f64)> = slopes.enumerate().collect();
                entries.push((k + o.view, 1.0));
                let weight = o.weight * tukey_weight(r, scale) / (scale * scale);
                LogRow { entries, residual: r, weight }
            })
            .collect();
        SpotRows::new(rows)
    }
}

/// The fit under one noise.
struct LogRound<'a, 'b, M> {
    fit: &'a LogLinear<'b, M>,
    scale: f64,
    /// Gauss–Newton matrix and descent direction.
    model: (DMatrix<f64>, DVector<f64>),
}

impl<M: ShadingModel> Problem for LogRound<'_, '_, M> {
    /// θ, then log gains.
    type State = Vec<f64>;

    fn costs(&self, x: &Vec<f64>) -> Option<Vec<f64>> {
        Some(vec![self.fit.cost(x, self.scale)])
    }

    fn labels(&self) -> Vec<&'static str> {
        vec!["log brightness and priors"]
    }

    fn linearise(&mut self, x: &Vec<f64>) -> f64 {
        self.model = self.fit.linearise(x, self.scale);
        self.model.1.norm()
    }

    fn step(&mut self, damping: f64) -> Option<Step> {
        let (matrix, descent) = &self.model;
        let mut damped = matrix.clone();
        (0..descent.len()).for_each(|i| damped[(i, i)] += damping * matrix[(i, i)].max(1e-9));
        let delta = damped.cholesky()?.solve(descent);
        let predicted = 2.0 * descent.dot(&delta) - delta.dot(&(matrix * &delta));
        Some(Step { delta: delta.as_slice().to_vec(), predicted })
    }

    fn retract(&self, x: &Vec<f64>, delta: &[f64]) -> Vec<f64> {
        let mut moved: Vec<f64> = x.iter().zip(delta).map(|(x, d)| x + d).collect();
        self.fit.model.clamp(&mut moved[..self.fit.parameters()]);
        moved
    }
}

/// A model and its neighbours for central differences: up, down, step.
struct CentralDifferences<T> {
    centre: T,
    sides: Vec<(T, T, f64)>,
}

/// One linearised observation: sparse derivative of the prediction, residual, weight.
struct LogRow {
    entries: Vec<(usize, f64)>,
    residual: f64,
    weight: f64,
}

/// The rows of one spot and their weighted mean, which its own albedo takes away.
struct SpotRows {
    rows: Vec<LogRow>,
    mean: Vec<(usize, f64)>,
    weight: f64,
}

impl SpotRows {
    fn new(rows: Vec<LogRow>) -> Self {
        let weight: f64 = rows.iter().map(|r| r.weight).sum();
        let mut mean: Vec<(usize, f64)> = Vec::new();
        if weight > 0.0 {
            let shares = |r: &LogRow| r.weight / weight;
            let all = rows.iter().flat_map(|r| r.entries.iter().map(|(i, v)| (*i, v * shares(r))));
            mean = all.collect();
            mean.sort_by_key(|entry| entry.0);
            mean.dedup_by(|next, kept| {
                let same = next.0 == kept.0;
                kept.1 += if same { next.1 } else { 0.0 };
                same
            });
        }
        Self { rows, mean, weight }
    }

    /// `Σ w (e − m)(e − m)ᵀ = Σ w e eᵀ − (Σ w) m mᵀ`: the rows stay as sparse as they are.
    fn accumulate(&self, h: &mut DMatrix<f64>, g: &mut DVector<f64>) {
        let mut outer = |entries: &[(usize, f64)], weight: f64, residual: f64| {
            for &(i, vi) in entries {
                g[i] += vi * residual;
                for &(j, vj) in entries {
                    h[(i, j)] += weight * vi * vj;
                }
            }
        };
        for row in &self.rows {
            outer(&row.entries, row.weight, row.weight * row.residual);
        }
        let residual: f64 = self.rows.iter().map(|row| row.weight * row.residual).sum();
        outer(&self.mean, -self.weight, -residual);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_takes_its_mean_away_by_hand() {
        let row = |entries: &[(usize, f64)], residual, weight| LogRow {
            entries: entries.to_vec(),
            residual,
            weight,
        };
        let rows = vec![
            row(&[(0, 2.0), (1, 1.0)], 0.3, 1.0),
            row(&[(0, -1.0), (2, 1.0)], -0.1, 3.0),
            row(&[(0, 0.5), (3, 1.0)], 0.2, 2.0),
        ];
        let dense = |r: &LogRow| {
            let mut v = DVector::zeros(4);
            r.entries.iter().for_each(|&(i, e)| v[i] = e);
            v
        };
        let mean = rows.iter().map(|r| r.weight * dense(r)).sum::<DVector<f64>>() / 6.0;
        let (mut h, mut g) = (DMatrix::zeros(4, 4), DVector::zeros(4));
        for r in &rows {
            let e = dense(r) - &mean;
            h += r.weight * &e * e.transpose();
            g += r.weight * r.residual * e;
        }
        let (mut found, mut right) = (DMatrix::zeros(4, 4), DVector::zeros(4));
        SpotRows::new(rows).accumulate(&mut found, &mut right);
        assert!((found - h).amax() < 1e-12 && (right - g).amax() < 1e-12);
    }
}
