//! Deformation by attraction points (paper §8.1): pushes and pulls of a surgeon's tool.

use crate::geometry::{Point3, Vector3};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;

/// A pair `(F, g)`: the main direction of deformation and the point that attracts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attraction {
    /// Unit vector `F`.
    pub direction: Vector3,
    /// The point `g`.
    pub point: Point3,
    /// Angle from `F` at which the effect has fallen to `e^{-1/2}`, radians.
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
}

/// Fraction of the largest displacement from which a vertex belongs to the zone.
const ZONE: f64 = 0.1;

/// `v′ = v + Σⱼ k(∠(Fⱼ, gⱼ − v)) (gⱼ − v) + ε N` with `k(θ) = κ exp(−θ²/2θ₀²)`, where κ is found so
/// that the mean absolute edge-length change in the zone is `extension` (0.1 for the paper's 10 %),
/// and `ε` is `lift` times the local displacement.
pub fn deform(mesh: &Mesh, attractions: &[Attraction], extension: f64, lift: f64) -> Deformation {
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let field: Vec<Vector3> =
        mesh.positions.iter().zip(&normals).map(|(v, n)| pull(v, n, attractions, lift)).collect();
    let largest = field.iter().map(|d| d.norm()).fold(0.0, f64::max);
    let zone: Vec<bool> =
        field.iter().map(|d| largest > 0.0 && d.norm() > ZONE * largest).collect();
    let at = |k: f64| -> Vec<Point3> {
        mesh.positions.iter().zip(&field).map(|(v, d)| v + d * k).collect()
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if zone_extension(mesh, &at(middle), &zone) < extension {
            low = middle;
        } else {
            high = middle;
        }
    }
    let vertices = at(if extension > 0.0 { high } else { 0.0 });
    let reached = zone_extension(mesh, &vertices, &zone);
    Deformation { vertices, zone, extension: reached }
}

fn pull(v: &Point3, normal: &Vector3, attractions: &[Attraction], lift: f64) -> Vector3 {
    let towards: Vector3 = attractions
        .iter()
        .map(|a| {
            let offset = a.point - v;
            let angle = a.direction.angle(&offset);
            offset * (-0.5 * (angle / a.angle).powi(2)).exp()
        })
        .sum();
    towards + normal * (lift * towards.norm())
}

/// Mean `|‖e′‖/‖e‖ − 1|` over the edges with both ends in the zone.
fn zone_extension(mesh: &Mesh, shape: &[Point3], zone: &[bool]) -> f64 {
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
    changes.iter().sum::<f64>() / changes.len().max(1) as f64
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
            angle: 0.25,
        };
        for extension in [0.0, 0.05, 0.2] {
            let deformed = deform(&mesh, &[pull], extension, 0.0);
            assert!((deformed.extension - extension).abs() < 1e-6, "{}", deformed.extension);
            let affected = deformed.zone.iter().filter(|z| **z).count();
            assert!((10..200).contains(&affected), "{affected}");
        }
    }
}
