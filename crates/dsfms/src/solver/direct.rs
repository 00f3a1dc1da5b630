//! The vertex part of the normal equations factorised as it stands.

use super::cholesky::{Cholesky, CholeskyError, Factor};
use super::matrix::Matrix;
use super::ordering::Ordered;
use nalgebra::{DMatrix, DVector};

/// Scalar factor over three unknowns a vertex.
pub(super) struct Direct {
    cholesky: Cholesky,
    factor: Factor,
    values: Vec<f64>,
    permuted: Vec<[f64; 1]>,
}

impl Direct {
    pub(super) fn new(ordered: &Ordered) -> Result<Self, CholeskyError> {
        let (col_ptr, row_idx) = ordered.scalar(3);
        let values = vec![0.0; row_idx.len()];
        let permuted = vec![[0.0]; 3 * ordered.len()];
        let cholesky = Cholesky::analyse(permuted.len(), col_ptr, row_idx)?;
        Ok(Self { cholesky, factor: Factor::default(), values, permuted })
    }

    /// Factorise the damped matrix.
    pub(super) fn factorise(&mut self, matrix: &Matrix, damping: f64) -> Result<(), CholeskyError> {
        let col_ptr = self.cholesky.col_ptr();
        let floor = matrix.floor();
        for j in 0..matrix.ordered.len() {
            for (k, entry) in matrix.ordered.column(j).iter().enumerate() {
                let mut block = matrix.block(entry);
                if k == 0 {
                    for c in 0..3 {
                        block[(c, c)] += damping * block[(c, c)] + floor;
                    }
                }
                for c in 0..3 {
                    let first = if k == 0 { c } else { 0 };
                    let at = col_ptr[3 * j + c] + 3 * k - c;
                    for r in first..3 {
                        self.values[at + r] = block[(r, c)];
                    }
                }
            }
        }
        self.cholesky.factorise(&self.values, &mut self.factor)
    }

    /// `A⁻¹ x` in place.
    fn solve(&mut self, ordered: &Ordered, x: &mut [f64]) {
        for (to, &v) in self.permuted.chunks_exact_mut(3).zip(&ordered.order) {
            to.iter_mut().zip(&x[3 * v as usize..]).for_each(|(to, x)| *to = [*x]);
        }
        self.cholesky.solve(&self.factor, &mut self.permuted);
        for (from, &v) in self.permuted.chunks_exact(3).zip(&ordered.order) {
            x[3 * v as usize..].iter_mut().zip(from).for_each(|(x, [from])| *x = *from);
        }
    }

    /// Solve the damped system; the globals by their Schur complement.
    pub(super) fn step(&mut self, matrix: &Matrix, damping: f64) -> Option<Vec<f64>> {
        self.factorise(matrix, damping).ok()?;
        let sums = matrix.sums;
        let m = sums.corner.nrows();
        let mut delta: Vec<f64> = sums.gradient.iter().flat_map(|g| [-g.x, -g.y, -g.z]).collect();
        self.solve(matrix.ordered, &mut delta);
        let columns: Vec<Vec<f64>> = (0..m)
            .map(|k| {
                let mut column: Vec<f64> =
                    sums.border[k].iter().flat_map(|b| [b.x, b.y, b.z]).collect();
                self.solve(matrix.ordered, &mut column);
                column
            })
            .collect();
        let globals = schur_step(matrix, damping, &delta, &columns)?;
        for (column, g) in columns.iter().zip(globals.iter()) {
            delta.iter_mut().zip(column).for_each(|(d, c)| *d -= g * c);
        }
        delta.extend(globals.iter());
        Some(delta)
    }
}

/// Globals of the step, given `A⁻¹[−g, B]`.
fn schur_step(
    matrix: &Matrix,
    damping: f64,
    solved: &[f64],
    columns: &[Vec<f64>],
) -> Option<DVector<f64>> {
    let sums = matrix.sums;
    if columns.is_empty() {
        return Some(DVector::zeros(0));
    }
    let dot = |k: usize, x: &[f64]| -> f64 {
        sums.border[k].iter().flat_map(|b| b.iter()).zip(x).map(|(b, x)| b * x).sum()
    };
    let mut schur: DMatrix<f64> = sums.corner.clone();
    let mut rhs = -&sums.global_gradient;
    for k in 0..columns.len() {
        schur[(k, k)] += damping * sums.corner[(k, k)] + f64::MIN_POSITIVE;
        rhs[k] -= dot(k, solved);
        for (l, column) in columns.iter().enumerate() {
            schur[(k, l)] -= dot(k, column);
        }
    }
    let symmetric = (&schur + schur.transpose()) * 0.5;
    Some(symmetric.cholesky()?.solve(&rhs))
}
