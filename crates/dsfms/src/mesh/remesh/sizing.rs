//! Edge lengths that follow the curvature of the surface.
//!
//! A chord of length `l` misses an arc of curvature `k` by `e = k l²/8`: edges of `√(8 e / k)` all
//! miss it by the same `e`. Their field is held within a range about the mean and graded, so that
//! faces side by side differ little (Dunyach, Vanderhaeghe, Barthe and Botsch 2013).

use crate::geometry::{Point3, Vector3, area_normal};
use crate::mesh::normals::lumped_areas;
use crate::mesh::surface_points::ClosestPoints;
use crate::mesh::{Mesh, Topology};
use nalgebra::Matrix3;
use rayon::prelude::*;

/// Shortest and longest edges over the mean.
const RANGE: [f64; 2] = [0.5, 2.0];
/// Growth of the edge length a unit of length.
const GRADATION: f64 = 0.3;
/// A surface that turns by less than this within one edge, radians, is flat.
const FLAT: f64 = 0.01;
/// Halvings of the search for the curvature of mean size.
const HALVINGS: usize = 60;

/// Edge lengths wanted, over the mean, at the vertices of the surface that is remeshed.
pub(super) struct Sizing {
    pub size: Vec<f64>,
}

impl Sizing {
    /// For edges of mean `length`, length units. As many vertices are wanted as when all are of
    /// that length: the mean of `size⁻²` over the surface is 1. `strength` is
    /// [`RemeshOptions::adaptive`](super::RemeshOptions::adaptive).
    pub(super) fn new(mesh: &Mesh, length: f64, strength: f64) -> Self {
        let area = lumped_areas(mesh);
        let curvature: Vec<f64> =
            curvatures(mesh, &area, length.max(1.5 * mesh.mean_edge_length()))
                .into_iter()
                .map(|k| k.max(FLAT / length))
                .collect();
        let sizes = |mean: f64| -> Vec<f64> {
            let size = |k: &f64| (mean / k).powf(0.5 * strength).clamp(RANGE[0], RANGE[1]);
            curvature.iter().map(size).collect()
        };
        // Sizes grow with the curvature that is given the mean size; found on a logarithmic scale.
        let [mut low, mut high] = curvature
            .iter()
            .fold([f64::INFINITY, 0.0f64], |[low, high], &k| [low.min(k), high.max(k)])
            .map(f64::ln);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let dense = density(&sizes(middle.exp()), &area) > 1.0;
            *(if dense { &mut low } else { &mut high }) = middle;
        }
        let mut size = sizes((0.5 * (low + high)).exp());
        grade(mesh, &mut size, GRADATION / length);
        let correction = density(&size, &area).sqrt();
        size.iter_mut().for_each(|s| *s *= correction);
        Self { size }
    }

    /// Size wanted at the place of `surface` closest to a point.
    pub(super) fn at(&self, surface: &ClosestPoints, faces: &[[u32; 3]], point: &Point3) -> f64 {
        let Some(found) = surface.closest(point) else { return 1.0 };
        let corners = faces[found.face as usize].map(|v| self.size[v as usize]);
        corners.iter().zip(found.barycentric).map(|(s, w)| s * w).sum()
    }
}

/// Vertices wanted over those of edges of mean length alone.
fn density(size: &[f64], area: &[f64]) -> f64 {
    let wanted: f64 = size.iter().zip(area).map(|(s, a)| a / (s * s)).sum();
    wanted / area.iter().sum::<f64>()
}

/// Sizes lowered until none grows by more than `slope` a unit of length along an edge.
fn grade(mesh: &Mesh, size: &mut [f64], slope: f64) {
    let lengths = mesh.edge_lengths();
    loop {
        let mut lowered = false;
        for (&[a, b], length) in mesh.topology.edges.iter().zip(&lengths) {
            let (a, b) = (a as usize, b as usize);
            for (from, to) in [(a, b), (b, a)] {
                let most = size[from] + slope * length;
                if size[to] > most {
                    (size[to], lowered) = (most, true);
                }
            }
        }
        if !lowered {
            return;
        }
    }
}

/// The larger principal curvature at every vertex, without its sign, 1 / length units: that of the
/// normal cycle averaged over the surface within `radius` (Cohen-Steiner and Morvan 2003),
/// `1/|B| Σ β |e| ē ēᵀ` over its edges, `β` the angle between the faces of an edge.
fn curvatures(mesh: &Mesh, area: &[f64], radius: f64) -> Vec<f64> {
    let mut own = vec![Matrix3::zeros(); mesh.positions.len()];
    for (&ends, &faces) in mesh.topology.edges.iter().zip(&mesh.topology.edge_faces) {
        let [a, b] = ends;
        let along = mesh.positions[b as usize] - mesh.positions[a as usize];
        let Some(direction) = along.try_normalize(0.0) else { continue };
        let half = 0.5 * along.norm() * bend(mesh, ends, faces, &direction);
        let tensor = half * direction * direction.transpose();
        own[a as usize] += tensor;
        own[b as usize] += tensor;
    }
    let n = mesh.positions.len();
    (0..n as u32)
        .into_par_iter()
        .map_init(
            || vec![u32::MAX; n],
            |marks, v| {
                let ball = ball(&mesh.topology, &mesh.positions, v, radius, marks);
                let (tensor, covered) = ball.iter().fold((Matrix3::zeros(), 0.0), |(t, a), &u| {
                    (t + own[u as usize], a + area[u as usize])
                });
                if covered > 0.0 { tensor.symmetric_eigenvalues().amax() / covered } else { 0.0 }
            },
        )
        .collect()
}

