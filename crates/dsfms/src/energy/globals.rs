//! Priors on the global unknowns (gain, ambient).

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::geometry::Point3;
use nalgebra::SVector;

/// `r = (g − mean) / σ` for each of some globals.
#[derive(Clone, Debug)]
pub struct GlobalsPrior {
    /// Which globals.
    pub indices: Vec<[usize; 1]>,
    /// Expected value.
    pub mean: f64,
    /// Spread of that expectation.
    pub sigma: f64,
}

impl GlobalsPrior {
    /// The prior of one global.
    pub fn of(index: usize, mean: f64, sigma: f64) -> Self {
        Self { indices: vec![[index]], mean, sigma }
    }
}

impl EnergyTerm<1> for GlobalsPrior {
    fn count(&self) -> usize {
        self.indices.len()
    }

    fn stencil(&self, _: usize) -> &[u32] {
        &[]
    }

    fn globals(&self, i: usize) -> &[usize] {
        &self.indices[i]
    }

    fn residual(
        &self,
        _: usize,
        _: &[Point3],
        g: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        if let Some(j) = jacobian {
            j.globals[0][0] = 1.0 / self.sigma;
        }
        Ok(SVector::from([(g[0] - self.mean) / self.sigma]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::assert_jacobian;

    #[test]
    fn derivative() {
        let term = GlobalsPrior { indices: vec![[1], [0]], mean: 0.1, sigma: 0.3 };
        assert_jacobian(&term, &[], &[0.0, 0.4]);
    }
}
