//! Isometric prior: lengths within the surface are kept, `C = I`.
//!
//! `r = [C₁₁ − 1, √2 C₁₂, C₂₂ − 1] / √2`, so that `‖r‖² = ½‖C − I‖²`. For small strain this is
//! `a² + b² + e²` of anisotropy, shearing and stretch: the conformal prior with its weight on the
//! area ratio as well, hence one weight serves both. Bending costs nothing. Unlike the conformal
//! terms it sees scale, and it stays finite at collapse.

use super::RestFaces;
use super::face::{FaceMetric, FaceTerm};
use std::f64::consts::FRAC_1_SQRT_2;

/// Metric strain of every face, weighted by `w_f²`.
#[derive(Clone, Copy, Debug)]
pub struct Isometric<'a> {
    /// Rest metric and weights.
    pub rest: &'a RestFaces,
}

impl FaceTerm<3> for Isometric<'_> {
    fn rest(&self) -> &RestFaces {
        self.rest
    }

    fn rows(m: &FaceMetric) -> [(f64, [f64; 3]); 3] {
        [
            ((m.c11 - 1.0) * FRAC_1_SQRT_2, [FRAC_1_SQRT_2, 0.0, 0.0]),
            (m.c12, [0.0, 1.0, 0.0]),
            ((m.c22 - 1.0) * FRAC_1_SQRT_2, [0.0, 0.0, FRAC_1_SQRT_2]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::super::face::{moved, right_angle};
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch, energy, rigidly_moved, warped};
    use crate::energy::{Anisotropy, Shearing, Stretch};

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let rest = RestFaces::new(&mesh, 7.0);
        assert_jacobian(&Isometric { rest: &rest }, &warped(&mesh, 0.1), &[]);
    }

    #[test]
    fn one_face_by_hand() {
        let rest = right_angle();
        let square = |b, c| moved(&Isometric { rest: &rest }, [b, c]).norm_squared();
        // Twice the size: C = 4 I, ½‖C − I‖² = ½ (9 + 9).
        assert!((square([2.0, 0.0], [0.0, 2.0]) - 9.0).abs() < 1e-12);
        // A shear of ½: C = [[1, ½], [½, 1¼]], ½ (¼ + ¼ + 1/16).
        assert!((square([1.0, 0.0], [0.5, 1.0]) - 9.0 / 32.0).abs() < 1e-12);
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
