//! Photometric condition on facets: brightness inside a face follows that face alone.

use super::photometric::Sample;
use super::{Brightness, EnergyTerm, Infeasible, Jacobian};
use crate::camera::Camera;
use crate::geometry::{Point3, Vector3, area_normal, median, point_at};
use crate::image::ColorImage;
use crate::light::Light;
use crate::mesh::Topology;
use nalgebra::{Matrix3, Rotation3, SVector};

/// The condition of [`Photometric`](super::Photometric) near a known shape: the normal at a sample is
/// the face's own, turned as the interpolated normal is turned against it on that shape.
///
/// A block reads three vertices instead of a dozen, so that its derivative and the matrix it fills
/// cost a fraction; from frame to frame the turn is taken anew.
#[derive(Clone, Debug)]
pub struct Facets<'a, C, L> {
    camera: &'a C,
    light: &'a L,
    image: &'a ColorImage,
    samples: Vec<Facet>,
}

#[derive(Clone, Debug)]
struct Facet {
    corners: [u32; 3],
    barycentric: [f64; 3],
    brightness: Brightness,
    /// Interpolated normal from the face's.
    turn: Matrix3<f64>,
}

/// A sample on a shape.
struct Seen {
    intensity: f64,
    shade: f64,
}

impl<'a, C: Camera, L: Light> Facets<'a, C, L> {
    /// The condition near the shape that has these unit vertex normals.
    pub fn new(
        camera: &'a C,
        light: &'a L,
        image: &'a ColorImage,
        topology: &Topology,
        shape: &[Point3],
        normals: &[Vector3],
        samples: &[Sample],
    ) -> Self {
        let facet = |sample: &Sample| {
            let corners = topology.faces[sample.face as usize];
            let [a, b, c] = corners.map(|v| &shape[v as usize]);
            let own = area_normal(a, b, c);
            let smooth: Vector3 =
                corners.iter().zip(sample.barycentric).map(|(&v, w)| normals[v as usize] * w).sum();
            let turn = Rotation3::rotation_between(&own, &smooth).unwrap_or_default();
            let Sample { barycentric, brightness, .. } = *sample;
            Facet { corners, barycentric, brightness, turn: *turn.matrix() }
        };
        Self { camera, light, image, samples: samples.iter().map(facet).collect() }
    }

    /// Robust log gain of the image over the prediction for an ambient light; 0 without samples.
    pub fn log_gain(&self, shape: &[Point3], ambient: f64) -> f64 {
        let ratio = |(facet, seen): (&Facet, Seen)| {
            let Brightness { albedo, white, .. } = facet.brightness;
            let ratio = (seen.intensity - ambient * white) / (albedo * seen.shade);
            (ratio > 0.0 && ratio.is_finite()).then(|| ratio.ln())
        };
        let mut ratios: Vec<f64> = self.on(shape).filter_map(ratio).collect();
        median(&mut ratios).unwrap_or(0.0)
    }

    /// Mean of `|image − prediction| / image` over the samples, for a log gain and an ambient light;
    /// 0 without samples.
    pub fn mean_residual(&self, shape: &[Point3], globals: &[f64]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (facet, seen) in self.on(shape).filter(|s| s.1.intensity > 0.0) {
            let Brightness { albedo, white, .. } = facet.brightness;
            let predicted = globals[0].exp() * albedo * seen.shade + globals[1] * white;
            (sum, count) = (sum + (1.0 - predicted / seen.intensity).abs(), count + 1.0);
        }
        sum / f64::max(count, 1.0)
    }

    fn on(&self, shape: &[Point3]) -> impl Iterator<Item = (&Facet, Seen)> {
        self.samples.iter().filter_map(move |facet| {
            let [a, b, c] = facet.corners.map(|v| &shape[v as usize]);
            let point = point_at([a, b, c], facet.barycentric);
            let pixel = self.camera.project(&point)?.pixel;
            let (intensity, _) = self.image.mixed(&pixel, &facet.brightness.weights)?;
            let normal = facet.turn * area_normal(a, b, c).try_normalize(0.0)?;
            Some((facet, Seen { intensity, shade: self.light.shade(&point, &normal).value }))
        })
    }
}

