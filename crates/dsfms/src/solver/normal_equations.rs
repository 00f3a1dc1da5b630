//! Gauss–Newton normal equations of per-vertex unknowns bordered by a few global ones:
//!
//! ```text
//! ⎡ A  B ⎤ ⎡ δ vertices ⎤     ⎡ g ⎤
//! ⎣ Bᵀ C ⎦ ⎣ δ globals  ⎦ = − ⎣ h ⎦
//! ```
//!
//! `A` is sparse in 3×3 blocks; `C` is small and dense and is eliminated by its Schur complement.

use super::cholesky::{Cholesky, CholeskyError};
use super::levenberg_marquardt::Step;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::collections::BTreeSet;

/// Which 3×3 blocks of the lower triangle of `A` can be non-zero.
#[derive(Clone, Debug, Default)]
pub struct Pattern {
    vertices: usize,
    /// First block of every block column, and the block count last.
    columns: Vec<usize>,
    /// Block row of every block, ascending in a column, the diagonal first.
    rows: Vec<u32>,
}

impl Pattern {
    /// Blocks for every pair of vertices that share a stencil.
    pub fn new<'a>(vertices: usize, stencils: impl Iterator<Item = &'a [u32]>) -> Self {
        let mut below: Vec<BTreeSet<u32>> = (0..vertices as u32).map(|v| [v].into()).collect();
        for stencil in stencils {
            for &column in stencil {
                below[column as usize].extend(stencil.iter().filter(|&&row| row > column));
            }
        }
        let mut columns = vec![0];
        let mut rows = Vec::new();
        for set in below {
            rows.extend(set);
            columns.push(rows.len());
        }
        Self { vertices, columns, rows }
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no block.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Index of the block of two vertices, whichever is larger; the pair must share a stencil.
    pub fn block(&self, a: u32, b: u32) -> usize {
        let (row, column) = (a.max(b), a.min(b) as usize);
        let range = self.columns[column]..self.columns[column + 1];
        let found = self.rows[range.clone()].binary_search(&row);
        range.start + found.expect("both vertices are in one stencil of the pattern")
    }

    /// The scalar lower triangle: column pointers, row indices, and for every entry its place in
    /// the block values (9 per block, column major).
    fn scalar(&self) -> (Vec<usize>, Vec<usize>, Vec<u32>) {
        let (mut col_ptr, mut row_idx, mut source) = (vec![0], Vec::new(), Vec::new());
        for column in 0..self.vertices {
            for c in 0..3 {
                for block in self.columns[column]..self.columns[column + 1] {
                    let row = self.rows[block] as usize;
                    for r in (if row == column { c } else { 0 })..3 {
                        row_idx.push(3 * row + r);
                        source.push((9 * block + 3 * c + r) as u32);
                    }
                }
                col_ptr.push(row_idx.len());
            }
        }
        (col_ptr, row_idx, source)
    }
}

/// Sums of one linearisation; several are added in fixed order to use all cores.
#[derive(Clone, Debug)]
pub struct Accumulator {
    /// Nine values per block, column major, rows = the larger vertex.
    pub blocks: Vec<Matrix3<f64>>,
    /// Gradient of the vertices.
    pub gradient: Vec<Vector3<f64>>,
    /// `B`, one vertex column block per global.
    pub border: Vec<Vec<Vector3<f64>>>,
    /// `C`.
    pub corner: DMatrix<f64>,
    /// Gradient of the globals.
    pub global_gradient: DVector<f64>,
}

impl Accumulator {
    /// All zero, for a pattern and a number of globals.
    pub fn new(pattern: &Pattern, globals: usize) -> Self {
        Self {
            blocks: vec![Matrix3::zeros(); pattern.len()],
            gradient: vec![Vector3::zeros(); pattern.vertices],
            border: vec![vec![Vector3::zeros(); pattern.vertices]; globals],
            corner: DMatrix::zeros(globals, globals),
            global_gradient: DVector::zeros(globals),
        }
    }

    /// Set everything to zero.
    pub fn clear(&mut self) {
        self.blocks.fill(Matrix3::zeros());
        self.gradient.fill(Vector3::zeros());
        self.border.iter_mut().for_each(|b| b.fill(Vector3::zeros()));
        self.corner.fill(0.0);
        self.global_gradient.fill(0.0);
    }

