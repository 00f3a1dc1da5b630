//! The metric of a deformed face in the plane of its rest face, shared by the conformal terms.
//!
//! `F = [x₁−x₀, x₂−x₀] D⁻¹` maps the rest face's own plane to the deformed face and `C = FᵀF` is
//! its metric: anisotropy, shearing and stretch are functions of `C` alone, so they ignore rigid
//! motion.

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::geometry::{Point3, Vector3};
use crate::mesh::Mesh;
use nalgebra::{Matrix2, SVector};

/// Rest faces: their inverse edge matrices and weights.
#[derive(Clone, Debug)]
pub struct RestFaces {
    /// Corner vertices.
    pub faces: Vec<[u32; 3]>,
    /// `D⁻¹` in an orthonormal frame of each rest face.
    pub inverse: Vec<Matrix2<f64>>,
    /// `w_f² = area_f / reference area`.
    pub weight: Vec<f64>,
}

impl RestFaces {
    /// Rest metric of every face, with weights relative to `reference_area` (the visible area, so
    /// that the hidden side of a closed organ does not dilute the prior).
    pub fn new(mesh: &Mesh, reference_area: f64) -> Self {
        let count = mesh.topology.faces.len();
        let (mut inverse, mut weight) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for f in 0..count {
            let [a, b, c] = mesh.corners(f);
            let (e1, e2) = (b - a, c - a);
            let n = e1.cross(&e2);
            let length = e1.norm().max(1e-300);
            let d = Matrix2::new(length, e1.dot(&e2) / length, 0.0, n.norm() / length);
            inverse.push(d.try_inverse().unwrap_or_else(Matrix2::zeros));
            weight.push(0.5 * n.norm() / reference_area);
        }
        Self { faces: mesh.topology.faces.clone(), inverse, weight }
    }

    /// The metric of face `f` at the given corners; infeasible where the face has collapsed.
    ///
    /// # Errors
    /// [`Infeasible`].
    pub fn metric(&self, f: usize, corners: &[Point3]) -> Result<FaceMetric, Infeasible> {
        let (e1, e2) = (corners[1] - corners[0], corners[2] - corners[0]);
        let d = &self.inverse[f];
        let f1 = e1 * d[(0, 0)] + e2 * d[(1, 0)];
        let f2 = e1 * d[(0, 1)] + e2 * d[(1, 1)];
        let (c11, c12, c22) = (f1.norm_squared(), f1.dot(&f2), f2.norm_squared());
        let determinant = c11 * c22 - c12 * c12;
        if determinant.is_nan() || determinant <= 1e-12 {
            return Err(Infeasible);
        }
        Ok(FaceMetric { f1, f2, c11, c12, c22, root: determinant.sqrt(), inverse: *d })
    }
}

/// `C` of one face and what its derivatives need.
#[derive(Clone, Copy, Debug)]
pub struct FaceMetric {
    f1: Vector3,
    f2: Vector3,
    /// `C₁₁`.
    pub c11: f64,
    /// `C₁₂`.
    pub c12: f64,
    /// `C₂₂`.
    pub c22: f64,
    /// `√det C`: the area ratio.
    pub root: f64,
    inverse: Matrix2<f64>,
}

impl FaceMetric {
    /// Gradient with respect to the three corners of a function of `C`, given its partial
    /// derivatives `[∂C₁₁, ∂C₁₂, ∂C₂₂]`.
    pub(crate) fn pull_back(&self, d: [f64; 3]) -> [Vector3; 3] {
        let g1 = self.f1 * (2.0 * d[0]) + self.f2 * d[1];
        let g2 = self.f2 * (2.0 * d[2]) + self.f1 * d[1];
        let second = g1 * self.inverse[(0, 0)] + g2 * self.inverse[(0, 1)];
        let third = g1 * self.inverse[(1, 0)] + g2 * self.inverse[(1, 1)];
        [-(second + third), second, third]
    }
}

/// A term of the metric of every face, weighted by `w_f²`: its formula, and nothing else.
pub trait FaceTerm<const R: usize>: Send + Sync {
    /// Rest metric and weights.
    fn rest(&self) -> &RestFaces;

    /// Every row of the residual of a face with its partial derivatives `[∂C₁₁, ∂C₁₂, ∂C₂₂]`.
    fn rows(m: &FaceMetric) -> [(f64, [f64; 3]); R];
}

impl<const R: usize, T: FaceTerm<R>> EnergyTerm<R> for T {
    fn count(&self) -> usize {
        self.rest().faces.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.rest().faces[i]
    }

    fn weight(&self, i: usize) -> f64 {
        self.rest().weight[i]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, R>>,
    ) -> Result<SVector<f64, R>, Infeasible> {
        let metric = self.rest().metric(i, v)?;
        let rows = T::rows(&metric);
        if let Some(j) = jacobian {
            for (row, (_, partial)) in rows.iter().enumerate() {
                for (to, g) in j.vertices.iter_mut().zip(metric.pull_back(*partial)) {
                    to.set_row(row, &g.transpose());
                }
            }
        }
        Ok(SVector::from(rows.map(|(value, _)| value)))
    }
}

/// A face with a right angle between edges of length one.
#[cfg(test)]
pub(super) fn right_angle() -> RestFaces {
    let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
    let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2]]).expect("one face");
    RestFaces::new(&mesh, 0.5)
}

/// Value of a term on [`right_angle`] with its second and third corner moved here.
#[cfg(test)]
pub(super) fn moved<const R: usize>(
    term: &impl EnergyTerm<R>,
    [b, c]: [[f64; 2]; 2],
) -> SVector<f64, R> {
    let corners = [[0.0; 2], b, c].map(|[x, y]| Point3::new(x, y, 0.0));
    term.residual(0, &corners, &[], None).expect("no collapse")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::bent_patch;

    #[test]
    fn metric_of_the_rest_shape_is_the_identity() {
        let mesh = bent_patch();
        let rest = RestFaces::new(&mesh, 1.0);
        for f in 0..mesh.topology.faces.len() {
            let m = rest.metric(f, &mesh.corners(f).map(|p| *p)).unwrap();
            assert!((m.c11 - 1.0).abs() + m.c12.abs() + (m.c22 - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn collapsed_face_is_infeasible() {
        let mesh = bent_patch();
        let [a, b, _] = mesh.corners(0).map(|p| *p);
        assert_eq!(RestFaces::new(&mesh, 1.0).metric(0, &[a, b, b]).err(), Some(Infeasible));
    }
}
