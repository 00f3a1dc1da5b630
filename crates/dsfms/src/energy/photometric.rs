//! Photometric condition inside faces: brightness follows the surface.

use super::{Brightness, EnergyTerm, Infeasible, Jacobian};
use crate::camera::Camera;
use crate::geometry::{Point3, Vector3, area_normal, median, point_at};
use crate::image::ColorImage;
use crate::light::Light;
use crate::mesh::Topology;
use crate::mesh::normals::vertex_normals;
use nalgebra::{Matrix3, SVector};
use rayon::prelude::*;

/// `r = (w·I′(π(p)) − e^γ α (s(p, N) + s₀) − κ w₁) / σ` at points `p = v(f)·b + l` inside faces,
/// with the normal `N = T n`, `n` interpolated from the area-weighted vertex normals, and the
/// [`Lift`] `(l, T)` of the full mesh over the one that is solved on. `s₀` is
/// [`Brightness::added_shade`]. The log gain `γ = g₀ + Σ wₖ gₖ` varies slowly over the surface; it
/// and the ambient light `κ = g₁` are global unknowns.
///
/// Unlike eq. 4, which has vertices only, the samples carry the texture between them, so the
/// image also fixes where on the surface a point lies. A sample that leaves the image keeps the
/// value at its edge: refusing the step would stop an organ that crosses the border from moving at
/// all.
#[doc(alias = "direct alignment")]
#[derive(Clone, Debug)]
pub struct Photometric<'a, C, L> {
    /// Camera of the frame.
    pub camera: &'a C,
    /// Light of the frame.
    pub light: &'a L,
    /// Image in linear light, smoothed like the albedo.
    pub image: &'a ColorImage,
    rings: &'a FaceRings,
    samples: Vec<Sample>,
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
    /// From the face to the full mesh.
    pub lift: Lift,
    /// Smooth gain.
    pub gain: Gain,
}

/// What a full mesh has beyond the coarser one that carries it, camera axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lift {
    /// From the point on the face to the point on the full mesh.
    pub offset: Vector3,
    /// Turns the interpolated normal into that of the full mesh.
    pub turn: Matrix3<f64>,
}

impl Lift {
    /// The mesh itself.
    pub(crate) const NONE: Self = Self { offset: Vector3::new(0.0, 0.0, 0.0), turn: IDENTITY };
}

const IDENTITY: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);

/// What a sample reads of the gain: `γ = g₀ + Σ wₖ gₖ`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// 0 and 1 (gain and ambient light), then the nodes of the smooth gain.
    globals: [usize; 6],
    /// Weights of the nodes; none where the gain is one for all.
    shares: Option<[f64; 4]>,
}

impl Gain {
    /// One gain for the whole surface.
    pub(crate) const GLOBAL: Self = Self { globals: [0, 1, 0, 0, 0, 0], shares: None };

    /// A gain that varies: globals of the nearest nodes (not 0 or 1, no two the same), and their
    /// weights.
    pub fn smooth([a, b, c, d]: [usize; 4], shares: [f64; 4]) -> Self {
        Self { globals: [0, 1, a, b, c, d], shares: Some(shares) }
    }

    /// The globals it reads.
    fn globals(&self) -> &[usize] {
        if self.shares.is_some() { &self.globals } else { &self.globals[..2] }
    }

    /// `γ` for the gathered globals.
    fn log(&self, g: &[f64]) -> f64 {
        let smooth = self.shares.iter().flatten().zip(&g[2..]).map(|(w, g)| w * g);
        g[0] + smooth.sum::<f64>()
    }

    /// `γ` for all globals.
    fn log_of(&self, globals: &[f64]) -> f64 {
        let nodes = self.shares.iter().flatten().zip(&self.globals[2..]);
        globals[0] + nodes.map(|(w, &k)| w * globals[k]).sum::<f64>()
    }
}

/// What the condition reads about every face of a mesh; outlives a solve.
#[derive(Clone, Debug)]
pub struct FaceRings(Vec<FaceRing>);

