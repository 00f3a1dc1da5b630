//! What tells how far off a vertex may be. Lengths are relative to the visible radius `R`.

use super::solved::Solved;
use crate::camera::Camera;
use crate::energy::Brightness;
use crate::geometry::{Point3, Vector3, align_rigid_robust, median};
use crate::light::Light;
use crate::mesh::boundary::boundary_loops;
use crate::mesh::normals::vertex_normals;
use crate::mesh::paths::shortest_paths;
use crate::mesh::{Mesh, Topology};
use crate::refine::{Photograph, evidence::gather_pointwise};
use nalgebra::Matrix3;

/// Number of features.
pub const COUNT: usize = 17;

/// Names of the features, in order.
pub const NAMES: [&str; COUNT] = [
    "constant",
    "pose",
    "leverage",
    "match distance",
    "shading distance",
    "hidden",
    "sight distance",
    "displacement",
    "frame displacement",
    "strain",
    "residual",
    "residual sign",
    "frame residual",
    "grazing",
    "frontal",
    "rim",
    "bland",
];

/// Evidence further away than this along the surface, in visible radii, says nothing of a vertex.
pub const REACH: f64 = 0.25;

/// Where the logarithm of a length (in visible radii) takes over from the length itself.
const NEAR: f64 = 0.1;
/// The same for displacements, strains and log brightness ratios.
const SMALL: f64 = 0.02;
/// The same for the reprojection error as it bears on the pose.
const TINY: f64 = 0.001;
/// Distance in visible radii of what has no path to any evidence.
const FAR: f64 = 10.0;
/// Radius over which residuals and strains are averaged, in visible radii.
const BLUR: f64 = 0.12;
/// Reprojection errors below this are chance, px.
const LEAST_PX: f64 = 0.3;

/// Features of all vertices.
#[derive(Clone, Debug)]
pub struct ErrorFeatures {
    /// One row a vertex, columns as [`NAMES`]; all finite and, but for rounding, at least 0.
    pub values: Vec<[f64; COUNT]>,
    /// As [`super::ExpectedErrors::observed`].
    pub observed: Vec<bool>,
    /// The visible radius `R`, length units.
    pub radius: f64,
}

/// Look at a reconstructed frame.
pub fn features(solved: &Solved) -> ErrorFeatures {
    let scene = solved.scene;
    let (mesh, radius) = (scene.rest, scene.radius().max(f64::MIN_POSITIVE));
    let topology = &*mesh.topology;
    let ways = Ways::new(mesh, radius);
    let kept = || solved.matches.iter().filter(|m| m.1);
    let matched: Vec<u32> = kept().flat_map(|(m, _)| scene.face(m)).collect();
    let seen: Vec<u32> =
        (0..topology.vertex_count as u32).filter(|&v| solved.visible[v as usize]).collect();
    let brightness = solved.photo.map(|photo| Shading::new(photo, solved, &ways));
    let shaded = brightness.as_ref().map_or(&[][..], |b| &b.vertices);
    let [to_match, to_shading, to_sight, to_rim] =
        [&matched[..], shaded, &seen, &boundary_loops(topology).concat()]
            .map(|sources| ways.distances(sources));
    let (noise, leverage) = pose(solved, radius);
    let moved: Vec<f64> = displacement(solved).iter().map(|d| d / radius).collect();
    let frame_moved = mean(seen.iter().map(|&v| moved[v as usize]));
    let strain = ways.smooth(&strain(mesh, solved.vertices));
    let normals = vertex_normals(topology, solved.vertices);
    let row = |v: usize| {
        let cosine = -normals[v].dot(&solved.vertices[v].coords.normalize());
        let cosine = if cosine.is_finite() { cosine.clamp(0.0, 1.0) } else { 0.0 };
        let residual = brightness.as_ref().map_or([0.0; 4], |b| b.at(v));
        [
            1.0,
            growth(noise, TINY),
            0.5 * leverage[v].ln_1p(),
            growth(to_match[v], NEAR),
            solved.photo.map_or(0.0, |_| growth(to_shading[v], NEAR)),
            f64::from(!solved.visible[v]),
            growth(to_sight[v], NEAR),
            growth(moved[v], SMALL),
            growth(frame_moved, SMALL),
            growth(strain[v], SMALL),
            growth(residual[0], SMALL),
            growth(residual[1], SMALL),
            growth(residual[2], SMALL),
            1.0 - cosine,
            cosine,
            1.0 / (1.0 + to_rim[v] / NEAR),
            residual[3],
        ]
        .map(|f| if f.is_finite() { f } else { growth(FAR, SMALL) })
    };
    let observed = |v: usize| solved.visible[v] && to_match[v].min(to_shading[v]) <= REACH;
    let all = 0..topology.vertex_count;
    ErrorFeatures {
        values: all.clone().map(row).collect(),
        observed: all.map(observed).collect(),
        radius,
    }
}

