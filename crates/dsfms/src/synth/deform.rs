//! Deformation by attraction points (paper §8.1): pushes and pulls of a surgeon's tool.

use crate::geometry::{Point3, Vector3};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;
use serde::{Deserialize, Serialize};

/// A pair `(F, g)`: the main direction of deformation and the point that attracts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attraction {
    /// Unit vector `F`.
    pub direction: Vector3,
    /// The point `g`.
    pub point: Point3,
    /// Angle from `F` at which the effect ends, radians, below π/2.
    pub angle: f64,
}

/// A deformed shape and what is known of it.
#[derive(Clone, Debug)]
pub struct Deformation {
    /// Vertices in the frame of the rest shape.
    pub vertices: Vec<Point3>,
    /// `true` in the affected zone: displaced by more than a tenth of the largest displacement.
    pub zone: Vec<bool>,
    /// Mean relative edge-length change within the zone.
    pub extension: f64,
    /// Largest relative edge-length change within the zone.
    pub largest_extension: f64,
}

/// What an extension states about the edges of the zone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExtensionOf {
    /// The mean relative length change.
    Mean,
    /// The largest relative length change.
    Largest,
}

/// Fraction of the largest displacement from which a vertex belongs to the zone.
const ZONE: f64 = 0.1;

/// `v′ = v + Σⱼ k(∠(Fⱼ, gⱼ − v)) (gⱼ − v) + ε N` with `k(θ) = κ (1 − θ²/θ₀²)²` inside θ₀ and 0
/// outside, where κ is found so that the mean absolute edge-length change in the zone is
/// `extension` (0.1 for the paper's 10 %), and `ε` is `lift` times the local displacement.
pub fn deform(mesh: &Mesh, attractions: &[Attraction], extension: f64, lift: f64) -> Deformation {
    deform_to(mesh, attractions, extension, ExtensionOf::Mean, lift)
}

/// [`deform`] with a choice of what the extension states.
pub fn deform_to(
    mesh: &Mesh,
    attractions: &[Attraction],
    extension: f64,
    of: ExtensionOf,
    lift: f64,
) -> Deformation {
    let field = attraction_field(mesh, attractions, lift);
    let largest = field.iter().map(|d| d.norm()).fold(0.0, f64::max);
    let zone: Vec<bool> =
        field.iter().map(|d| largest > 0.0 && d.norm() > ZONE * largest).collect();
    let at = |k: f64| -> Vec<Point3> {
        mesh.positions.iter().zip(&field).map(|(v, d)| v + d * k).collect()
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let [mean, largest] = zone_extension(mesh, &at(middle), &zone);
        let reached = if of == ExtensionOf::Mean { mean } else { largest };
        if reached < extension {
            low = middle;
        } else {
            high = middle;
        }
    }
    let vertices = at(if extension > 0.0 { high } else { 0.0 });
    let [extension, largest_extension] = zone_extension(mesh, &vertices, &zone);
    Deformation { vertices, zone, extension, largest_extension }
}

/// `Σⱼ (1 − θ²/θ₀²)² (gⱼ − v) + lift ‖·‖ N` at every vertex: the displacement of [`deform`] for κ =
/// 1.
pub(crate) fn attraction_field(mesh: &Mesh, attractions: &[Attraction], lift: f64) -> Vec<Vector3> {
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    mesh.positions.iter().zip(&normals).map(|(v, n)| pull(v, n, attractions, lift)).collect()
}

fn pull(v: &Point3, normal: &Vector3, attractions: &[Attraction], lift: f64) -> Vector3 {
    let towards: Vector3 = attractions
        .iter()
        .map(|a| {
            let offset = a.point - v;
            let angle = a.direction.angle(&offset);
            offset * (1.0 - (angle / a.angle).min(1.0).powi(2)).powi(2)
        })
        .sum();
    towards + normal * (lift * towards.norm())
}

/// Mean and largest `|‖e′‖/‖e‖ − 1|` over the edges with both ends in the zone.
fn zone_extension(mesh: &Mesh, shape: &[Point3], zone: &[bool]) -> [f64; 2] {
    let changes: Vec<f64> = mesh
        .topology
        .edges
        .iter()
        .filter(|[a, b]| zone[*a as usize] && zone[*b as usize])
        .map(|&[a, b]| {
            let length = |x: &[Point3]| (x[a as usize] - x[b as usize]).norm();
            (length(shape) / length(&mesh.positions) - 1.0).abs()
        })
        .collect();
    let mean = changes.iter().sum::<f64>() / changes.len().max(1) as f64;
    [mean, changes.into_iter().fold(0.0, f64::max)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::patch;

    #[test]
    fn reaches_the_extension_it_is_asked_for() {
        let mesh = patch(334, 1).mesh;
        let pull = Attraction {
            direction: -Vector3::z(),
            point: Point3::new(3.0, 2.0, -15.0),
            angle: 0.6,
        };
        for extension in [0.0, 0.05, 0.2] {
            let deformed = deform(&mesh, &[pull], extension, 0.0);
            assert!((deformed.extension - extension).abs() < 1e-6, "{}", deformed.extension);
            let affected = deformed.zone.iter().filter(|z| **z).count();
            let largest = deform_to(&mesh, &[pull], extension, ExtensionOf::Largest, 0.0);
            assert!((largest.largest_extension - extension).abs() < 1e-6);
            assert!(largest.extension <= deformed.extension + 1e-6);
            assert!((10..200).contains(&affected), "{affected}");
        }
    }
}