impl FaceRings {
    /// Of all faces.
    pub fn of(topology: &Topology) -> Self {
        let faces = (0..topology.faces.len() as u32).into_par_iter();
        Self(faces.map(|face| FaceRing::of(topology, face)).collect())
    }

    /// The vertices about every face.
    pub fn stencils(&self) -> impl Iterator<Item = &[u32]> {
        self.0.iter().map(|ring| &ring.stencil[..])
    }
}

/// A face, the vertices around it, and the faces around its corners in local indices.
#[derive(Clone, Debug)]
struct FaceRing {
    /// The three corners first.
    stencil: Vec<u32>,
    around: [Vec<[u32; 3]>; 3],
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
        let local = |v: u32| stencil.iter().position(|&s| s == v).unwrap_or(0) as u32;
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
                .map(|f: &[u32; 3]| {
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

/// A sample on a shape.
struct SeenSample {
    intensity: f64,
    shade: f64,
}

impl<'a, C: Camera, L: Light> Photometric<'a, C, L> {
    /// The condition at the given samples.
    pub fn new(
        camera: &'a C,
        light: &'a L,
        image: &'a ColorImage,
        rings: &'a FaceRings,
        samples: Vec<Sample>,
    ) -> Self {
        Self { camera, light, image, rings, samples }
    }

    /// Robust log gain of the image over the prediction for an ambient light; 0 without samples.
    pub(crate) fn log_gain(&self, topology: &Topology, shape: &[Point3], ambient: f64) -> f64 {
        let ratio = |(sample, seen): (&Sample, SeenSample)| {
            let Brightness { albedo, added_shade, white, .. } = sample.brightness;
            let ratio = (seen.intensity - ambient * white) / (albedo * (seen.shade + added_shade));
            (ratio > 0.0 && ratio.is_finite()).then(|| ratio.ln())
        };
        let mut ratios: Vec<f64> = self.on(topology, shape).into_iter().filter_map(ratio).collect();
        median(&mut ratios).unwrap_or(0.0)
    }

    /// Mean of `|image − prediction| / image` over the samples, for a log gain and an ambient
    /// light; 0 without samples.
    pub(crate) fn mean_residual(
        &self,
        topology: &Topology,
        shape: &[Point3],
        globals: &[f64],
    ) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (sample, seen) in self.on(topology, shape) {
            let Brightness { albedo, added_shade, white, .. } = sample.brightness;
            let brightness = sample.gain.log_of(globals).exp() * albedo;
            let predicted = brightness * (seen.shade + added_shade) + globals[1] * white;
            if seen.intensity > 0.0 {
                (sum, count) = (sum + (1.0 - predicted / seen.intensity).abs(), count + 1.0);
            }
        }
        sum / f64::max(count, 1.0)
    }

    fn on(&self, topology: &Topology, shape: &[Point3]) -> Vec<(&Sample, SeenSample)> {
        let normals = vertex_normals(topology, shape);
        let seen = |sample: &'_ Sample| {
            let corners = topology.faces[sample.face as usize].map(|v| v as usize);
            let point =
                point_at(corners.map(|v| &shape[v]), sample.barycentric) + sample.lift.offset;
            let pixel = self.camera.project(&point)?.pixel;
            let (intensity, _) = self.image.mixed(&pixel, &sample.brightness.weights)?;
            let normal = corners.iter().zip(sample.barycentric).map(|(&v, b)| normals[v] * b);
            let normal = sample.lift.turn * normal.sum::<Vector3>().try_normalize(0.0)?;
            Some(SeenSample { intensity, shade: self.light.shade(&point, &normal).value })
        };
        self.samples.par_iter().filter_map(|sample| Some((sample, seen(sample)?))).collect()
    }
}

impl<C: Camera, L: Light> EnergyTerm<1> for Photometric<'_, C, L> {
    fn count(&self) -> usize {
        self.samples.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.rings.0[self.samples[i].face as usize].stencil
    }

