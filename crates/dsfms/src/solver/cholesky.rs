//! Sparse Cholesky factorisation with a symbolic factor that outlives the values.

use faer::Par;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Side, Spec};

/// A factorisation was asked of a matrix that has none, or of a pattern that is malformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CholeskyError {
    /// A pivot was not positive.
    #[error("the matrix is not positive definite")]
    NotPositiveDefinite,
    /// Out of memory or index overflow in the symbolic phase.
    #[error("the symbolic factorisation failed: the system is too large")]
    Symbolic,
    /// Out of memory in the numeric phase.
    #[error("the factorisation failed: out of memory")]
    OutOfMemory,
}

/// The symbolic factor of `A = LLᵀ` for matrices of one lower-triangular pattern, in the order
/// given.
///
/// Always supernodal (15 times faster on meshes than simplicial) and sequential, so that the same
/// values give the same bits at any thread count.
pub struct Cholesky {
    pattern: SymbolicSparseColMat<usize>,
    symbolic: SymbolicCholesky<usize>,
    /// Memory that a factorisation needs.
    scratch: StackReq,
}

/// The values of `L`.
#[derive(Clone, Debug, Default)]
pub struct Factor {
    values: Vec<f64>,
}

impl Cholesky {
    /// Analyse a lower-triangular column-compressed pattern (rows ascending in every column,
    /// diagonal present), already ordered for little fill.
    pub(crate) fn analyse(
        size: usize,
        col_ptr: Vec<usize>,
        row_idx: Vec<usize>,
    ) -> Result<Self, CholeskyError> {
        let pattern = SymbolicSparseColMat::new_checked(size, size, col_ptr, None, row_idx);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        // Without a permutation, faer's analysis reads the upper triangle.
        let upper = transposed(size, pattern.col_ptr(), pattern.row_idx());
        let symbolic = factorize_symbolic_cholesky(
            upper.as_ref(),
            Side::Upper,
            SymmetricOrdering::Identity,
            params,
        )
        .map_err(|_| CholeskyError::Symbolic)?;
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        Ok(Self { pattern, symbolic, scratch })
    }

    /// Entries of the pattern.
    pub(crate) fn nnz(&self) -> usize {
        self.pattern.row_idx().len()
    }

    /// First entry of every column of the pattern (its diagonal), and the count last.
    pub(crate) fn col_ptr(&self) -> &[usize] {
        self.pattern.col_ptr()
    }

    /// Factorise the values of the pattern's entries, in its order.
    pub(crate) fn factorise(&self, values: &[f64], into: &mut Factor) -> Result<(), CholeskyError> {
        let memory = MemBuffer::try_new(self.scratch);
        let mut memory = memory.map_err(|_| CholeskyError::OutOfMemory)?;
        into.values.resize(self.symbolic.len_val(), 0.0);
        self.symbolic
            .factorize_numeric_llt(
                &mut into.values,
                SparseColMatRef::new(self.pattern.as_ref(), values),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Spec::default(),
            )
            .map_err(|_| CholeskyError::NotPositiveDefinite)?;
        Ok(())
    }

    /// Solve `A x = b` in place for `K` right-hand sides, those of one unknown together.
    pub fn solve<const K: usize>(&self, factor: &Factor, x: &mut [[f64; K]]) {
        let mut gathered = Vec::new();
        self.panels(factor).for_each(|panel| panel.forward(x, &mut gathered));
        self.panels(factor).rev().for_each(|panel| panel.backward(x, &mut gathered));
    }

    /// The panels of a factor, in the order of their columns.
    pub(super) fn panels<'a>(
        &'a self,
        factor: &'a Factor,
    ) -> impl DoubleEndedIterator<Item = Panel<'a>> {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.symbolic.raw() else {
            unreachable!("the analysis is always supernodal")
        };
        (0..symbolic.n_supernodes()).map(move |s| Panel {
            begin: symbolic.supernode_begin()[s],
            width: symbolic.supernode_end()[s] - symbolic.supernode_begin()[s],
            below: symbolic.supernode(s).pattern(),
            values: &factor.values[symbolic.col_ptr_for_val()[s]..],
        })
    }
}

/// Adjacent columns of `L` with the same rows below them.
pub(super) struct Panel<'a> {
    pub(super) begin: usize,
    pub(super) width: usize,
    /// Rows below the diagonal block.
    pub(super) below: &'a [usize],
    /// Column major, `width + below` rows.
    values: &'a [f64],
}

