//! Specular condition of eq. 4: a saturated vertex mirrors the light into the camera.

use super::ring::OneRing;
use super::{EnergyTerm, Infeasible, Jacobian};
use crate::geometry::{Point3, Vector3};
use crate::mesh::Topology;
use nalgebra::{Matrix3, SVector};

/// `r = (h × Nᵢ) / σ` for the specular vertices `𝒮ᵥ`, with `h` the mirror normal (the paper's `L`;
/// for a near light it is the half vector, not the optical axis).
///
/// `h` is held at its value for the starting shape: its derivative, of the order of 1/depth, is
/// dropped.
#[doc(alias("eq. 4", "highlight"))]
#[derive(Clone, Debug)]
pub struct Specular {
    rings: Vec<OneRing>,
    mirror: Vec<Vector3>,
    sigma: f64,
}

impl Specular {
    /// The condition on vertices with their mirror normals; `sigma` in radians.
    pub fn new(topology: &Topology, vertices: &[(u32, Vector3)], sigma: f64) -> Self {
        let (mut rings, mut mirror) = (Vec::new(), Vec::new());
        for &(vertex, h) in vertices {
            if let Some(ring) = OneRing::of(topology, vertex) {
                rings.push(ring);
                mirror.push(h);
            }
        }
        Self { rings, mirror, sigma }
    }
}

impl EnergyTerm<3> for Specular {
    fn count(&self) -> usize {
        self.rings.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.rings[i].stencil
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 3>>,
    ) -> Result<SVector<f64, 3>, Infeasible> {
        let (ring, h) = (&self.rings[i], &self.mirror[i]);
        let normal = ring.normal(v).ok_or(Infeasible)?;
        if let Some(j) = jacobian {
            let cross: Matrix3<f64> = h.cross_matrix() / self.sigma;
            for row in 0..3 {
                let d_normal = cross.row(row).transpose();
                ring.pull_back(v, &normal, &d_normal, |k, d| {
                    let mut to = j.vertices[k].row_mut(row);
                    to += d.transpose();
                });
            }
        }
        Ok(h.cross(&normal.unit) / self.sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let h = Vector3::new(0.1, -0.2, -1.0).normalize();
        let term = Specular::new(&mesh.topology, &[(6, h), (12, h), (0, h)], 0.2);
        assert_jacobian(&term, &mesh.positions, &[]);
    }
}
