//! Diffuse condition of eq. 4: brightness is albedo times shading.

use super::ring::OneRing;
use super::{Brightness, EnergyTerm, Infeasible, Jacobian};
use crate::camera::Camera;
use crate::geometry::Point3;
use crate::image::ColorImage;
use crate::light::Light;
use crate::mesh::Topology;
use nalgebra::{Matrix3, SVector};

/// `r = (wᵢ·I′(π(xᵢ)) − e^γ αᵢ (s(xᵢ, Nᵢ) + s₀ᵢ) − κ wᵢ·1) / σᵢ` for the diffuse vertices `𝒟ᵥ`,
/// with [`Brightness::added_shade`] `s₀`, the log gain `γ = g₀` and the ambient light `κ = g₁` as
/// global unknowns.
///
/// The image gradient is kept in the derivative of `I′(π(xᵢ))`. A vertex that leaves the image
/// keeps the value at its edge.
#[doc(alias("eq. 4", "Lambertian"))]
#[derive(Clone, Debug)]
pub struct Diffuse<'a, C, L> {
    /// Camera of the frame.
    pub camera: &'a C,
    /// Light of the frame.
    pub light: &'a L,
    /// Image in linear light, smoothed like the albedo.
    pub image: &'a ColorImage,
    rings: Vec<OneRing>,
    seen: Vec<DiffuseVertex>,
}

/// What the diffuse condition knows of one vertex.
#[derive(Clone, Copy, Debug)]
pub struct DiffuseVertex {
    /// The vertex.
    pub vertex: u32,
    /// What its channels say.
    pub brightness: Brightness,
    /// Turns its normal into that of the full mesh ([`Lift::turn`](super::Lift::turn)).
    pub turn: Matrix3<f64>,
}

impl<'a, C, L> Diffuse<'a, C, L> {
    /// The condition on the given vertices (those without a face are left out).
    pub fn new(
        camera: &'a C,
        light: &'a L,
        image: &'a ColorImage,
        topology: &Topology,
        vertices: &[DiffuseVertex],
    ) -> Self {
        let (rings, seen) = (Vec::new(), Vec::new());
        let mut term = Self { camera, light, image, rings, seen };
        for v in vertices {
            if let Some(ring) = OneRing::of(topology, v.vertex) {
                term.rings.push(ring);
                term.seen.push(*v);
            }
        }
        term
    }
}

impl<C: Camera, L: Light> EnergyTerm<1> for Diffuse<'_, C, L> {
    fn count(&self) -> usize {
        self.rings.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.rings[i].stencil
    }

    fn globals(&self, _: usize) -> &[usize] {
        &[0, 1]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        g: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        let ring = &self.rings[i];
        let DiffuseVertex { brightness, turn, .. } = self.seen[i];
        let Brightness { weights, albedo, added_shade, white, sigma } = brightness;
        let normal = ring.normal(v).ok_or(Infeasible)?;
        let projection = self.camera.project(&v[0]).ok_or(Infeasible)?;
        let (intensity, gradient) =
            self.image.mixed(&projection.pixel, &weights).ok_or(Infeasible)?;
        let shade = self.light.shade(&v[0], &(turn * normal.unit));
        let brightness = g[0].exp() * albedo;
        let predicted = brightness * (shade.value + added_shade);
        if let Some(j) = jacobian {
            let slope = -brightness / sigma;
            let d_normal = turn.tr_mul(&shade.d_normal) * slope;
            ring.pull_back(v, &normal, &d_normal, |k, d| {
                j.vertices[k] += d.transpose();
            });
            j.vertices[0] += gradient.transpose() * projection.jacobian / sigma;
            j.vertices[0] += shade.d_point.transpose() * slope;
            j.globals[0][0] = -predicted / sigma;
            j.globals[1][0] = -white / sigma;
        }
        Ok(SVector::from([(intensity - predicted - g[1] * white) / sigma]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::energy::check::{assert_jacobian, bent_patch};
    use crate::light::LightModel;

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let camera = CameraModel::pinhole([64, 48], [100.0, 110.0], [31.2, 23.3]);
        // A slanted image: bilinear sampling is then smooth everywhere.
        let data = (0..64 * 48).map(|i| 0.001 * (i % 64) as f32 + 0.004 * (i / 64) as f32);
        let data = data.map(|v| [v, 0.5 * v, 1.0 - v]).collect();
        let image = ColorImage { size: [64, 48], data };
        let brightness = Brightness {
            weights: [0.5, 0.6, -0.2],
            albedo: 0.6,
            added_shade: 0.02,
            white: 0.9,
            sigma: 0.05,
        };
        let turn = nalgebra::Rotation3::new(nalgebra::Vector3::new(0.1, -0.2, 0.05)).into_inner();
        let seen = |vertex| DiffuseVertex { vertex, brightness, turn };
        let vertices: Vec<_> = (0..25).map(seen).collect();
        let light = LightModel::Collinear;
        let term = Diffuse::new(&camera, &light, &image, &mesh.topology, &vertices);
        assert_jacobian(&term, &mesh.positions, &[0.1, 0.02]);
    }
}
