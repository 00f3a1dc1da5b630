//! Shearing of eq. 3, in the scale-invariant form with a barrier at collapse:
//! `b = C₁₂ / √det C`, dimensionless, 0 for a conformal map (whatever its scale).

use super::{EnergyTerm, Infeasible, Jacobian, RestFaces};
use crate::geometry::Point3;
use nalgebra::SVector;

/// Shearing of every face, weighted by `w_f²`.
#[doc(alias("eq. 3", "conformal prior"))]
#[derive(Clone, Copy, Debug)]
pub struct Shearing<'a> {
    /// Rest metric and weights.
    pub rest: &'a RestFaces,
}

impl EnergyTerm<1> for Shearing<'_> {
    fn count(&self) -> usize {
        self.rest.faces.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.rest.faces[i]
    }

    fn weight(&self, i: usize) -> f64 {
        self.rest.weight[i]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        let m = self.rest.metric(i, v)?;
        let value = m.c12 / m.root;
        if let Some(j) = jacobian {
            let (inverse, q) = (1.0 / m.root, value / (m.root * m.root));
            let gradient = m.pull_back([-q * 0.5 * m.c22, inverse + q * m.c12, -q * 0.5 * m.c11]);
            for (to, g) in j.vertices.iter_mut().zip(gradient) {
                *to = g.transpose();
            }
        }
        Ok(SVector::from([value]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let rest = RestFaces::new(&mesh, 7.0);
        let bent: Vec<_> = mesh
            .positions
            .iter()
            .map(|p| Point3::new(1.1 * p.x, p.y + 0.1 * p.x, p.z + 0.02 * p.x * p.y))
            .collect();
        assert_jacobian(&Shearing { rest: &rest }, &bent, &[]);
    }

    #[test]
    fn one_face_by_hand() {
        let (a, b, c) = (Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0));
        let mesh = crate::mesh::Mesh::new(vec![a, b, c], vec![[0, 1, 2]]).expect("one face");
        let rest = RestFaces::new(&mesh, 0.5);
        let term = Shearing { rest: &rest };
        let at = |b: Point3, c: Point3| term.residual(0, &[a, b, c], &[], None).unwrap()[0];
        assert_eq!(at(b * 3.0, c * 3.0), 0.0);
        assert!((at(b, Point3::new(0.5, 1.0, 0.0)) - 0.5).abs() < 1e-15);
    }
}
