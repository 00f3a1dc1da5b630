//! One picture: organ, wall and instruments under the light, through lens, sensor and tone curve.

use super::instrument::Instrument;
use super::tissue::{TissueTexture, noise};
use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point3, Vector3, point_at};
use crate::image::{ColorImage, Frame, Mask};
use crate::light::{Coated, Light, specular_angle};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;
use crate::raster::Raster;
use crate::synth::sensor::develop;
use crate::synth::shadow::Shadows;
use rayon::prelude::*;

/// Peak of a highlight, linear, and the width of its lobe, rad.
const GLOSS: [f64; 2] = [1.1, 0.07];

/// Veil of stray light in the lens, linear.
const VEIL: f64 = 0.006;

/// Organ and wall at rest, with their textures.
#[derive(Clone, Debug)]
pub(super) struct Set {
    /// The organ's faces come first, its vertices too.
    pub organ_faces: usize,
    pub mesh: Mesh,
    pub organ: TissueTexture,
    pub wall: TissueTexture,
}

impl Set {
    /// In camera axes, with the organ's vertices as they are (camera axes).
    pub(super) fn posed(&self, organ: &[Point3], pose: &Isometry) -> Mesh {
        let wall = self.mesh.positions[organ.len()..].iter().map(|p| pose * p);
        self.mesh.with_positions(organ.iter().copied().chain(wall).collect())
    }
}

/// Of one picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Conditions {
    pub gain: f64,
    pub covered: bool,
    pub seed: u64,
}

/// The picture of a pinhole camera, and where an instrument is seen in it. The organ throws
/// shadows, the wall only catches them.
pub(super) fn photograph(
    name: String,
    (camera, light): (&CameraModel, &Coated),
    (set, scene, raster): (&Set, &Mesh, &Raster),
    organ: &Mesh,
    instruments: &[Instrument],
    conditions: &Conditions,
) -> (Frame, Mask) {
    let size = camera.size;
    if conditions.covered {
        let linear = covered(size, conditions);
        return (develop(name, &linear, conditions.seed), Mask::filled(size, false));
    }
    let stage = Stage {
        light,
        sources: light.light.sources(),
        set,
        scene,
        raster,
        instruments,
        normals: vertex_normals(&scene.topology, &scene.positions),
        shadows: Shadows::cast(&light.light, organ),
    };
    let pixel = |i: usize| {
        let at = [i % size[0], i / size[0]];
        let slope = |c: usize| (at[c] as f64 - camera.centre[c]) / camera.focal[c];
        stage.look(at[0], at[1], &Vector3::new(slope(0), slope(1), 1.0).normalize())
    };
    let seen: Vec<([f64; 3], bool)> = (0..size[0] * size[1]).into_par_iter().map(pixel).collect();
    let expose = |p: &([f64; 3], bool)| p.0.map(|v| (conditions.gain * v + VEIL) as f32);
    let linear = ColorImage { size, data: seen.iter().map(expose).collect() };
    let mask = Mask { size, data: seen.iter().map(|p| p.1).collect() };
    (develop(name, &linear, conditions.seed), mask)
}

/// What the sightlines meet.
struct Stage<'a> {
    light: &'a Coated,
    sources: Vec<Point3>,
    set: &'a Set,
    scene: &'a Mesh,
    raster: &'a Raster,
    instruments: &'a [Instrument],
    normals: Vec<Vector3>,
    shadows: Shadows,
}

impl Stage<'_> {
    /// Brightness before exposure, and whether an instrument is seen.
    fn look(&self, x: usize, y: usize, ray: &Vector3) -> ([f64; 3], bool) {
        let depth = self.raster.depth[y * self.raster.size[0] + x];
        let limit = depth / ray.z;
        let origin = Point3::origin();
        let metal = self
            .instruments
            .iter()
            .filter_map(|i| i.hit(&origin, ray, limit))
            .min_by(|a, b| a.point.z.total_cmp(&b.point.z));
        if let Some(hit) = metal {
            return (hit.brightness(&self.light.light), true);
        }
        match self.raster.surface(x, y) {
            Some((face, b)) => (self.tissue(face as usize, b), false),
            None => ([0.0; 3], false),
        }
    }

    fn tissue(&self, face: usize, b: [f64; 3]) -> [f64; 3] {
        let corners = self.scene.topology.faces[face].map(|v| v as usize);
        let point = point_at(corners.map(|v| &self.scene.positions[v]), b);
        let rest = point_at(corners.map(|v| &self.set.mesh.positions[v]), b);
        let sum: Vector3 = corners.iter().zip(b).map(|(&v, w)| self.normals[v] * w).sum();
        let normal = sum.normalize();
        let texture = if face < self.set.organ_faces { &self.set.organ } else { &self.set.wall };
        let (albedo, bump) = texture.at(rest.x, rest.y);
        let lit = self.lit(&point);
        let shade = lit * self.light.shade(&point, &normal).value;
        let angle = specular_angle(&self.light.light, &point, &normal) + bump;
        let width = angle / GLOSS[1];
        let glint = if width.abs() < 6.0 { (-0.5 * width * width).exp() } else { 0.0 };
        let glint = lit * GLOSS[0] * glint;
        albedo.map(|a| a * shade + glint)
    }

    /// Share of the light that reaches a point.
    fn lit(&self, point: &Point3) -> f64 {
        if self.sources.is_empty() {
            return self.shadows.lit(point);
        }
        let free = |source: &&Point3| self.instruments.iter().all(|i| !i.between(point, source));
        let share = self.sources.iter().filter(free).count() as f64 / self.sources.len() as f64;
        if share > 0.0 { share * self.shadows.lit(point) } else { 0.0 }
    }
}

/// The lens against tissue: dark red without any structure that could be the organ's.
fn covered(size: [usize; 2], conditions: &Conditions) -> ColorImage {
    let pixel = |i: usize| {
        let (x, y) = ((i % size[0]) as f64, (i / size[0]) as f64);
        let scale = 0.3 * size[0] as f64;
        let value = 0.5 + 0.4 * noise(x / scale, y / scale, conditions.seed);
        [0.30, 0.03, 0.02].map(|c: f64| (c * value) as f32)
    };
    ColorImage { size, data: (0..size[0] * size[1]).map(pixel).collect() }
}
