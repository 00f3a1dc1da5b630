//! A uterus-like patch: a gently curved, irregularly meshed open surface with vessels.

use super::random::{Random, normal, uniform};
use crate::geometry::{Point3, Vector3};
use crate::mesh::Mesh;
use crate::template::SurfaceTexels;

/// A synthetic organ: rest shape in the template frame and its albedo.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Rest shape, mm, outward normals along −z.
    pub mesh: Mesh,
    /// Albedo, linear.
    pub albedo: SurfaceTexels,
}

/// A bulging patch of 50 × 40 mm with about `vertices` vertices, centred at the origin, its crown
/// towards −z, with a tissue-like albedo of vessels on a smooth ground.
pub fn patch(vertices: usize, seed: u64) -> Patch {
    let mut random = Random::new(seed, 0x70A7);
    let columns = ((vertices as f64 * 1.25).sqrt().round() as usize).max(4);
    let rows = (vertices / columns).max(4);
    let mesh = grid(columns, rows, &mut random);
    let albedo = vessels(&mesh, &mut random);
    Patch { mesh, albedo }
}

/// A surface about the origin that faces −z, mm, with a tissue-like albedo.
pub fn textured(mesh: Mesh, seed: u64) -> Patch {
    let albedo = vessels(&mesh, &mut Random::new(seed, 0x7E87));
    Patch { mesh, albedo }
}

fn grid(columns: usize, rows: usize, random: &mut Random) -> Mesh {
    let mut positions = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let rim = row == 0 || column == 0 || row + 1 == rows || column + 1 == columns;
            let jitter = if rim { 0.0 } else { 0.25 };
            let at = |i: usize, n: usize, size: f64, random: &mut Random| {
                let step = (i as f64 + jitter * (2.0 * uniform(random) - 1.0)) / (n - 1) as f64;
                size * (step - 0.5)
            };
            let (x, y) = (at(column, columns, 50.0, random), at(row, rows, 40.0, random));
            let z = 0.010 * x * x + 0.014 * y * y + 0.5 * (0.25 * x).sin() * (0.2 * y).cos();
            positions.push(Point3::new(x, y, z));
        }
    }
    let mut faces = Vec::new();
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            let a = (row * columns + column) as u32;
            let (b, c, d) = (a + 1, a + columns as u32, a + columns as u32 + 1);
            if (row + column) % 2 == 0 {
                faces.extend([[a, c, b], [b, c, d]]);
            } else {
                faces.extend([[a, c, d], [a, d, b]]);
            }
        }
    }
    Mesh::new(positions, faces).expect("a grid is manifold")
}

/// Texels of about 0.3 mm with dark, winding vessels over a smoothly varying ground.
fn vessels(mesh: &Mesh, random: &mut Random) -> SurfaceTexels {
    let paths: Vec<[Vector3; 3]> = (0..14)
        .map(|_| {
            let mut at = |s: f64| Vector3::new(s * normal(random), s * normal(random), 0.0);
            [at(15.0), at(1.0).normalize(), at(0.08)]
        })
        .collect();
    let edge = |f: usize| {
        let [a, b, c] = mesh.corners(f);
        (b - a).norm().max((c - b).norm()).max((a - c).norm())
    };
    let resolution =
        (0..mesh.topology.faces.len()).map(|f| (edge(f) / 0.3).ceil().clamp(1.0, 32.0) as u16);
    let mut texels = SurfaceTexels::new(resolution.collect());
    for face in 0..mesh.topology.faces.len() {
        for (k, b) in texels.centres(face).enumerate() {
            let p = crate::geometry::point_at(mesh.corners(face), b);
            let ground = 0.55 + 0.08 * (0.11 * p.x + 0.5).sin() * (0.13 * p.y).cos();
            let dark: f64 = paths.iter().map(|path| vessel(path, &p)).fold(0.0, f64::max);
            let value = ground * (1.0 - 0.45 * dark);
            let i = texels.offset[face] as usize + k;
            texels.value[i] = [value as f32, 0.7 * value as f32, 0.6 * value as f32];
            (texels.spread[i], texels.views[i]) = (0.0, 1);
        }
    }
    texels
}

/// Darkness of one winding vessel of half a millimetre: start, direction, bend.
fn vessel([start, along, bend]: &[Vector3; 3], p: &Point3) -> f64 {
    let offset = Vector3::new(p.x, p.y, 0.0) - start;
    let t = offset.dot(along);
    let across = offset.dot(&Vector3::new(-along.y, along.x, 0.0));
    let winding = 2.0 * (bend.x * 3.0 * t + bend.y * 20.0).sin();
    (-((across - winding) / 0.5).powi(2)).exp()
}
