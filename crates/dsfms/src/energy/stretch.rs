//! Stretch, which the paper does not have: `e = ½ ln det C`, the log of the area ratio.
//!
//! Conformal energies alone do not fix scale: scaling everything about the camera centre keeps
//! every reprojection and every angle. A weak stretch prior does.

use super::RestFaces;
use super::face::{FaceMetric, FaceTerm};

/// Stretch of every face, weighted by `w_f²`.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<'a> {
    /// Rest metric and weights.
    pub rest: &'a RestFaces,
}

impl FaceTerm<1> for Stretch<'_> {
    fn rest(&self) -> &RestFaces {
        self.rest
    }

    fn rows(m: &FaceMetric) -> [(f64, [f64; 3]); 1] {
        let q = 1.0 / (m.root * m.root);
        [(m.root.ln(), [0.5 * q * m.c22, -q * m.c12, 0.5 * q * m.c11])]
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
        assert_jacobian(&Stretch { rest: &rest }, &warped(&mesh, 0.1), &[]);
    }

    #[test]
    fn one_face_by_hand() {
        let rest = right_angle();
        let at = |b, c| moved(&Stretch { rest: &rest }, [b, c])[0];
        assert!((at([3.0, 0.0], [0.0, 3.0]) - 9.0_f64.ln()).abs() < 1e-15);
        assert_eq!(at([1.0, 0.0], [0.5, 1.0]), 0.0);
    }
}
