//! Problems of few unknowns, told as functions.

use super::{Options, Problem, Step, minimize};
use nalgebra::{SMatrix, SVector};
use std::marker::PhantomData;

/// Damping of what no residual holds, relative to the mean of the diagonal.
const FLOOR: f64 = 1e-12;

/// Minimise `Σ ρ(‖r‖²)` from `start`; never worse than it.
///
/// `cost`: of a state, infinite where it is infeasible; once it has reached the bound it need not
/// be summed up. `normal`: `Σ ρ′ JᵀJ` and `Σ ρ′ Jᵀr`. `retract`: the state after a step.
pub(crate) fn minimize_few<S: Clone, const N: usize>(
    start: &S,
    options: &Options,
    cost: impl Fn(&S, f64) -> f64,
    normal: impl Fn(&S) -> (SMatrix<f64, N, N>, SVector<f64, N>),
    retract: impl Fn(&S, &SVector<f64, N>) -> S,
) -> S {
    let model = (SMatrix::zeros(), SVector::zeros());
    let best = f64::INFINITY;
    let mut problem = Few { cost, normal, retract, best, model, state: PhantomData };
    minimize(&mut problem, start.clone(), options).0
}

struct Few<S, C, L, R, const N: usize> {
    cost: C,
    normal: L,
    retract: R,
    /// The lowest cost met bounds what a trial has to sum up.
    best: f64,
    model: (SMatrix<f64, N, N>, SVector<f64, N>),
    state: PhantomData<S>,
}

impl<S, C, L, R, const N: usize> Problem for Few<S, C, L, R, N>
where
    S: Clone,
    C: Fn(&S, f64) -> f64,
    L: Fn(&S) -> (SMatrix<f64, N, N>, SVector<f64, N>),
    R: Fn(&S, &SVector<f64, N>) -> S,
{
    type State = S;

    fn costs(&self, state: &S) -> Option<Vec<f64>> {
        let cost = (self.cost)(state, self.best);
        cost.is_finite().then(|| vec![cost])
    }

    fn trial(&mut self, state: &S) -> Option<Vec<f64>> {
        let costs = self.costs(state)?;
        self.best = self.best.min(costs[0]);
        Some(costs)
    }

    fn labels(&self) -> Vec<&'static str> {
        vec!["cost"]
    }

    fn linearise(&mut self, state: &S) -> f64 {
        self.model = (self.normal)(state);
        self.model.1.norm()
    }

    fn step(&mut self, damping: f64) -> Option<Step> {
        let (matrix, gradient) = &self.model;
        let floor = FLOOR * matrix.trace() / N as f64;
        let mut damped = *matrix;
        (0..N).for_each(|i| damped[(i, i)] += damping * matrix[(i, i)] + floor);
        let delta = -damped.cholesky()?.solve(gradient);
        let predicted = -(2.0 * gradient.dot(&delta) + (matrix * delta).dot(&delta));
        Some(Step { delta: delta.as_slice().to_vec(), predicted })
    }

    fn retract(&self, state: &S, delta: &[f64]) -> S {
        (self.retract)(state, &SVector::from_column_slice(delta))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    /// The circle through four points nearly on it, of known radius: centre of (3, −1).
    #[test]
    fn a_centre_by_hand() {
        let at = |degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            Vector2::new(3.0 + 2.0 * c, -1.0 + 2.0 * s)
        };
        let points = [0.0, 80.0, 200.0, 290.0].map(at);
        let residual = |x: &Vector2<f64>, p: &Vector2<f64>| (x - p).norm() - 2.0;
        let cost = |x: &Vector2<f64>, bound: f64| {
            assert!(bound > 0.0);
            points.iter().map(|p| residual(x, p).powi(2)).sum()
        };
        let normal = |x: &Vector2<f64>| {
            let rows = points.map(|p| ((x - p).normalize(), residual(x, &p)));
            let matrix = rows.iter().map(|(j, _)| j * j.transpose()).sum::<Matrix2<f64>>();
            (matrix, rows.iter().map(|(j, r)| j * *r).sum())
        };
        let options = Options { cost_tolerance: 1e-12, ..Options::default() };
        let found = minimize_few(&Vector2::zeros(), &options, cost, normal, |x, d| x + d);
        assert!((found - Vector2::new(3.0, -1.0)).norm() < 1e-8, "{found}");
    }

    #[test]
    fn an_infeasible_start_stays() {
        let normal = |_: &f64| (SMatrix::<f64, 1, 1>::identity(), SVector::<f64, 1>::zeros());
        let stays = |x: &f64, d: &SVector<f64, 1>| x + d[0];
        let cost = |_: &f64, _: f64| f64::INFINITY;
        assert_eq!(minimize_few(&7.0, &Options::default(), cost, normal, stays), 7.0);
    }
}
