//! Gauss–Newton normal equations of per-vertex unknowns bordered by a few global ones:
//!
//! ```text
//! ⎡ A  B ⎤ ⎡ δ vertices ⎤     ⎡ g ⎤
//! ⎣ Bᵀ C ⎦ ⎣ δ globals  ⎦ = − ⎣ h ⎦
//! ```
//!
//! `A = N + S ⊗ I₃`: `N` in 3×3 blocks changes with every linearisation; `S`, one number for a pair
//! of vertices, comes from the terms that are linear in the positions (smoothing) and stays. `C` is
//! small and dense. Small meshes are solved directly, large ones by preconditioned conjugate
//! gradients; the choice depends on the number of vertices alone.

use super::cholesky::CholeskyError;
use super::direct::Direct;
use super::iterative::Iterative;
use super::levenberg_marquardt::Step;
pub use super::matrix::Accumulator;
use super::matrix::Matrix;
use super::ordering::Ordered;
use super::pattern::Pattern;
use nalgebra::{Point3, Vector3};

/// Meshes of more vertices are solved iteratively.
pub(crate) const DIRECT_UP_TO: usize = 500;

/// The system at one linearisation, with the ordering and the symbolic factor kept between them.
pub struct NormalEquations {
    near: Pattern,
    smooth: Pattern,
    ordered: Ordered,
    isotropic: Vec<f64>,
    sums: Accumulator,
    direct: Option<Direct>,
    iterative: Option<Iterative>,
    /// By which the iterative solver reduces the residual.
    reduction: f64,
}

impl NormalEquations {
    /// Order and analyse the patterns of `N` and `S` once for all linearisations.
    ///
    /// # Errors
    /// A system too large for its index type or for the memory.
    pub fn new(near: Pattern, smooth: Pattern, globals: usize) -> Result<Self, CholeskyError> {
        let ordered = Ordered::new(&near, &smooth)?;
        let sums = Accumulator::new(&near, globals);
        let isotropic = vec![0.0; smooth.len()];
        let (direct, iterative) = (None, None);
        Ok(Self { near, smooth, ordered, isotropic, sums, direct, iterative, reduction: 0.1 })
    }

    /// Pattern of `N`.
    pub fn near(&self) -> &Pattern {
        &self.near
    }

    /// Pattern of `S`.
    pub fn smooth(&self) -> &Pattern {
        &self.smooth
    }

    /// Number of global unknowns.
    pub fn globals(&self) -> usize {
        self.sums.corner.nrows()
    }

    /// Values of `S`, in its pattern's order.
    pub(crate) fn isotropic_mut(&mut self) -> &mut [f64] {
        &mut self.isotropic
    }

    /// Take a shape near the solution, from which the iterative solver takes its local axes.
    /// Without it, or with few vertices, the system is solved directly.
    ///
    /// # Errors
    /// A system too large for its index type or for the memory.
    pub(crate) fn orient(&mut self, vertices: &[Point3<f64>]) -> Result<(), CholeskyError> {
        if vertices.len() <= DIRECT_UP_TO {
            return Ok(());
        }
        let mut solver = match self.iterative.take() {
            Some(solver) => solver,
            None => Iterative::new(&self.ordered)?,
        };
        solver.orient(&self.matrix(), vertices);
        self.iterative = Some(solver);
        Ok(())
    }

    /// How far the iterative solver reduces the residual of a system.
    pub(crate) fn reduce_by(&mut self, reduction: f64) {
        self.reduction = reduction;
    }

