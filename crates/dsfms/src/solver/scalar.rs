//! Sparse Cholesky of a symmetric positive definite matrix, on one thread (faer without its `rayon`
//! feature): same bits every time.

use faer::linalg::solvers::SolveCore;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Side};

/// An entry of a lower triangle: row, column, value.
type LowerEntry = (usize, usize, f64);

/// The order in which the unknowns of a matrix are eliminated, for factors of matrices whose
/// entries are at the same places.
#[derive(Clone, Debug)]
pub struct ScalarPattern(SymbolicLlt<usize>);

impl ScalarPattern {
    /// Of the matrix whose lower triangle has these entries; `None` where one lies outside of it.
    pub fn of(n: usize, lower: &[LowerEntry]) -> Option<Self> {
        let matrix = matrix(n, lower)?;
        SymbolicLlt::try_new(matrix.symbolic(), Side::Lower).ok().map(Self)
    }

    /// [`ScalarCholesky::new`] of a matrix whose entries are at the places that this was made of.
    pub fn factor(&self, n: usize, lower: &[LowerEntry]) -> Option<ScalarCholesky> {
        let matrix = matrix(n, lower)?;
        let factor = Llt::try_new_with_symbolic(self.0.clone(), matrix.as_ref(), Side::Lower);
        factor.ok().map(ScalarCholesky)
    }
}

fn matrix(n: usize, lower: &[LowerEntry]) -> Option<SparseColMat<usize, f64>> {
    let entries: Vec<_> = lower.iter().map(|&(i, j, v)| Triplet::new(i, j, v)).collect();
    SparseColMat::try_new_from_triplets(n, n, &entries).ok()
}

/// A factorised matrix.
pub struct ScalarCholesky(Llt<usize, f64>);

impl ScalarCholesky {
    /// Factorise the matrix whose lower triangle the entries `(row, column, value)` give (repeated
    /// ones are added); `None` where it is not positive definite.
    pub fn new(n: usize, lower: &[LowerEntry]) -> Option<Self> {
        ScalarPattern::of(n, lower)?.factor(n, lower)
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

    #[test]
    fn a_pattern_is_for_all_values() {
        let of = |a: f64| [(0, 0, 4.0), (1, 0, a), (1, 1, 3.0), (2, 2, 1.0)];
        let pattern = ScalarPattern::of(3, &of(0.0)).unwrap();
        let mut x = [8.0, 8.0, 5.0];
        pattern.factor(3, &of(2.0)).unwrap().solve(&mut x).unwrap();
        assert!((x[0] - 1.0).abs() < 1e-14 && (x[1] - 2.0).abs() < 1e-14 && x[2] == 5.0);
        assert!(pattern.factor(3, &of(4.0)).is_none(), "not positive definite");
    }
}