/// Angle by which the surface turns at an edge from a to b, radians, positive to one side and
/// negative to the other; 0 on the boundary.
fn bend(mesh: &Mesh, [a, b]: [u32; 2], [f, g]: [u32; 2], direction: &Vector3) -> f64 {
    if g == u32::MAX {
        return 0.0;
    }
    let face = mesh.topology.faces[f as usize];
    let left = (0..3).any(|k| face[k] == a && face[(k + 1) % 3] == b);
    let [left, right] = if left { [f, g] } else { [g, f] }.map(|f| {
        let [a, b, c] = mesh.corners(f as usize);
        area_normal(a, b, c)
    });
    left.cross(&right).dot(direction).atan2(left.dot(&right))
}

/// Vertices within `radius` of one, connected to it within.
fn ball(t: &Topology, points: &[Point3], v: u32, radius: f64, marks: &mut [u32]) -> Vec<u32> {
    let mut found = vec![v];
    marks[v as usize] = v;
    let mut next = 0;
    while next < found.len() {
        for &u in &t.one_ring[found[next] as usize] {
            let near = (points[u as usize] - points[v as usize]).norm() <= radius;
            if near && std::mem::replace(&mut marks[u as usize], v) != v {
                found.push(u);
            }
        }
        next += 1;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::remesh::{RemeshOptions, remesh};
    use crate::mesh::shapes;

    /// A flat square of side 2 with a steep bump of width 0.2 amid it, and its height.
    fn bump() -> (Mesh, impl Fn(f64, f64) -> f64) {
        let height = |x: f64, y: f64| 0.3 * (-((x - 1.0).powi(2) + (y - 1.0).powi(2)) / 0.08).exp();
        let mut mesh = shapes::irregular_sheet(80);
        for p in &mut mesh.positions {
            *p = Point3::new(2.0 * p.x, 2.0 * p.y, height(2.0 * p.x, 2.0 * p.y));
        }
        (mesh, height)
    }

    #[test]
    fn curvature_of_a_ball_a_tube_and_a_plane() {
        let at = |mesh: &Mesh, radius: f64| curvatures(mesh, &lumped_areas(mesh), radius);
        for k in at(&shapes::icosphere(3, 5.0), 2.0) {
            assert!((k - 0.2).abs() < 0.02, "ball: {k}");
        }
        // Half of the outermost edges' faces is missing: the middle rows.
        let tube = at(&shapes::tube(40, 41, 4.0), 0.5);
        for k in &tube[15 * 40..25 * 40] {
            assert!((k - 1.0).abs() < 0.05, "tube: {k}");
        }
        assert!(at(&shapes::irregular_sheet(10), 0.3).iter().all(|k| k.abs() < 1e-9));
    }

    #[test]
    fn sizes_want_as_many_vertices_within_range_and_slope() {
        let (mesh, _) = bump();
        let length = 0.1;
        let size = Sizing::new(&mesh, length, 1.0).size;
        assert!((density(&size, &lumped_areas(&mesh)) - 1.0).abs() < 1e-9);
        let least = size.iter().copied().fold(f64::INFINITY, f64::min);
        let most = size.iter().copied().fold(0.0, f64::max);
        // The gradation lowers some; the mean is restored.
        assert!(least > 0.45 && least < 0.8 && most > 1.2 && most < 2.2, "{least} {most}");
        for (&[a, b], l) in mesh.topology.edges.iter().zip(mesh.edge_lengths()) {
            let step = (size[a as usize] - size[b as usize]).abs();
            assert!(step <= 1.2 * GRADATION * l / length, "{step} over {l}");
        }
        // What bends alike everywhere is not divided by rounding errors.
        let even = Sizing::new(&shapes::irregular_sheet(10), length, 1.0).size;
        assert!(even.iter().all(|s| (s - 1.0).abs() < 1e-9));
    }

    #[test]
    fn a_bump_gets_the_vertices_that_the_plane_spares() {
        let (mesh, height) = bump();
        let made = |adaptive| {
            let options = RemeshOptions { adaptive, ..Default::default() };
            let made = remesh(&mesh, 400, &options).unwrap();
            let n = made.positions.len() as f64;
            assert!((n / 400.0 - 1.0).abs() < 0.05, "{n} vertices");
            assert_eq!(made.topology.euler_characteristic(), 1);
            let angle = made.min_angles().into_iter().fold(f64::INFINITY, f64::min).to_degrees();
            assert!(angle > 20.0, "{angle} degrees");
            made
        };
        let miss = |made: &Mesh| {
            let centre = |f| {
                let c = made.corners(f).iter().map(|p| p.coords).sum::<Vector3>() / 3.0;
                (c.z - height(c.x, c.y)).abs()
            };
            (0..made.topology.faces.len()).map(centre).fold(0.0, f64::max)
        };
        let on_bump = |made: &Mesh| {
            let near = |p: &&Point3| (p.x - 1.0).hypot(p.y - 1.0) < 0.4;
            made.positions.iter().filter(near).count()
        };
        let (even, adapted) = (made(0.0), made(1.0));
        assert!(on_bump(&adapted) > 2 * on_bump(&even), "{} {}", on_bump(&adapted), on_bump(&even));
        assert!(miss(&adapted) < 0.6 * miss(&even), "{} {}", miss(&adapted), miss(&even));
    }
}