impl Panel<'_> {
    /// Part of `L⁻¹`.
    fn forward<const K: usize>(&self, x: &mut [[f64; K]], sums: &mut Vec<[f64; K]>) {
        let inside = &mut x[self.begin..self.begin + self.width];
        for c in 0..self.width {
            let top = self.column(c).0;
            let value = inside[c].map(|x| x / top[c]);
            inside[c] = value;
            for (x, l) in inside[c + 1..].iter_mut().zip(&top[c + 1..]) {
                (0..K).for_each(|k| x[k] -= *l * value[k]);
            }
        }
        sums.clear();
        sums.resize(self.below.len(), [0.0; K]);
        // Four columns at a time: the sums are then read and written a quarter as often.
        for c in (0..self.width - self.width % 4).step_by(4) {
            let v = [inside[c], inside[c + 1], inside[c + 2], inside[c + 3]];
            let [p, q, r, s] = [0, 1, 2, 3].map(|i| self.column(c + i).1);
            for ((((sum, p), q), r), s) in sums.iter_mut().zip(p).zip(q).zip(r).zip(s) {
                (0..K).for_each(|k| {
                    sum[k] += (*p * v[0][k] + *q * v[1][k]) + (*r * v[2][k] + *s * v[3][k]);
                });
            }
        }
        for (c, v) in inside.iter().enumerate().skip(self.width - self.width % 4) {
            for (sum, l) in sums.iter_mut().zip(self.column(c).1) {
                (0..K).for_each(|k| sum[k] += *l * v[k]);
            }
        }
        for (&row, sum) in self.below.iter().zip(sums.iter()) {
            (0..K).for_each(|k| x[row][k] -= sum[k]);
        }
    }

    /// Part of `L⁻ᵀ`.
    fn backward<const K: usize>(&self, x: &mut [[f64; K]], gathered: &mut Vec<[f64; K]>) {
        gathered.clear();
        gathered.extend(self.below.iter().map(|&row| x[row]));
        let inside = &mut x[self.begin..self.begin + self.width];
        for c in (0..self.width - self.width % 4).step_by(4) {
            let [p, q, r, s] = [0, 1, 2, 3].map(|i| self.column(c + i).1);
            let mut sums = [[0.0; K]; 4];
            for ((((x, p), q), r), s) in gathered.iter().zip(p).zip(q).zip(r).zip(s) {
                (0..K).for_each(|k| {
                    sums[0][k] += *p * x[k];
                    sums[1][k] += *q * x[k];
                    sums[2][k] += *r * x[k];
                    sums[3][k] += *s * x[k];
                });
            }
            for (x, sum) in inside[c..].iter_mut().zip(sums) {
                (0..K).for_each(|k| x[k] -= sum[k]);
            }
        }
        for (c, v) in inside.iter_mut().enumerate().skip(self.width - self.width % 4) {
            for (x, l) in gathered.iter().zip(self.column(c).1) {
                (0..K).for_each(|k| v[k] -= *l * x[k]);
            }
        }
        for c in (0..self.width).rev() {
            let top = self.column(c).0;
            let (before, after) = inside.split_at_mut(c + 1);
            for (x, l) in after.iter().zip(&top[c + 1..]) {
                (0..K).for_each(|k| before[c][k] -= *l * x[k]);
            }
            before[c] = before[c].map(|x| x / top[c]);
        }
    }

    /// A column within the diagonal block and below it.
    pub(super) fn column(&self, c: usize) -> (&[f64], &[f64]) {
        let height = self.width + self.below.len();
        self.values[c * height..(c + 1) * height].split_at(self.width)
    }
}

/// Inner product in four running sums.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4.remainder().iter().zip(b4.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a4.zip(b4) {
        (0..4).for_each(|k| sums[k] += x[k] * y[k]);
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// The upper triangle of a symmetric matrix given by its lower one.
fn transposed(size: usize, col_ptr: &[usize], row_idx: &[usize]) -> SymbolicSparseColMat<usize> {
    let mut first = vec![0; size + 1];
    row_idx.iter().for_each(|&row| first[row + 1] += 1);
    for row in 0..size {
        first[row + 1] += first[row];
    }
    let (mut next, mut columns) = (first.clone(), vec![0; row_idx.len()]);
    for column in 0..size {
        for &row in &row_idx[col_ptr[column]..col_ptr[column + 1]] {
            columns[next[row]] = column;
            next[row] += 1;
        }
    }
    SymbolicSparseColMat::new_checked(size, size, first, None, columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_a_small_system_by_hand() {
        // [[4, 2, 0], [2, 5, 1], [0, 1, 3]] x = [8, 15, 11] has x = [1, 2, 3].
        let cholesky = Cholesky::analyse(3, vec![0, 2, 4, 5], vec![0, 1, 1, 2, 2]).unwrap();
        let mut factor = Factor::default();
        cholesky.factorise(&[4.0, 2.0, 5.0, 1.0, 3.0], &mut factor).unwrap();
        let mut x = [[8.0], [15.0], [11.0]];
        cholesky.solve(&factor, &mut x);
        for ([found], expected) in x.iter().zip([1.0, 2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-14);
        }
        assert_eq!(
            cholesky.factorise(&[4.0, 9.0, 5.0, 1.0, 3.0], &mut factor),
            Err(CholeskyError::NotPositiveDefinite)
        );
    }

    #[test]
    fn solves_a_grid_with_many_panels() {
        // Laplacian of a 12 × 12 grid plus the identity.
        let n = 12;
        let (mut col_ptr, mut row_idx, mut values) = (vec![0], Vec::new(), Vec::new());
        for v in 0..n * n {
            let right = (v % n + 1 < n).then_some(v + 1);
            let down = (v + n < n * n).then_some(v + n);
            row_idx.extend([Some(v), right, down].into_iter().flatten());
            values.push(5.0);
            values.resize(row_idx.len(), -1.0);
            col_ptr.push(row_idx.len());
        }
        let truth: Vec<f64> = (0..n * n).map(|v| ((7 * v) % 11) as f64 - 5.0).collect();
        let mut x = vec![[0.0; 2]; n * n];
        for column in 0..n * n {
            for k in col_ptr[column]..col_ptr[column + 1] {
                x[row_idx[k]][1] += values[k] * truth[column];
                if row_idx[k] != column {
                    x[column][1] += values[k] * truth[row_idx[k]];
                }
            }
        }
        let cholesky = Cholesky::analyse(n * n, col_ptr, row_idx).unwrap();
        let mut factor = Factor::default();
        cholesky.factorise(&values, &mut factor).unwrap();
        cholesky.solve(&factor, &mut x);
        assert!(x.iter().zip(&truth).all(|([z, a], b)| *z == 0.0 && (a - b).abs() < 1e-12));
    }
}
