//! Sparse Cholesky of a symmetric positive definite matrix, on one thread: same bits every time.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side, Spec};

/// A factorised matrix.
pub struct ScalarCholesky {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
}

impl ScalarCholesky {
    /// Factorise the matrix whose lower triangle the entries `(row, column, value)` give (repeated
    /// ones are added); `None` where it is not positive definite.
    pub fn new(n: usize, lower: &[(usize, usize, f64)]) -> Option<Self> {
        let entries: Vec<_> = lower.iter().map(|&(i, j, v)| Triplet::new(i, j, v)).collect();
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(n, n, &entries).ok()?;
        let symbolic = factorize_symbolic_cholesky(
            matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .ok()?;
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        let mut memory = MemBuffer::try_new(scratch).ok()?;
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Spec::default(),
            )
            .ok()?;
        values.iter().all(|v| v.is_finite()).then_some(Self { symbolic, values })
    }

    /// Overwrite the right-hand side by the solution; `None` where it is not finite.
    pub fn solve(&self, rhs: &mut [f64]) -> Option<()> {
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        let mut memory = MemBuffer::try_new(scratch).ok()?;
        let n = rhs.len();
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(rhs, n, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        rhs.iter().all(|x| x.is_finite()).then_some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_a_two_by_two_system() {
        let factor = ScalarCholesky::new(2, &[(0, 0, 4.0), (1, 0, 2.0), (1, 1, 3.0)]).unwrap();
        let mut x = [8.0, 8.0];
        factor.solve(&mut x).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-14 && (x[1] - 2.0).abs() < 1e-14);
        assert!(ScalarCholesky::new(1, &[(0, 0, -1.0)]).is_none());
    }
}