    fn matrix(&self) -> Matrix<'_> {
        let Self { near, smooth, ordered, isotropic, sums, .. } = self;
        Matrix { near, smooth, ordered, isotropic, sums }
    }

    /// Take the sums of a linearisation (in the given order) as the system; what they held is lost.
    pub(crate) fn assemble(&mut self, parts: &mut [Accumulator]) {
        let Some((first, rest)) = parts.split_first_mut() else { return self.sums.clear() };
        std::mem::swap(&mut self.sums, first);
        rest.iter().for_each(|part| self.sums.add(part));
    }

    /// Norm of the whole gradient.
    pub(crate) fn gradient_norm(&self) -> f64 {
        let vertices: f64 = self.sums.gradient.iter().map(|g| g.norm_squared()).sum();
        (vertices + self.sums.global_gradient.norm_squared()).sqrt()
    }

    /// Solve `(H + damping·diag H) δ = −∇` and predict the decrease of the cost
    /// (whose gradient is twice `∇`, as for a sum of squares).
    pub fn step(&mut self, damping: f64) -> Option<Step> {
        if let Some(mut solver) = self.iterative.take() {
            let found = solver.step(&self.matrix(), damping, self.reduction);
            self.iterative = Some(solver);
            if let Some((delta, slack)) = found {
                let predicted = self.predicted(&delta, damping) + slack;
                return predicted.is_finite().then_some(Step { delta, predicted });
            }
        }
        let mut solver = match self.direct.take() {
            Some(solver) => solver,
            None => Direct::new(&self.ordered).ok()?,
        };
        let delta = solver.step(&self.matrix(), damping);
        self.direct = Some(solver);
        let delta = delta?;
        let predicted = self.predicted(&delta, damping);
        predicted.is_finite().then_some(Step { delta, predicted })
    }

    /// Decrease of the undamped quadratic model at a solution of the damped system:
    /// `−2∇ᵀδ − δᵀHδ = −∇ᵀδ + μ δᵀDδ`.
    fn predicted(&self, delta: &[f64], damping: f64) -> f64 {
        let matrix = self.matrix();
        let mut sum = 0.0;
        for (v, d) in delta[..3 * self.near.vertices()].chunks_exact(3).enumerate() {
            let d = Vector3::new(d[0], d[1], d[2]);
            let curvature = matrix.diagonal(v).component_mul(&d).dot(&d);
            sum += damping * curvature - self.sums.gradient[v].dot(&d);
        }
        for (k, d) in delta[3 * self.near.vertices()..].iter().enumerate() {
            sum += -self.sums.global_gradient[k] * d + damping * self.sums.corner[(k, k)] * d * d;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector, Matrix3};

    #[test]
    fn bordered_step_solves_the_dense_system() {
        let stencils: [&[u32]; 2] = [&[0, 1], &[1, 2]];
        let pattern = Pattern::new(3, stencils.into_iter());
        let far: [&[u32]; 1] = [&[0, 2]];
        let smooth = Pattern::new(3, far.into_iter());
        let block = |a, b| pattern.find(a, b).unwrap();
        let mut sums = Accumulator::new(&pattern, 1);
        for v in 0..3 {
            let diagonal = Matrix3::new(4., 1., 0., 1., 5., 1., 0., 1., 6.);
            sums.blocks[block(v, v)] = diagonal;
            sums.gradient[v as usize] = Vector3::new(1.0, -2.0, v as f64);
            sums.border[0][v as usize] = Vector3::new(0.5, 0.1 * v as f64, -0.3);
        }
        let off = Matrix3::new(0.3, 0., 0.1, 0.2, -0.4, 0., 0., 0.1, 0.2);
        sums.blocks[block(0, 1)] = off;
        sums.corner[(0, 0)] = 7.0;
        sums.global_gradient[0] = 0.7;
        let mut system = NormalEquations::new(pattern.clone(), smooth.clone(), 1).unwrap();
        system.isotropic_mut()[smooth.find(0, 2).unwrap()] = -0.6;
        system.isotropic_mut()[smooth.find(2, 2).unwrap()] = 0.9;
        system.assemble(&mut [sums.clone()]);
        let step = system.step(0.0).unwrap();
        let mut dense = DMatrix::zeros(10, 10);
        let mut gradient = DVector::zeros(10);
        for v in 0..3 {
            dense
                .view_mut((3 * v, 3 * v), (3, 3))
                .copy_from(&sums.blocks[block(v as u32, v as u32)]);
            let border = sums.border[0][v];
            dense.view_mut((3 * v, 9), (3, 1)).copy_from(&border);
            dense.view_mut((9, 3 * v), (1, 3)).copy_from(&border.transpose());
            gradient.rows_mut(3 * v, 3).copy_from(&sums.gradient[v]);
        }
        dense.view_mut((3, 0), (3, 3)).copy_from(&off);
        dense.view_mut((0, 3), (3, 3)).copy_from(&off.transpose());
        for c in 0..3 {
            dense[(6 + c, c)] -= 0.6;
            dense[(c, 6 + c)] -= 0.6;
            dense[(6 + c, 6 + c)] += 0.9;
        }
        (dense[(9, 9)], gradient[9]) = (7.0, 0.7);
        let expected = dense.clone().lu().solve(&-&gradient).unwrap();
        let found = DVector::from_vec(step.delta);
        assert!((&found - &expected).norm() < 1e-10);
        let promised = -2.0 * gradient.dot(&found) - (&dense * &found).dot(&found);
        assert!((promised - step.predicted).abs() < 1e-9);
    }
}
