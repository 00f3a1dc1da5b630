//! Silhouette condition: the occluding contour lies on the organ's outline.

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::camera::Camera;
use crate::geometry::{Point2, Point3, Vector3, point_at};
use crate::image::Plane;
use nalgebra::SVector;

/// `r = d(π(v(f)·b + l)) / σ` with the signed distance `d` to the outline, px, positive outside.
/// What the condition holds on one side only (the rim of an open surface, which need not be where
/// the organ ends) has no residual inside.
///
/// A vertex that leaves the image keeps the distance at its edge.
#[doc(alias = "occluding contour")]
#[derive(Clone, Debug)]
pub struct Silhouette<'a, C> {
    /// Camera of the frame.
    pub camera: &'a C,
    /// Signed distance to the organ's outline.
    pub distance: &'a Plane,
    /// Points on the contour.
    pub points: Vec<ContourPoint>,
    /// Noise of the outline, px.
    pub sigma_px: f64,
}

/// A point of the occluding contour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourPoint {
    /// Corner vertices of its face.
    pub corners: [u32; 3],
    /// Barycentrics on that face.
    pub barycentric: [f64; 3],
    /// From there to the contour of the full mesh, camera axes.
    pub offset: Vector3,
    /// It may also lie inside.
    pub one_sided: bool,
}

impl<C: Camera> EnergyTerm<1> for Silhouette<'_, C> {
    fn count(&self) -> usize {
        self.points.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.points[i].corners
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        let ContourPoint { barycentric, offset, one_sided, .. } = self.points[i];
        let point = point_at([&v[0], &v[1], &v[2]], barycentric) + offset;
        let projection = self.camera.project(&point).ok_or(Infeasible)?;
        let [w, h] = self.distance.size.map(|s| s as f64 - 1.0);
        let pixel = projection.pixel;
        let inside = Point2::new(pixel.x.clamp(0.0, w), pixel.y.clamp(0.0, h));
        let (distance, slope) = self.distance.sample(&inside).ok_or(Infeasible)?;
        if one_sided && distance < 0.0 {
            return Ok(SVector::zeros());
        }
        if let Some(j) = jacobian {
            let slope = slope.transpose() * projection.jacobian / self.sigma_px;
            for (to, b) in j.vertices.iter_mut().zip(barycentric) {
                *to = slope * b;
            }
        }
        Ok(SVector::from([distance / self.sigma_px]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative_and_value() {
        let mesh = bent_patch();
        let camera = CameraModel::pinhole([64, 48], [100.0, 110.0], [31.2, 23.3]);
        // The outline is the column x = 30.
        let data = (0..64 * 48).map(|i| (i % 64) as f32 - 30.0).collect();
        let distance = Plane { size: [64, 48], data };
        let point = |one_sided| ContourPoint {
            corners: mesh.topology.faces[7],
            barycentric: [0.2, 0.5, 0.3],
            offset: Vector3::new(0.1, -0.2, 0.0),
            one_sided,
        };
        let term = Silhouette {
            camera: &camera,
            distance: &distance,
            points: vec![false, true, false, true].into_iter().map(point).collect(),
            sigma_px: 2.0,
        };
        assert_jacobian(&term, &mesh.positions, &[]);
        let at = |x: f64| Point3::new((x - 31.2) * 0.5 - 0.1, 0.0, 50.0);
        let value = |i: usize, x: f64| term.residual(i, &[at(x); 3], &[], None).unwrap()[0];
        assert!((value(0, 34.0) - 2.0).abs() < 1e-9 && (value(0, 26.0) + 2.0).abs() < 1e-9);
        assert!((value(1, 34.0) - 2.0).abs() < 1e-9 && value(1, 26.0) == 0.0);
    }
}
