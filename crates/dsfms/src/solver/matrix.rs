//! The sums of one linearisation, and the matrix that they make, as the solvers read it.

use super::ordering::{Entry, NONE, Ordered};
use super::pattern::Pattern;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Sums of one linearisation; several are added in fixed order to use all cores.
#[derive(Clone, Debug)]
pub struct Accumulator {
    /// Blocks of `N`, rows = the larger vertex.
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
    /// All zero, for the pattern of `N` and a number of globals.
    pub fn new(near: &Pattern, globals: usize) -> Self {
        Self {
            blocks: vec![Matrix3::zeros(); near.len()],
            gradient: vec![Vector3::zeros(); near.vertices()],
            border: vec![vec![Vector3::zeros(); near.vertices()]; globals],
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

/// The parts of the matrix, borrowed by a solver.
pub(super) struct Matrix<'a> {
    pub near: &'a Pattern,
    pub smooth: &'a Pattern,
    pub ordered: &'a Ordered,
    pub isotropic: &'a [f64],
    pub sums: &'a Accumulator,
}

impl Matrix<'_> {
    /// Block of `A` at an entry of the renumbered lower triangle.
    pub(super) fn block(&self, entry: &Entry) -> Matrix3<f64> {
        let mut block = match self.sums.blocks.get(entry.near as usize) {
            Some(block) if entry.flipped => block.transpose(),
            Some(block) => *block,
            None => Matrix3::zeros(),
        };
        if entry.smooth != NONE {
            let isotropic = self.isotropic[entry.smooth as usize];
            (0..3).for_each(|c| block[(c, c)] += isotropic);
        }
        block
    }

    /// Diagonal of `A` at a vertex.
    pub(super) fn diagonal(&self, vertex: usize) -> Vector3<f64> {
        let near = self.sums.blocks[self.near.column(vertex).0].diagonal();
        near.add_scalar(self.isotropic[self.smooth.column(vertex).0])
    }

    /// What is added to the diagonal to keep vertices without evidence solvable.
    pub(super) fn floor(&self) -> f64 {
        let largest = (0..self.near.vertices()).map(|v| self.diagonal(v).max()).fold(0.0, f64::max);
        1e-12 * largest + f64::MIN_POSITIVE
    }
}