/// `ln(1 + x / scale)`: proportional to small values, a power law in the end.
fn growth(x: f64, scale: f64) -> f64 {
    (x / scale).ln_1p()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(s, n), v| (s + v, n + 1));
    sum / f64::from(count.max(1))
}

/// The surface as a graph.
struct Ways<'a> {
    topology: &'a Topology,
    /// Edge lengths in visible radii.
    lengths: Vec<f64>,
    /// Rounds of averaging over one-rings that spread a value over [`BLUR`].
    rounds: usize,
}

impl<'a> Ways<'a> {
    fn new(mesh: &'a Mesh, radius: f64) -> Self {
        let lengths: Vec<f64> = mesh.edge_lengths().iter().map(|l| l / radius).collect();
        let edge = mean(lengths.iter().copied()).max(1e-6);
        let rounds = ((BLUR / edge).powi(2).round() as usize).clamp(1, 40);
        Self { topology: &mesh.topology, lengths, rounds }
    }

    /// Distance of every vertex from the nearest source, at most [`FAR`].
    fn distances(&self, sources: &[u32]) -> Vec<f64> {
        let found = shortest_paths(self.topology, &self.lengths, sources).distance;
        found.into_iter().map(|d| d.min(FAR)).collect()
    }

    fn smooth(&self, values: &[f64]) -> Vec<f64> {
        let mut values = values.to_vec();
        for _ in 0..self.rounds {
            let ring = |v: usize| {
                let ring = &self.topology.one_ring[v];
                let sum: f64 = ring.iter().map(|&w| values[w as usize]).sum();
                0.5 * (values[v] + sum / ring.len().max(1) as f64)
            };
            values = (0..values.len()).map(ring).collect();
        }
        values
    }
}

/// What the matches leave of the pose: their noise over the root of their number, in visible radii,
/// and for every vertex the leverage `(x − c)ᵀ C⁻¹ (x − c)` of its place on them.
fn pose(solved: &Solved, radius: f64) -> (f64, Vec<f64>) {
    let scene = solved.scene;
    let kept = solved.matches.iter().filter(|m| m.1).map(|m| &m.0);
    let points: Vec<Point3> = kept.map(|m| scene.point(m, &scene.posed)).collect();
    let n = points.len().max(1) as f64;
    let centre = points.iter().map(|p| p.coords).sum::<Vector3>() / n;
    let spread = points.iter().map(|p| (p.coords - centre) * (p.coords - centre).transpose());
    let least = Matrix3::identity() * (NEAR * radius).powi(2);
    let inverse = (spread.sum::<Matrix3<f64>>() / n + least).try_inverse().unwrap_or_default();
    let leverage = |x: &Point3| {
        let d = x.coords - centre;
        d.dot(&(inverse * d))
    };
    let noise = noise(solved) / (radius * n.sqrt());
    (noise, scene.posed.iter().map(leverage).collect())
}

/// Median reprojection error of the kept matches at their depth, length units.
fn noise(solved: &Solved) -> f64 {
    let (camera, scene) = (solved.scene.camera, solved.scene);
    let error = |(m, _): &(crate::register::Match, bool)| {
        let p = scene.point(m, solved.vertices);
        let away = (camera.project(&p)?.pixel - m.pixel).norm();
        Some(away.max(LEAST_PX) * p.z / camera.focal[0])
    };
    let mut errors: Vec<f64> = solved.matches.iter().filter(|m| m.1).filter_map(error).collect();
    median(&mut errors).unwrap_or(scene.radius())
}

