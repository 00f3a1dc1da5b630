//! From the depth map to the vertices of the template.

use super::grid::PixelGrid;
use super::input::SfsInput;
use crate::camera::Camera;
use crate::geometry::{Point3, Vector3};

/// Rounds of averaging over hidden vertices.
const ROUNDS: usize = 200;

/// Visible vertices go along their sightline to the depth map, hidden ones follow their neighbours.
pub(super) fn vertices(
    input: &SfsInput,
    grid: &PixelGrid,
    log_depth: &[f64],
    posed: &[Point3],
    visible: &[bool],
) -> Vec<Point3> {
    let moved: Vec<Option<Vector3>> = posed
        .iter()
        .zip(visible)
        .map(|(p, &visible)| {
            let pixel = visible.then(|| input.camera.project(p)).flatten()?.pixel;
            let depth = grid.interpolate(log_depth, &pixel)?.exp();
            Some(p.coords * (depth / p.z - 1.0))
        })
        .collect();
    let carried = carry(&input.mesh.topology.one_ring, moved);
    posed.iter().zip(carried).map(|(p, d)| p + d).collect()
}

/// A harmonic extension, nearly: first outwards ring by ring, then averaged.
fn carry(rings: &[Vec<u32>], known: Vec<Option<Vector3>>) -> Vec<Vector3> {
    let mean = |v: usize, values: &[Option<Vector3>]| {
        let near = rings[v].iter().filter_map(|&j| values[j as usize]);
        let (sum, count) = near.fold((Vector3::zeros(), 0), |(s, n), d| (s + d, n + 1));
        (count > 0).then(|| sum / f64::from(count))
    };
    let mut values = known.clone();
    loop {
        let next: Vec<_> =
            (0..values.len()).map(|v| values[v].or_else(|| mean(v, &values))).collect();
        if next == values {
            break;
        }
        values = next;
    }
    for _ in 0..ROUNDS {
        values = (0..values.len())
            .map(|v| known[v].or_else(|| mean(v, &values)).or(values[v]))
            .collect();
    }
    values.into_iter().map(Option::unwrap_or_default).collect()
}
