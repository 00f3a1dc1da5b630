//! Reprojection condition of eq. 4: vertices stay near the sightlines of V′.

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::camera::Camera;
use crate::geometry::{Point2, Point3};
use nalgebra::SVector;

/// `r = π(v″ᵢ) − π(v′ᵢ)`, px.
#[doc(alias = "eq. 4")]
#[derive(Clone, Debug)]
pub struct Reprojection<'a, C> {
    /// Camera of the frame.
    pub camera: &'a C,
    /// Vertices that are held.
    pub vertices: Vec<[u32; 1]>,
    /// Where V′ puts them, px.
    pub pixels: Vec<Point2>,
}

impl<'a, C: Camera> Reprojection<'a, C> {
    /// Hold the given vertices at their projections in `shape` (those behind the camera are left
    /// out).
    pub fn at(camera: &'a C, shape: &[Point3], vertices: impl Iterator<Item = u32>) -> Self {
        let held = vertices.filter_map(|v| Some((v, camera.project(&shape[v as usize])?.pixel)));
        let (vertices, pixels) = held.map(|(v, pixel)| ([v], pixel)).unzip();
        Self { camera, vertices, pixels }
    }
}

impl<C: Camera> EnergyTerm<2> for Reprojection<'_, C> {
    fn count(&self) -> usize {
        self.pixels.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.vertices[i]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 2>>,
    ) -> Result<SVector<f64, 2>, Infeasible> {
        let projection = self.camera.project(&v[0]).ok_or(Infeasible)?;
        if let Some(j) = jacobian {
            j.vertices[0] = projection.jacobian;
        }
        Ok(projection.pixel - self.pixels[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative_and_rest_minimum() {
        let mesh = bent_patch();
        let camera = CameraModel::pinhole([64, 48], [90.0, 95.0], [30.0, 22.0]);
        let term = Reprojection::at(&camera, &mesh.positions, 0..25);
        assert_jacobian(&term, &mesh.positions, &[]);
        assert_eq!(term.residual(3, &mesh.positions[3..4], &[], None).unwrap().norm(), 0.0);
    }
}
