//! The other answer of shading: the dent that looks like a bump.
//!
//! With the light beside the lens, brightness tells how steep a surface is but hardly which way it
//! leans, so a solve can settle on a bulge where tissue was pushed in. The mirror image of what it
//! moved is a start in the other valley; the lower cost decides.

use crate::geometry::Point3;
use crate::mesh::Topology;
use crate::mesh::components::vertex_parts;

/// Of all constants here: `docs/results/choices.md`, both signs. Vertices that moved less than this
/// part of the largest movement belong to no region.
const CALM: f64 = 0.1;

/// Regions whose largest movement is less than this part of the largest of all are left alone.
const FAINT: f64 = 0.3;

/// What the movement of a region is multiplied by: its mirror image, and a deeper one, since a
/// solve that went the wrong way stopped early.
const FACTORS: [f64; 2] = [-1.0, -3.0];

/// `shape` with the movement along the viewing rays since `start` turned round, one region at a
/// time, the largest movement first, for at most `count` regions (camera axes).
pub fn mirrored(
    topology: &Topology,
    start: &[Point3],
    shape: &[Point3],
    count: usize,
) -> Vec<Vec<Point3>> {
    let moved: Vec<f64> =
        start.iter().zip(shape).map(|(a, b)| (b - a).dot(&b.coords.normalize())).collect();
    let largest = moved.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
    let mut regions = regions(topology, &moved, CALM * largest);
    let peak = |region: &[usize]| region.iter().fold(0.0, |m: f64, &v| m.max(moved[v].abs()));
    regions.retain(|r| peak(r) > FAINT * largest);
    regions.sort_by(|a, b| peak(b).total_cmp(&peak(a)));
    regions.truncate(count);
    regions
        .iter()
        .flat_map(|region| FACTORS.map(|factor| (region, factor)))
        .map(|(region, factor)| {
            let mut other = shape.to_vec();
            for &v in region {
                other[v] -= shape[v].coords.normalize() * ((1.0 - factor) * moved[v]);
            }
            other
        })
        .collect()
}

/// Connected sets of vertices that moved the same way by more than `calm`.
fn regions(topology: &Topology, moved: &[f64], calm: f64) -> Vec<Vec<usize>> {
    vertex_parts(topology, |v| (moved[v].abs() > calm).then_some(moved[v] > 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector3;
    use crate::mesh::shapes;

    #[test]
    fn each_region_is_turned_alone() {
        let at = |k: usize| Point3::new((k % 20) as f64, (k / 20) as f64, 0.0);
        let mesh = shapes::mesh((0..100).map(at).collect(), shapes::grid_faces(20, 5, false));
        let start: Vec<Point3> =
            mesh.positions.iter().map(|p| p + Vector3::new(-9.5, -2.0, 50.0)).collect();
        let bump = |v: usize, x: f64, by: f64| {
            by * f64::max(1.0 - ((mesh.positions[v].x - x) / 4.0).powi(2), 0.0)
        };
        let along = |v: usize| bump(v, 4.0, 2.0) + bump(v, 15.0, -1.0);
        let moved = |sign: &dyn Fn(usize) -> f64| -> Vec<Point3> {
            (0..start.len())
                .map(|v| start[v] + start[v].coords.normalize() * (sign(v) * along(v)))
                .collect()
        };
        let shape = moved(&|_| 1.0);
        let found = mirrored(&mesh.topology, &start, &shape, 3);
        assert_eq!(found.len(), 4);
        let first = moved(&|v| if mesh.positions[v].x < 9.0 { -1.0 } else { 1.0 });
        for (v, (a, b)) in found[0].iter().zip(&first).enumerate() {
            let tolerance = 2.0 * CALM * 2.0 + 1e-9;
            assert!((a - b).norm() < tolerance, "vertex {v}: {a} against {b}");
        }
        assert_eq!(mirrored(&mesh.topology, &start, &shape, 1).len(), 2);
        assert!(mirrored(&mesh.topology, &start, &start, 3).is_empty());
    }
}
