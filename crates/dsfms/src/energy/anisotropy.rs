//! Anisotropy of eq. 3, in the scale-invariant form with a barrier at collapse:
//! `a = (C₁₁ − C₂₂) / (2√det C)`, dimensionless, 0 for a conformal map (whatever its scale).

use super::RestFaces;
use super::face::{FaceMetric, FaceTerm};

/// Anisotropy of every face, weighted by `w_f²`.
#[doc(alias("eq. 3", "conformal prior"))]
#[derive(Clone, Copy, Debug)]
pub struct Anisotropy<'a> {
    /// Rest metric and weights.
    pub rest: &'a RestFaces,
}

impl FaceTerm<1> for Anisotropy<'_> {
    fn rest(&self) -> &RestFaces {
        self.rest
    }

    fn rows(m: &FaceMetric) -> [(f64, [f64; 3]); 1] {
        let value = (m.c11 - m.c22) / (2.0 * m.root);
        // ∂√det/∂C₁₁ = C₂₂/2√det, ∂/∂C₂₂ = C₁₁/2√det, ∂/∂C₁₂ = −C₁₂/√det
        let (half, q) = (0.5 / m.root, value / (m.root * m.root));
        [(value, [half - q * 0.5 * m.c22, q * m.c12, -half - q * 0.5 * m.c11])]
    }
}

#[cfg(test)]
mod tests {
    use super::super::face::{moved, right_angle};
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch, warped};

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let rest = RestFaces::new(&mesh, 7.0);
        assert_jacobian(&Anisotropy { rest: &rest }, &warped(&mesh, 0.1), &[]);
    }

    #[test]
    fn one_face_by_hand() {
        let rest = right_angle();
        let at = |b, c| moved(&Anisotropy { rest: &rest }, [b, c])[0];
        assert_eq!(at([3.0, 0.0], [0.0, 3.0]), 0.0);
        assert!((at([2.0, 0.0], [0.0, 1.0]) - 0.75).abs() < 1e-15);
    }
}