    /// Add another accumulator of the same shape.
    pub fn add(&mut self, other: &Self) {
        add_all(&mut self.blocks, &other.blocks);
        add_all(&mut self.gradient, &other.gradient);
        for (mine, theirs) in self.border.iter_mut().zip(&other.border) {
            add_all(mine, theirs);
        }
        self.corner += &other.corner;
        self.global_gradient += &other.global_gradient;
    }
}

fn add_all<T: Copy + std::ops::AddAssign>(mine: &mut [T], theirs: &[T]) {
    mine.iter_mut().zip(theirs).for_each(|(m, t)| *m += *t);
}

/// The system at one linearisation, with the symbolic factor kept between them.
pub struct NormalEquations {
    cholesky: Cholesky,
    source: Vec<u32>,
    diagonal: Vec<usize>,
    values: Vec<f64>,
    damped: Vec<f64>,
    sums: Accumulator,
}

impl NormalEquations {
    /// Analyse a pattern once for all linearisations.
    pub fn new(pattern: &Pattern, globals: usize) -> Result<Self, CholeskyError> {
        let (col_ptr, row_idx, source) = pattern.scalar();
        let diagonal = col_ptr[..col_ptr.len() - 1].to_vec();
        let cholesky = Cholesky::analyse(3 * pattern.vertices, col_ptr, row_idx)?;
        let values = vec![0.0; source.len()];
        let sums = Accumulator::new(pattern, globals);
        Ok(Self { cholesky, source, diagonal, damped: values.clone(), values, sums })
    }