    fn globals(&self, i: usize) -> &[usize] {
        self.samples[i].gain.globals()
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        g: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        let sample = &self.samples[i];
        let ring = &self.rings.0[sample.face as usize];
        let b = &sample.barycentric;
        let point = point_at([&v[0], &v[1], &v[2]], *b) + sample.lift.offset;
        let projection = self.camera.project(&point).ok_or(Infeasible)?;
        let Brightness { weights, albedo, added_shade, white, sigma } = sample.brightness;
        let (intensity, gradient) =
            self.image.mixed(&projection.pixel, &weights).ok_or(Infeasible)?;
        let sums = ring.corner_sums(v);
        let (normal, _) = interpolate(&sums, b);
        let shade = self.light.shade(&point, &(sample.lift.turn * normal));
        let brightness = sample.gain.log(g).exp() * albedo;
        let predicted = brightness * (shade.value + added_shade);
        if let Some(j) = jacobian {
            let slope = -brightness / sigma;
            let d_normal = sample.lift.turn.tr_mul(&shade.d_normal) * slope;
            ring.pull_back(v, &sums, b, &d_normal, |k, d| {
                j.vertices[k] += d.transpose();
            });
            let d_point = gradient.transpose() * projection.jacobian / sigma
                + shade.d_point.transpose() * slope;
            for (to, weight) in j.vertices.iter_mut().zip(b) {
                *to += d_point * *weight;
            }
            j.globals[0][0] = -predicted / sigma;
            j.globals[1][0] = -white / sigma;
            for (to, share) in j.globals[2..].iter_mut().zip(sample.gain.shares.iter().flatten()) {
                to[0] = -predicted * share / sigma;
            }
        }
        Ok(SVector::from([(intensity - predicted - g[1] * white) / sigma]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::energy::check::{assert_jacobian, bent_patch};
    use crate::light::{LightModel, PointLight, Spot};
    use nalgebra::Rotation3;

    #[test]
    fn a_gain_by_hand() {
        let globals = [0.1, 9.0, 0.3, -0.2, 0.1, 0.05];
        let smooth = Gain::smooth([4, 2, 5, 3], [0.8, 0.5, 0.3, 0.1]);
        // 0.1 + 0.8 · 0.1 + 0.5 · 0.3 + 0.3 · 0.05 − 0.1 · 0.2.
        for (gain, log) in [(Gain::GLOBAL, 0.1), (smooth, 0.325)] {
            let own: Vec<f64> = gain.globals().iter().map(|&k| globals[k]).collect();
            assert!((gain.log_of(&globals) - log).abs() < 1e-15);
            assert!((gain.log(&own) - log).abs() < 1e-15);
        }
    }

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let camera = CameraModel::pinhole([64, 48], [100.0, 110.0], [31.2, 23.3]);
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
                added_shade: 0.02,
                white: 0.9,
                sigma: 0.05,
            },
            lift: Lift {
                offset: Vector3::new(0.02, -0.03, 0.1),
                turn: Rotation3::new(Vector3::new(0.1, -0.2, 0.05)).into_inner(),
            },
            gain: Gain::smooth([4, 2, 5, 3], [0.8, 0.5, 0.3, 0.1]),
        });
        let near = LightModel::Point(PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Linear { inner_deg: 2.0, outer_deg: 50.0 },
        });
        let rings = FaceRings::of(&mesh.topology);
        for light in [LightModel::Collinear, near] {
            let term = Photometric::new(&camera, &light, &image, &rings, samples.to_vec());
            assert_jacobian(&term, &mesh.positions, &[0.1, 0.02, 0.3, -0.2, 0.1, 0.05]);
            let bright = samples.map(|s| {
                let brightness = Brightness { weights: [0.5, 0.6, 0.2], ..s.brightness };
                Sample { brightness, gain: Gain::GLOBAL, ..s }
            });
            let term = Photometric::new(&camera, &light, &image, &rings, bright.to_vec());
            let (topology, shape) = (&mesh.topology, &mesh.positions);
            let gain = term.log_gain(topology, shape, 0.02);
            let left = |gain: f64| term.mean_residual(topology, shape, &[gain, 0.02]);
            assert!(left(gain) < left(gain + 0.5));
        }
    }
}
