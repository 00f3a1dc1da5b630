//! Boundary condition of eq. 4: the depth of the matches stays where motion put it.

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::geometry::Point3;
use nalgebra::{Matrix1x3, SVector};

/// `r = (z(v(f)·b) − z₀) / σ_z`.
#[doc(alias("eq. 4", "depth prior"))]
#[derive(Clone, Debug)]
pub struct Boundary {
    /// Corner vertices of every match's face.
    pub faces: Vec<[u32; 3]>,
    /// Barycentrics on that face.
    pub barycentrics: Vec<[f64; 3]>,
    /// Depth to hold, length units.
    pub depths: Vec<f64>,
    /// Noise of that depth, length units, one a match.
    pub sigmas: Vec<f64>,
}

impl EnergyTerm<1> for Boundary {
    fn count(&self) -> usize {
        self.depths.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.faces[i]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        let (b, sigma) = (self.barycentrics[i], self.sigmas[i]);
        if let Some(j) = jacobian {
            for (to, weight) in j.vertices.iter_mut().zip(b) {
                *to = Matrix1x3::new(0.0, 0.0, weight / sigma);
            }
        }
        let z = b[0] * v[0].z + b[1] * v[1].z + b[2] * v[2].z;
        Ok(SVector::from([(z - self.depths[i]) / sigma]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative_and_value() {
        let mesh = bent_patch();
        let term = Boundary {
            faces: vec![mesh.topology.faces[3]],
            barycentrics: vec![[0.1, 0.7, 0.2]],
            depths: vec![58.0],
            sigmas: vec![0.5],
        };
        assert_jacobian(&term, &mesh.positions, &[]);
        let flat = [Point3::new(0.0, 0.0, 59.0); 3];
        assert!((term.residual(0, &flat, &[], None).unwrap()[0] - 2.0).abs() < 1e-12);
    }
}