    /// Take the sums of a linearisation (in the given order) as the system.
    pub fn assemble<'a>(&mut self, parts: impl Iterator<Item = &'a Accumulator>) {
        self.sums.clear();
        parts.for_each(|part| self.sums.add(part));
        for (value, &source) in self.values.iter_mut().zip(&self.source) {
            *value = self.sums.blocks[source as usize / 9][source as usize % 9];
        }
    }

    /// Norm of the whole gradient.
    pub fn gradient_norm(&self) -> f64 {
        let vertices: f64 = self.sums.gradient.iter().map(|g| g.norm_squared()).sum();
        (vertices + self.sums.global_gradient.norm_squared()).sqrt()
    }

    /// Factorise `A + damping·diag A`, with a floor that keeps vertices without evidence solvable.
    fn factorise(&mut self, damping: f64) -> Result<(), CholeskyError> {
        self.damped.copy_from_slice(&self.values);
        let largest = self.diagonal.iter().fold(0.0_f64, |m, &d| m.max(self.values[d]));
        for &d in &self.diagonal {
            self.damped[d] += damping * self.values[d] + 1e-12 * largest + f64::MIN_POSITIVE;
        }
        self.cholesky.factorise(&self.damped)
    }

    /// Solve `(H + damping·diag H) δ = −∇` and predict the decrease of the cost
    /// (whose gradient is twice `∇`, as for a sum of squares).
    pub fn step(&mut self, damping: f64) -> Option<Step> {
        self.factorise(damping).ok()?;
        let (n, m) = (3 * self.sums.gradient.len(), self.sums.corner.nrows());
        let mut rhs: Vec<f64> =
            self.sums.gradient.iter().flat_map(|g| [-g.x, -g.y, -g.z]).collect();
        rhs.extend(self.sums.border.iter().flatten().flat_map(|b| [b.x, b.y, b.z]));
        self.cholesky.solve(&mut rhs);
        let mut delta = rhs[..n].to_vec();
        if m > 0 {
            let globals = self.schur_step(damping, &rhs)?;
            for (k, &g) in globals.iter().enumerate() {
                let column = &rhs[(k + 1) * n..(k + 2) * n];
                delta.iter_mut().zip(column).for_each(|(d, c)| *d -= g * c);
            }
            delta.extend(globals.iter());
        }
        let predicted = self.predicted(&delta, damping);
        (predicted.is_finite()).then_some(Step { delta, predicted })
    }

    /// Globals of the step, given `A⁻¹[−g, B]`.
    fn schur_step(&self, damping: f64, solved: &[f64]) -> Option<DVector<f64>> {
        let (n, m) = (3 * self.sums.gradient.len(), self.sums.corner.nrows());
        let dot = |k: usize, x: &[f64]| -> f64 {
            let border = self.sums.border[k].iter().flat_map(|b| b.iter());
            border.zip(x).map(|(b, x)| b * x).sum()
        };
        let mut schur = self.sums.corner.clone();
        let mut rhs = -&self.sums.global_gradient;
        for k in 0..m {
            schur[(k, k)] += damping * self.sums.corner[(k, k)] + f64::MIN_POSITIVE;
            rhs[k] -= dot(k, &solved[..n]);
            for l in 0..m {
                schur[(k, l)] -= dot(k, &solved[(l + 1) * n..(l + 2) * n]);
            }
        }
        let symmetric = (&schur + schur.transpose()) * 0.5;
        Some(symmetric.cholesky()?.solve(&rhs))
    }

    /// Decrease of the undamped quadratic model: `−2∇ᵀδ − δᵀHδ = −∇ᵀδ + μ δᵀDδ`.
    fn predicted(&self, delta: &[f64], damping: f64) -> f64 {
        let n = 3 * self.sums.gradient.len();
        let gradient = self.sums.gradient.iter().flat_map(|g| g.iter());
        let mut sum: f64 = gradient.zip(delta).map(|(g, d)| -g * d).sum();
        for (i, &place) in self.diagonal.iter().enumerate() {
            sum += damping * self.values[place] * delta[i] * delta[i];
        }
        for (k, d) in delta[n..].iter().enumerate() {
            sum += -self.sums.global_gradient[k] * d + damping * self.sums.corner[(k, k)] * d * d;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bordered_step_solves_the_dense_system() {
        let stencils: [&[u32]; 2] = [&[0, 1], &[1, 2]];
        let pattern = Pattern::new(3, stencils.into_iter());
        let mut sums = Accumulator::new(&pattern, 1);
        for v in 0..3 {
            let diagonal = Matrix3::new(4., 1., 0., 1., 5., 1., 0., 1., 6.);
            sums.blocks[pattern.block(v, v)] = diagonal;
            sums.gradient[v as usize] = Vector3::new(1.0, -2.0, v as f64);
            sums.border[0][v as usize] = Vector3::new(0.5, 0.1 * v as f64, -0.3);
        }
        let off = Matrix3::new(0.3, 0., 0.1, 0.2, -0.4, 0., 0., 0.1, 0.2);
        sums.blocks[pattern.block(0, 1)] = off;
        sums.corner[(0, 0)] = 7.0;
        sums.global_gradient[0] = 0.7;
        let mut system = NormalEquations::new(&pattern, 1).unwrap();
        system.assemble([&sums].into_iter());
        let step = system.step(0.0).unwrap();
        let mut dense = DMatrix::zeros(10, 10);
        let mut gradient = DVector::zeros(10);
        for v in 0..3 {
            let block = sums.blocks[pattern.block(v, v)];
            dense.view_mut((3 * v as usize, 3 * v as usize), (3, 3)).copy_from(&block);
            let border = sums.border[0][v as usize];
            dense.view_mut((3 * v as usize, 9), (3, 1)).copy_from(&border);
            dense.view_mut((9, 3 * v as usize), (1, 3)).copy_from(&border.transpose());
            gradient.rows_mut(3 * v as usize, 3).copy_from(&sums.gradient[v as usize]);
        }
        dense.view_mut((3, 0), (3, 3)).copy_from(&off);
        dense.view_mut((0, 3), (3, 3)).copy_from(&off.transpose());
        (dense[(9, 9)], gradient[9]) = (7.0, 0.7);
        let expected = dense.clone().lu().solve(&-&gradient).unwrap();
        let found = DVector::from_vec(step.delta);
        assert!((&found - &expected).norm() < 1e-10);
        let promised = -2.0 * gradient.dot(&found) - (&dense * &found).dot(&found);
        assert!((promised - step.predicted).abs() < 1e-9);
    }
}
