//! Shearing of eq. 3, in the scale-invariant form with a barrier at collapse:
//! `b = C₁₂ / √det C`, dimensionless, 0 for a conformal map (whatever its scale).

use super::RestFaces;
use super::face::{FaceMetric, FaceTerm};

/// Shearing of every face, weighted by `w_f²`.
#[doc(alias("eq. 3", "conformal prior"))]
#[derive(Clone, Copy, Debug)]
pub struct Shearing<'a> {
    /// Rest metric and weights.
    pub rest: &'a RestFaces,
}

impl FaceTerm<1> for Shearing<'_> {
    fn rest(&self) -> &RestFaces {
        self.rest
    }

    fn rows(m: &FaceMetric) -> [(f64, [f64; 3]); 1] {
        let value = m.c12 / m.root;
        let (inverse, q) = (1.0 / m.root, value / (m.root * m.root));
        [(value, [-q * 0.5 * m.c22, inverse + q * m.c12, -q * 0.5 * m.c11])]
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
        assert_jacobian(&Shearing { rest: &rest }, &warped(&mesh, 0.1), &[]);
    }

    #[test]
    fn one_face_by_hand() {
        let rest = right_angle();
        let at = |b, c| moved(&Shearing { rest: &rest }, [b, c])[0];
        assert_eq!(at([3.0, 0.0], [0.0, 3.0]), 0.0);
        assert!((at([1.0, 0.0], [0.5, 1.0]) - 0.5).abs() < 1e-15);
    }
}
