//! Anderson acceleration: fewer rounds of a fixed-point iteration.

use super::cholesky::dot;
use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;

/// Rounds that are remembered: with them the volumes of `register/volume.rs` take a fifth to a half
/// of the rounds (`docs/results/choices.md`). Other depths were not tried.
const DEPTH: usize = 5;

/// Where a residual has grown by more than this, the steps remembered no longer tell where the
/// iteration goes.
const GROWN: f64 = 2.0;

/// Part of the trace that keeps the few normal equations solvable.
const RIDGE: f64 = 1e-10;

/// Anderson acceleration of a fixed-point iteration `x ← g(x)` (Walker and Ni 2011, type II): of
/// the last rounds the combination whose residuals `g(x) − x` cancel best.
#[derive(Clone, Debug, Default)]
pub(crate) struct Anderson {
    /// `g(x)` of the last rounds, oldest first.
    images: VecDeque<Vec<f64>>,
    residuals: VecDeque<Vec<f64>>,
}

impl Anderson {
    /// Where to go on from `x`, whose image is `g(x)`.
    pub(crate) fn next(&mut self, x: &[f64], image: Vec<f64>) -> Vec<f64> {
        let residual: Vec<f64> = image.iter().zip(x).map(|(g, x)| g - x).collect();
        let grown = |last: &Vec<f64>| square(&residual) > GROWN * GROWN * square(last);
        if self.residuals.back().is_some_and(grown) {
            (self.images, self.residuals) = Default::default();
        }
        let shares = self.shares(&residual);
        let mut next = image.clone();
        for (share, old) in shares.iter().flat_map(|s| s.iter()).zip(&self.images) {
            let moved = next.iter_mut().zip(image.iter().zip(old));
            moved.for_each(|(next, (new, old))| *next -= share * (new - old));
        }
        self.images.push_back(image);
        self.residuals.push_back(residual);
        if self.images.len() > DEPTH {
            self.images.pop_front();
            self.residuals.pop_front();
        }
        next
    }

    /// How much of the way from every remembered round to this one is taken back; `None` where
    /// there is none.
    fn shares(&self, residual: &[f64]) -> Option<DVector<f64>> {
        let change =
            |old: &Vec<f64>| residual.iter().zip(old).map(|(new, old)| new - old).collect();
        let changes: Vec<Vec<f64>> = self.residuals.iter().map(change).collect();
        let count = changes.len();
        let mut normal = DMatrix::from_fn(count, count, |i, j| dot(&changes[i], &changes[j]));
        let ridge = RIDGE * normal.trace();
        (0..count).for_each(|i| normal[(i, i)] += ridge);
        let right = DVector::from_fn(count, |i, _| dot(&changes[i], residual));
        (count > 0).then(|| normal.cholesky())?.map(|factor| factor.solve(&right))
    }
}

fn square(a: &[f64]) -> f64 {
    dot(a, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `g(x) = A x + b` of three unknowns, whose error falls by a tenth a round without
    /// acceleration.
    fn image(x: &[f64]) -> Vec<f64> {
        vec![
            0.9 * x[0] + 0.05 * x[1] + 1.0,
            0.05 * x[0] + 0.8 * x[1] - 0.02 * x[2] + 2.0,
            0.7 * x[2] + 3.0,
        ]
    }

    #[test]
    fn as_many_rounds_as_unknowns_solve_a_linear_problem() {
        let (mut anderson, mut x) = (Anderson::default(), vec![0.0; 3]);
        for _ in 0..5 {
            x = anderson.next(&x, image(&x));
        }
        let left = image(&x).iter().zip(&x).map(|(g, x)| (g - x).abs()).fold(0.0, f64::max);
        assert!(left < 1e-6, "{left}");
    }

    #[test]
    fn the_first_round_and_one_that_grew_go_to_the_image() {
        let mut anderson = Anderson::default();
        assert_eq!(anderson.next(&[1.0, 2.0], vec![1.5, 2.5]), [1.5, 2.5]);
        assert_eq!(anderson.next(&[0.0, 0.0], vec![7.0, 9.0]), [7.0, 9.0]);
    }
}