impl<C: Camera, L: Light> EnergyTerm<1> for Facets<'_, C, L> {
    const LABEL: &'static str = "photometric (video)";

    fn count(&self) -> usize {
        self.samples.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.samples[i].corners
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
        let Facet { barycentric, brightness, turn, .. } = &self.samples[i];
        let point = point_at([&v[0], &v[1], &v[2]], *barycentric);
        let projection = self.camera.project(&point).ok_or(Infeasible)?;
        let Brightness { weights, albedo, white, sigma } = *brightness;
        let (intensity, gradient) =
            self.image.mixed(&projection.pixel, &weights).ok_or(Infeasible)?;
        let area = area_normal(&v[0], &v[1], &v[2]);
        let size = area.norm();
        if size.is_nan() || size <= 0.0 {
            return Err(Infeasible);
        }
        let own = area / size;
        let shade = self.light.shade(&point, &(turn * own));
        let gain = g[0].exp() * albedo;
        if let Some(j) = jacobian {
            let slope = -gain / sigma;
            let pulled = turn.tr_mul(&shade.d_normal) * slope;
            let u = (pulled - own * own.dot(&pulled)) / size;
            let edges = [v[2] - v[1], v[0] - v[2], v[1] - v[0]];
            let d_point = gradient.transpose() * projection.jacobian / sigma
                + shade.d_point.transpose() * slope;
            for ((to, edge), &weight) in j.vertices.iter_mut().zip(&edges).zip(barycentric) {
                *to = u.cross(edge).transpose() + d_point * weight;
            }
            j.globals[0][0] = slope * shade.value;
            j.globals[1][0] = -white / sigma;
        }
        Ok(SVector::from([(intensity - gain * shade.value - g[1] * white) / sigma]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{CameraModel, Lens};
    use crate::energy::Photometric;
    use crate::energy::check::{assert_jacobian, bent_patch};
    use crate::light::{LightModel, PointLight, Spot};
    use crate::mesh::normals::vertex_normals;

    fn camera() -> CameraModel {
        CameraModel {
            size: [64, 48],
            focal: [100.0, 110.0],
            centre: [31.2, 23.3],
            lens: Lens::Pinhole,
        }
    }

    /// A slanted image: bilinear sampling is then smooth everywhere.
    fn image() -> ColorImage {
        let data = (0..64 * 48).map(|i| 0.001 * (i % 64) as f32 + 0.004 * (i / 64) as f32);
        ColorImage { size: [64, 48], data: data.map(|v| [v, 0.5 * v, 1.0 - v]).collect() }
    }

    fn samples() -> Vec<Sample> {
        let brightness =
            Brightness { weights: [0.5, 0.6, 0.2], albedo: 0.6, white: 0.9, sigma: 0.05 };
        let barycentric = [0.5, 0.3, 0.2];
        [0, 5, 5, 17, 31].map(|face| Sample { face, barycentric, brightness }).to_vec()
    }

    fn lights() -> [LightModel; 2] {
        let near = LightModel::Point(PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Linear { inner_deg: 2.0, outer_deg: 50.0 },
        });
        [LightModel::Collinear, near]
    }

    #[test]
    fn derivative() {
        let (mesh, camera, image) = (bent_patch(), camera(), image());
        let normals = vertex_normals(&mesh.topology, &mesh.positions);
        for light in lights() {
            let (shape, samples) = (&mesh.positions, samples());
            let term =
                Facets::new(&camera, &light, &image, &mesh.topology, shape, &normals, &samples);
            assert_jacobian(&term, shape, &[0.1, 0.02]);
        }
    }

    #[test]
    fn on_the_known_shape_it_is_the_condition_of_the_smooth_normal() {
        let (mesh, camera, image) = (bent_patch(), camera(), image());
        let normals = vertex_normals(&mesh.topology, &mesh.positions);
        for light in lights() {
            let (shape, samples) = (&mesh.positions, samples());
            let facets =
                Facets::new(&camera, &light, &image, &mesh.topology, shape, &normals, &samples);
            let smooth = Photometric::new(&camera, &light, &image, &mesh.topology, samples.clone());
            for i in 0..samples.len() {
                let on = |stencil: &[u32]| -> Vec<Point3> {
                    stencil.iter().map(|&v| shape[v as usize]).collect()
                };
                let globals = [0.1, 0.02];
                let a = facets.residual(i, &on(facets.stencil(i)), &globals, None).unwrap();
                let b = smooth.residual(i, &on(smooth.stencil(i)), &globals, None).unwrap();
                assert!((a - b).norm() < 1e-9, "{a} {b}");
            }
            let gain = facets.log_gain(shape, 0.02);
            let left = facets.mean_residual(shape, &[gain, 0.02]);
            let more = facets.mean_residual(shape, &[gain + 0.5, 0.02]);
            assert!(left < more, "{left} {more}");
        }
    }
}
