//! Sparse least squares by conjugate gradients: every row has at most three unknowns.

use crate::solver::Step;
use crate::solver::conjugate_gradients::{Goal, System, conjugate_gradients};

/// A linearised, weighted residual: `weight · (residual + slope · step)²`.
pub(super) struct ShadingRow {
    pub index: [u32; 3],
    pub slope: [f64; 3],
    pub residual: f64,
    pub weight: f64,
}

/// Conjugate-gradient iterations of one step: enough for the smooth part of a depth map.
const MAX_ITERATIONS: usize = 150;

/// The step that minimises `Σ weight·(residual + slope·step)² + damping·‖step‖²_D`, `D` the
/// diagonal of the normal matrix, nearly.
pub(super) fn step(rows: &[ShadingRow], unknowns: usize, damping: f64) -> Option<Step> {
    let (mut diagonal, mut descent) = (vec![1e-9; unknowns], vec![0.0; unknowns]);
    for row in rows {
        for (&i, s) in row.index.iter().zip(row.slope) {
            diagonal[i as usize] += row.weight * s * s;
            descent[i as usize] -= row.weight * s * row.residual;
        }
    }
    let (mut delta, mut left) = (vec![0.0; unknowns], descent.clone());
    let mut normal = ShadingSystem { rows, diagonal: &diagonal, damping };
    conjugate_gradients(&mut normal, &mut delta, &mut left, Goal::Share(1e-6), MAX_ITERATIONS);
    // With (H + damping D) step = descent − left, the model falls by 2 descentᵀstep − stepᵀH step.
    let damped: f64 = delta.iter().zip(&diagonal).map(|(x, d)| damping * d * x * x).sum();
    let pulls = descent.iter().zip(&left).map(|(b, r)| b + r);
    let predicted = delta.iter().zip(pulls).map(|(x, pull)| x * pull).sum::<f64>() + damped;
    Some(Step { delta, predicted })
}

/// The damped normal matrix, row by row.
struct ShadingSystem<'a> {
    rows: &'a [ShadingRow],
    diagonal: &'a [f64],
    damping: f64,
}

impl System<f64> for ShadingSystem<'_> {
    fn apply(&mut self, x: &[f64], out: &mut [f64]) {
        for ((out, x), d) in out.iter_mut().zip(x).zip(self.diagonal) {
            *out = self.damping * d * x;
        }
        for row in self.rows {
            let along: f64 = (0..3).map(|k| row.slope[k] * x[row.index[k] as usize]).sum();
            for k in 0..3 {
                out[row.index[k] as usize] += row.weight * row.slope[k] * along;
            }
        }
    }

    fn precondition(&mut self, r: &[f64], out: &mut [f64]) {
        for ((out, r), d) in out.iter_mut().zip(r).zip(self.diagonal) {
            *out = r / ((1.0 + self.damping) * d);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_a_small_system() {
        // (x − 1)² + 4(x + y − 3)² + (z + 2)²
        let row = |index, slope, residual, weight| ShadingRow { index, slope, residual, weight };
        let rows = [
            row([0, 1, 2], [1.0, 0.0, 0.0], -1.0, 1.0),
            row([0, 1, 2], [1.0, 1.0, 0.0], -3.0, 4.0),
            row([0, 1, 2], [0.0, 0.0, 1.0], 2.0, 1.0),
        ];
        let Step { delta, predicted } = step(&rows, 3, 0.0).unwrap();
        // From 1 + 36 + 4 to 0.
        assert!((predicted - 41.0).abs() < 1e-5);
        for (x, expected) in delta.iter().zip([1.0, 2.0, -2.0]) {
            assert!((x - expected).abs() < 1e-5);
        }
    }
}
