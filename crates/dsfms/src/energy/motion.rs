//! Motion of eq. 3: matched surface points must project where they were seen.

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::camera::Camera;
use crate::geometry::{Point2, Point3, point_at};
use nalgebra::SVector;

/// `r = (π(v(f)·b) − w) / σ`, in units of the matches' noise.
#[doc(alias("eq. 3", "reprojection error"))]
#[derive(Clone, Debug)]
pub struct Motion<'a, C> {
    /// Camera of the frame.
    pub camera: &'a C,
    /// Corner vertices of every match's face.
    pub faces: Vec<[u32; 3]>,
    /// Barycentrics on that face.
    pub barycentrics: Vec<[f64; 3]>,
    /// Where the point was seen, px.
    pub pixels: Vec<Point2>,
    /// Noise of the matches, px.
    pub sigma_px: f64,
}

impl<C: Camera> EnergyTerm<2> for Motion<'_, C> {
    fn count(&self) -> usize {
        self.pixels.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.faces[i]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 2>>,
    ) -> Result<SVector<f64, 2>, Infeasible> {
        let b = self.barycentrics[i];
        let point = point_at([&v[0], &v[1], &v[2]], b);
        let projection = self.camera.project(&point).ok_or(Infeasible)?;
        if let Some(j) = jacobian {
            for (to, weight) in j.vertices.iter_mut().zip(b) {
                *to = projection.jacobian * (weight / self.sigma_px);
            }
        }
        Ok((projection.pixel - self.pixels[i]) / self.sigma_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::energy::check::{assert_jacobian, bent_patch};

    fn camera() -> CameraModel {
        CameraModel::pinhole([64, 48], [100.0, 110.0], [31.0, 23.0])
    }

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let term = Motion {
            camera: &camera(),
            faces: mesh.topology.faces[..4].to_vec(),
            barycentrics: vec![[0.2, 0.3, 0.5]; 4],
            pixels: vec![Point2::new(30.0, 20.0); 4],
            sigma_px: 1.5,
        };
        assert_jacobian(&term, &mesh.positions, &[]);
    }

    #[test]
    fn behind_the_camera_is_infeasible_not_zero() {
        let term = Motion {
            camera: &camera(),
            faces: vec![[0, 1, 2]],
            barycentrics: vec![[1.0, 0.0, 0.0]],
            pixels: vec![Point2::origin()],
            sigma_px: 1.0,
        };
        let behind = [Point3::new(0.0, 0.0, -5.0); 3];
        assert_eq!(term.residual(0, &behind, &[], None), Err(Infeasible));
    }
}
