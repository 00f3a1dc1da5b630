//! Photometric condition inside faces: brightness follows the surface.

use super::{Brightness, EnergyTerm, Infeasible, Jacobian};
use crate::camera::Camera;
use crate::geometry::{Point3, Vector3, area_normal};
use crate::image::ColorImage;
use crate::light::Light;
use crate::mesh::Topology;
use nalgebra::SVector;

/// `r = (w·I′(π(p)) − e^γ α s(p, N) − κ w₁) / σ` at points `p = v(f)·b` inside faces, with the normal
/// `N` interpolated from the area-weighted vertex normals, the log gain `γ = g₀` and the ambient
/// light `κ = g₁` as global unknowns.
///
/// Unlike eq. 4, which speaks of vertices only, the samples carry the texture between them, so the
/// image also fixes where on the surface a point lies. A sample that leaves the image goes on seeing
/// its edge: refusing the step would stop an organ that crosses the border from moving at all.
#[derive(Clone, Debug)]
pub struct Photometric<'a, C, L> {
    /// Camera of the frame.
    pub camera: &'a C,
    /// Light of the frame.
    pub light: &'a L,
    /// Image in linear light, smoothed like the albedo.
    pub image: &'a ColorImage,
    samples: Vec<Sample>,
    /// Stencil of every sampled face.
    rings: Vec<FaceRing>,
    ring_of: Vec<u32>,
}

/// One photometric sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Face of the template.
    pub face: u32,
    /// Barycentrics on it.
    pub barycentric: [f64; 3],
    /// What its channels say.
    pub brightness: Brightness,
}

/// A face, the vertices around it, and the faces around its corners in local indices.
#[derive(Clone, Debug)]
struct FaceRing {
    /// The three corners first.
    stencil: Vec<u32>,
    around: [Vec<[u8; 3]>; 3],
}

impl FaceRing {
    fn of(topology: &Topology, face: u32) -> Self {
        let corners = topology.faces[face as usize];
        let mut stencil = corners.to_vec();
        for &f in corners.iter().flat_map(|&v| &topology.vertex_faces[v as usize]) {
            for v in topology.faces[f as usize] {
                if !stencil.contains(&v) {
                    stencil.push(v);
                }
            }
        }
        let local = |v: u32| stencil.iter().position(|&s| s == v).unwrap_or(0) as u8;
        let around = corners.map(|v| {
            let faces = topology.vertex_faces[v as usize].iter();
            faces.map(|&f| topology.faces[f as usize].map(local)).collect()
        });
        Self { stencil, around }
    }

    /// Area-weighted normals of the corners, not normalised.
    fn corner_sums(&self, v: &[Point3]) -> [Vector3; 3] {
        [0, 1, 2].map(|k| {
            let faces = self.around[k].iter();
            faces
                .map(|f: &[u8; 3]| {
                    area_normal(&v[f[0] as usize], &v[f[1] as usize], &v[f[2] as usize])
                })
                .sum()
        })
    }

    /// Hand out the gradient of a function of `Σ bₖ Nₖ / ‖·‖` whose derivative is `d_normal`.
    fn pull_back(
        &self,
        v: &[Point3],
        sums: &[Vector3; 3],
        b: &[f64; 3],
        d_normal: &Vector3,
        mut add: impl FnMut(usize, Vector3),
    ) {
        let (normal, length) = interpolate(sums, b);
        let u = (d_normal - normal * normal.dot(d_normal)) / length;
        for k in 0..3 {
            let size = sums[k].norm();
            let n = sums[k] / size;
            let uk = (u - n * n.dot(&u)) * (b[k] / size);
            for face in &self.around[k] {
                let [p, q, r] = face.map(|i| &v[i as usize]);
                add(face[0] as usize, uk.cross(&(r - q)));
                add(face[1] as usize, uk.cross(&(p - r)));
                add(face[2] as usize, uk.cross(&(q - p)));
            }
        }
    }
}

/// Unit interpolated normal and the length before normalisation.
fn interpolate(sums: &[Vector3; 3], b: &[f64; 3]) -> (Vector3, f64) {
    let sum: Vector3 = (0..3).map(|k| sums[k] * (b[k] / sums[k].norm().max(1e-300))).sum();
    let length = sum.norm().max(1e-300);
    (sum / length, length)
}

