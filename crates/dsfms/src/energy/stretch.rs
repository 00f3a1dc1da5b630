//! Stretch, which the paper does not have: `e = ½ ln det C`, the log of the area ratio.
//!
//! Conformal energies alone do not fix scale: scaling everything about the camera centre keeps every
//! reprojection and every angle. A weak stretch prior does.

use super::{EnergyTerm, Infeasible, Jacobian, RestFaces};
use crate::geometry::Point3;
use nalgebra::SVector;

/// Stretch of every face, weighted by `w_f²`.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<'a> {
    /// Rest metric and weights.
    pub rest: &'a RestFaces,
}

impl EnergyTerm<1> for Stretch<'_> {
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
        let value = m.root.ln();
        if let Some(j) = jacobian {
            let q = 1.0 / (m.root * m.root);
            let gradient = m.pull_back([0.5 * q * m.c22, -q * m.c12, 0.5 * q * m.c11]);
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
        assert_jacobian(&Stretch { rest: &rest }, &bent, &[]);
    }

    #[test]
    fn one_face_by_hand() {
        let (a, b, c) = (Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0));
        let mesh = crate::mesh::Mesh::new(vec![a, b, c], vec![[0, 1, 2]]).expect("one face");
        let rest = RestFaces::new(&mesh, 0.5);
        let term = Stretch { rest: &rest };
        let at = |b: Point3, c: Point3| term.residual(0, &[a, b, c], &[], None).unwrap()[0];
        assert!((at(b * 3.0, c * 3.0) - 9.0_f64.ln()).abs() < 1e-15);
        assert_eq!(at(b, Point3::new(0.5, 1.0, 0.0)), 0.0);
    }
}
