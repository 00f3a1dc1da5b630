//! Smoothing of eqs. 3 and 4: the cotangent Laplacian of the displacement.

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::geometry::{Point3, Vector3};
use crate::mesh::laplacian::Laplacian;
use nalgebra::{Matrix3, SVector};

/// `r = R √(mᵢ/A) (Lap (x − x₀))ᵢ`, with `R = √(A/π)` the radius of a disc of the same area:
/// displacement per length, whatever the mesh resolution.
///
/// The paper prints the Laplacian of the position, which shrinks a curved organ; that form is
/// [`Smoothing::of_position`].
#[doc(alias("eq. 3", "eq. 4", "bending energy"))]
#[derive(Clone, Debug)]
pub struct Smoothing {
    stencils: Vec<Vec<u32>>,
    /// Weight of every stencil vertex, the centre first.
    weights: Vec<Vec<f64>>,
    /// `Σ w x₀`, subtracted.
    reference: Vec<Vector3>,
}

impl Smoothing {
    /// Laplacian of the displacement from `rest` (the posed template, or V′).
    pub fn of_displacement(laplacian: &Laplacian, rest: &[Point3], area: f64) -> Self {
        let mut term = Self::of_position(laplacian, area);
        for ((stencil, weights), to) in
            term.stencils.iter().zip(&term.weights).zip(&mut term.reference)
        {
            let terms = stencil.iter().zip(weights);
            *to = terms.map(|(&v, &w)| rest[v as usize].coords * w).sum();
        }
        term
    }

    /// Laplacian of the position, as printed.
    pub fn of_position(laplacian: &Laplacian, area: f64) -> Self {
        let radius = (area / std::f64::consts::PI).sqrt();
        let (mut stencils, mut weights) = (Vec::new(), Vec::new());
        for (i, row) in laplacian.rows.iter().enumerate().filter(|(_, row)| !row.is_empty()) {
            let scale = radius * (laplacian.mass[i] / area).sqrt();
            let centre: f64 = row.iter().map(|(_, w)| w).sum();
            stencils.push([i as u32].into_iter().chain(row.iter().map(|r| r.0)).collect());
            let ring = row.iter().map(|r| r.1 * scale);
            weights.push([-centre * scale].into_iter().chain(ring).collect());
        }
        let reference = vec![Vector3::zeros(); stencils.len()];
        Self { stencils, weights, reference }
    }
}

impl EnergyTerm<3> for Smoothing {
    fn count(&self) -> usize {
        self.stencils.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.stencils[i]
    }

    fn isotropic(&self, i: usize) -> Option<&[f64]> {
        Some(&self.weights[i])
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 3>>,
    ) -> Result<SVector<f64, 3>, Infeasible> {
        let weights = &self.weights[i];
        if let Some(j) = jacobian {
            for (to, &w) in j.vertices.iter_mut().zip(weights) {
                *to = Matrix3::from_diagonal_element(w);
            }
        }
        let sum: Vector3 = v.iter().zip(weights).map(|(p, &w)| p.coords * w).sum();
        Ok(sum - self.reference[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative_and_rest_minimum() {
        let mesh = bent_patch();
        let laplacian = Laplacian::new(&mesh);
        let term = Smoothing::of_displacement(&laplacian, &mesh.positions, 100.0);
        assert_jacobian(&term, &mesh.positions, &[]);
        for i in 0..term.count() {
            let shift = Vector3::new(1.0, -2.0, 3.0);
            let v: Vec<_> =
                term.stencil(i).iter().map(|&k| mesh.positions[k as usize] + shift).collect();
            assert!(term.residual(i, &v, &[], None).unwrap().norm() < 1e-12);
        }
    }
}