impl<'a, C, L> Photometric<'a, C, L> {
    /// The condition at the given samples, best sorted by face.
    pub fn new(
        camera: &'a C,
        light: &'a L,
        image: &'a ColorImage,
        topology: &Topology,
        samples: Vec<Sample>,
    ) -> Self {
        let (mut rings, mut ring_of) = (Vec::<FaceRing>::new(), Vec::new());
        let mut last = u32::MAX;
        for sample in &samples {
            if sample.face != last {
                rings.push(FaceRing::of(topology, sample.face));
                last = sample.face;
            }
            ring_of.push(rings.len() as u32 - 1);
        }
        Self { camera, light, image, samples, rings, ring_of }
    }
}

impl<C: Camera, L: Light> Photometric<'_, C, L> {
    /// Mean of `|image − prediction| / image` over the samples; 0 without any.
    pub fn mean_residual(&self, vertices: &[Point3], globals: &[f64]) -> f64 {
        let (mut sum, mut count, mut stencil) = (0.0, 0.0, Vec::new());
        for i in 0..self.count() {
            stencil.clear();
            stencil.extend(self.stencil(i).iter().map(|&v| vertices[v as usize]));
            let Ok(r) = self.residual(i, &stencil, globals, None) else { continue };
            let Sample { barycentric, brightness, .. } = &self.samples[i];
            let point =
                crate::geometry::point_at([&stencil[0], &stencil[1], &stencil[2]], *barycentric);
            let Some(pixel) = self.camera.project(&point).map(|p| p.pixel) else { continue };
            let Some((seen, _)) = self.image.mixed(&pixel, &brightness.weights) else { continue };
            if seen > 0.0 {
                (sum, count) = (sum + (r[0] * brightness.sigma / seen).abs(), count + 1.0);
            }
        }
        sum / f64::max(count, 1.0)
    }
}

impl<C: Camera, L: Light> EnergyTerm<1> for Photometric<'_, C, L> {
    const LABEL: &'static str = "photometric (joint)";

    fn count(&self) -> usize {
        self.samples.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.rings[self.ring_of[i] as usize].stencil
    }

    fn globals(&self) -> &[usize] {
        &[0, 1]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        g: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        let (ring, sample) = (&self.rings[self.ring_of[i] as usize], &self.samples[i]);
        let b = &sample.barycentric;
        let point = crate::geometry::point_at([&v[0], &v[1], &v[2]], *b);
        let projection = self.camera.project(&point).ok_or(Infeasible)?;
        let Brightness { weights, albedo, white, sigma } = sample.brightness;
        let (intensity, gradient) =
            self.image.mixed(&projection.pixel, &weights).ok_or(Infeasible)?;
        let sums = ring.corner_sums(v);
        let (normal, _) = interpolate(&sums, b);
        let shade = self.light.shade(&point, &normal);
        let brightness = g[0].exp() * albedo;
        if let Some(j) = jacobian {
            let slope = -brightness / sigma;
            ring.pull_back(v, &sums, b, &(shade.d_normal * slope), |k, d| {
                j.vertices[k] += d.transpose();
            });
            let d_point = gradient.transpose() * projection.jacobian / sigma
                + shade.d_point.transpose() * slope;
            for (to, weight) in j.vertices.iter_mut().zip(b) {
                *to += d_point * *weight;
            }
            j.globals[0][0] = slope * shade.value;
            j.globals[1][0] = -white / sigma;
        }
        Ok(SVector::from([(intensity - brightness * shade.value - g[1] * white) / sigma]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{CameraModel, Lens};
    use crate::energy::check::{assert_jacobian, bent_patch};
    use crate::light::{LightModel, PointLight, Spot};

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let camera = CameraModel {
            size: [64, 48],
            focal: [100.0, 110.0],
            centre: [31.2, 23.3],
            lens: Lens::Pinhole,
        };
        // A slanted image: bilinear sampling is then smooth everywhere.
        let data = (0..64 * 48).map(|i| 0.001 * (i % 64) as f32 + 0.004 * (i / 64) as f32);
        let data = data.map(|v| [v, 0.5 * v, 1.0 - v]).collect();
        let image = ColorImage { size: [64, 48], data };
        let samples = [0, 5, 5, 17, 31].map(|face| Sample {
            face,
            barycentric: [0.5, 0.3, 0.2],
            brightness: Brightness {
                weights: [0.5, 0.6, -0.2],
                albedo: 0.6,
                white: 0.9,
                sigma: 0.05,
            },
        });
        let near = LightModel::Point(PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Linear { inner_deg: 2.0, outer_deg: 50.0 },
        });
        for light in [LightModel::Collinear, near] {
            let term = Photometric::new(&camera, &light, &image, &mesh.topology, samples.to_vec());
            assert_jacobian(&term, &mesh.positions, &[0.1, 0.02]);
        }
    }
}
