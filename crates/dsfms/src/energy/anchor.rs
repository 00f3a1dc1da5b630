//! What is not seen stays near a reference shape.

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::geometry::Point3;
use nalgebra::{Matrix3, SVector};

/// `r = (xᵢ − x₀ᵢ) / σ`, weighted per vertex.
#[doc(alias = "anchor prior")]
#[derive(Clone, Debug)]
pub struct AnchorPrior {
    /// Vertices that are held.
    pub vertices: Vec<[u32; 1]>,
    /// Where they are held.
    pub reference: Vec<Point3>,
    /// Weight of each, for instance its share of the area.
    pub weights: Vec<f64>,
    /// Expected distance from the reference, length units.
    pub sigma: f64,
}

impl EnergyTerm<3> for AnchorPrior {
    fn count(&self) -> usize {
        self.vertices.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.vertices[i]
    }

    fn weight(&self, i: usize) -> f64 {
        self.weights[i]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 3>>,
    ) -> Result<SVector<f64, 3>, Infeasible> {
        if let Some(j) = jacobian {
            j.vertices[0] = Matrix3::from_diagonal_element(1.0 / self.sigma);
        }
        Ok((v[0] - self.reference[i]) / self.sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let term = AnchorPrior {
            vertices: vec![[7]],
            reference: vec![mesh.positions[3]],
            weights: vec![1.0],
            sigma: 2.0,
        };
        assert_jacobian(&term, &mesh.positions, &[]);
    }
}
