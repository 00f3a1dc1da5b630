//! Sparse Cholesky of a symmetric positive definite matrix, on one thread (faer without its `rayon`
//! feature): same bits every time.

use faer::linalg::solvers::SolveCore;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Side};

/// A factorised matrix.
pub struct ScalarCholesky(Llt<usize, f64>);

impl ScalarCholesky {
    /// Factorise the matrix whose lower triangle the entries `(row, column, value)` give (repeated
    /// ones are added); `None` where it is not positive definite.
    pub fn new(n: usize, lower: &[(usize, usize, f64)]) -> Option<Self> {
        let entries: Vec<_> = lower.iter().map(|&(i, j, v)| Triplet::new(i, j, v)).collect();
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(n, n, &entries).ok()?;
        matrix.sp_cholesky(Side::Lower).ok().map(Self)
    }

    /// Overwrite the right-hand side by the solution; `None` where it is not finite.
    pub fn solve(&self, rhs: &mut [f64]) -> Option<()> {
        let n = rhs.len();
        let rhs_column = MatMut::from_column_major_slice_mut(&mut *rhs, n, 1);
        self.0.solve_in_place_with_conj(Conj::No, rhs_column);
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
