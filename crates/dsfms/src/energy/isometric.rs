//! Isometric prior: lengths within the surface are kept, `C = I`.
//!
//! `r = [C₁₁ − 1, √2 C₁₂, C₂₂ − 1] / √2`, so that `‖r‖² = ½‖C − I‖²`. For small strain this is
//! `a² + b² + e²` of anisotropy, shearing and stretch: the conformal prior with its weight on the
//! area ratio as well, hence one weight serves both. Bending costs nothing. Unlike the conformal
//! terms it sees scale, and it stays finite at collapse.

use super::{EnergyTerm, Infeasible, Jacobian, RestFaces};
use crate::geometry::Point3;
use nalgebra::{SVector, Vector3};
use std::f64::consts::FRAC_1_SQRT_2;

/// Metric strain of every face, weighted by `w_f²`.
#[derive(Clone, Copy, Debug)]
pub struct Isometric<'a> {
    /// Rest metric and weights.
    pub rest: &'a RestFaces,
}

impl EnergyTerm<3> for Isometric<'_> {
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
        jacobian: Option<Jacobian<'_, 3>>,
    ) -> Result<SVector<f64, 3>, Infeasible> {
        let m = self.rest.metric(i, v)?;
        if let Some(j) = jacobian {
            let partials = [[FRAC_1_SQRT_2, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, FRAC_1_SQRT_2]];
            for (row, partial) in partials.into_iter().enumerate() {
                for (to, g) in j.vertices.iter_mut().zip(m.pull_back(partial)) {
                    to.set_row(row, &g.transpose());
                }
            }
        }
        Ok(Vector3::new((m.c11 - 1.0) * FRAC_1_SQRT_2, m.c12, (m.c22 - 1.0) * FRAC_1_SQRT_2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch, energy, rigidly_moved, warped};
    use crate::energy::{Anisotropy, Shearing, Stretch};
    use crate::mesh::Mesh;

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let rest = RestFaces::new(&mesh, 7.0);
        assert_jacobian(&Isometric { rest: &rest }, &warped(&mesh, 0.1), &[]);
    }

    #[test]
    fn one_face_by_hand() {
        let (a, b, c) = (Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0));
        let mesh = Mesh::new(vec![a, b, c], vec![[0, 1, 2]]).expect("one face");
        let rest = RestFaces::new(&mesh, 0.5);
        let term = Isometric { rest: &rest };
        let at = |b: Point3, c: Point3| term.residual(0, &[a, b, c], &[], None).unwrap();
        // Twice the size: C = 4 I, ½‖C − I‖² = ½ (9 + 9).
        assert!((at(b * 2.0, c * 2.0).norm_squared() - 9.0).abs() < 1e-12);
        // A shear of ½: C = [[1, ½], [½, 1¼]], ½ (¼ + ¼ + 1/16).
        assert!((at(b, Point3::new(0.5, 1.0, 0.0)).norm_squared() - 9.0 / 32.0).abs() < 1e-12);
    }

    #[test]
    fn ignores_rigid_motion_and_is_the_sum_of_the_conformal_terms_and_stretch_at_small_strain() {
        let mesh = bent_patch();
        let rest = RestFaces::new(&mesh, 7.0);
        let term = Isometric { rest: &rest };
        assert!(energy(&term, &rigidly_moved(&mesh.positions)) < 1e-24);
        let shape = warped(&mesh, 1e-4);
        let found = energy(&term, &shape);
        let sum = energy(&Anisotropy { rest: &rest }, &shape)
            + energy(&Shearing { rest: &rest }, &shape)
            + energy(&Stretch { rest: &rest }, &shape);
        assert!((found / sum - 1.0).abs() < 1e-2, "{found} against {sum}");
        assert!((energy(&term, &rigidly_moved(&shape)) / found - 1.0).abs() < 1e-9);
    }
}