/// How far every vertex moved from the rigid pose that explains most of what is seen.
fn displacement(solved: &Solved) -> Vec<f64> {
    let (posed, now) = (&solved.scene.posed, solved.vertices);
    let seen = |x: &[Point3]| -> Vec<Point3> {
        x.iter().zip(solved.visible).filter(|(_, seen)| **seen).map(|(p, _)| *p).collect()
    };
    let rest = match align_rigid_robust(&seen(posed), &seen(now)) {
        Some(motion) => posed.iter().map(|p| motion * p).collect(),
        None => posed.clone(),
    };
    rest.iter().zip(now).map(|(a, b)| (a - b).norm()).collect()
}

/// Mean relative change of the edges at every vertex.
fn strain(mesh: &Mesh, shape: &[Point3]) -> Vec<f64> {
    let (mut sum, mut count) = (vec![0.0; shape.len()], vec![0.0; shape.len()]);
    for (&[a, b], rest) in mesh.topology.edges.iter().zip(mesh.edge_lengths()) {
        let now = (shape[a as usize] - shape[b as usize]).norm();
        let change = (now / rest.max(f64::MIN_POSITIVE) - 1.0).abs();
        for v in [a, b] {
            sum[v as usize] += change;
            count[v as usize] += 1.0;
        }
    }
    sum.iter().zip(count).map(|(s, n)| s / f64::max(n, 1.0)).collect()
}

/// How well the shape explains the image around every vertex.
struct Shading {
    /// Vertices whose brightness can be used.
    vertices: Vec<u32>,
    /// Local mean of the log ratio of image to prediction, without sign and with it.
    local: [Vec<f64>; 2],
    /// Mean without sign over all of them.
    frame: f64,
    /// `1 / (1 + c / 0.05)` of the local contrast `c` of the albedo: 1 where nothing holds the
    /// surface along itself.
    bland: Vec<f64>,
}

impl Shading {
    fn new(photo: &Photograph, solved: &Solved, ways: &Ways) -> Self {
        let (rest, shape) = (solved.scene.rest, solved.vertices);
        let found = gather_pointwise(photo, rest, shape, solved.refine);
        let normals = vertex_normals(&rest.topology, shape);
        let mut ratios = vec![0.0; shape.len()];
        let mut albedo = vec![0.0; shape.len()];
        let mut vertices = Vec::new();
        for used in &found.diffuse {
            let v = used.vertex as usize;
            let pixel = photo.camera.project(&shape[v]).map(|p| p.pixel);
            let Brightness { weights, albedo: alpha, .. } = used.brightness;
            let image = pixel.and_then(|p| found.image.mixed(&p, &weights)).map_or(0.0, |s| s.0);
            let predicted = alpha * photo.light.shade(&shape[v], &normals[v]).value;
            if image > 1e-4 && predicted > 1e-4 {
                ratios[v] = ((image / predicted).ln() - found.log_gain).clamp(-1.0, 1.0);
                albedo[v] = alpha.ln();
                vertices.push(used.vertex);
            }
        }
        let frame = mean(vertices.iter().map(|&v| ratios[v as usize].abs()));
        let local = [f64::abs, |r: f64| r].map(|of| Self::around(&ratios, &vertices, ways, of));
        let [mean, square] =
            [|a: f64| a, |a| a * a].map(|of| Self::around(&albedo, &vertices, ways, of));
        let contrast = mean.iter().zip(square).map(|(m, s)| (s - m * m).max(0.0).sqrt());
        let bland = contrast.map(|c| 1.0 / (1.0 + c / 0.05)).collect();
        Self { vertices, local, frame, bland }
    }

    /// Local mean over the vertices that have a ratio; where none is near, nothing is known and
    /// the distance to shading speaks instead.
    fn around(ratios: &[f64], used: &[u32], ways: &Ways, of: impl Fn(f64) -> f64) -> Vec<f64> {
        let (mut sum, mut count) = (vec![0.0; ratios.len()], vec![0.0; ratios.len()]);
        for &v in used {
            sum[v as usize] = of(ratios[v as usize]);
            count[v as usize] = 1.0;
        }
        let (sum, count) = (ways.smooth(&sum), ways.smooth(&count));
        sum.iter().zip(count).map(|(s, n)| if n > 1e-3 { s / n } else { 0.0 }).collect()
    }

    /// Local residual, size of the local signed one, residual of the frame, blandness.
    fn at(&self, v: usize) -> [f64; 4] {
        [self.local[0][v], self.local[1][v].abs(), self.frame, self.bland[v]]
    }
}
