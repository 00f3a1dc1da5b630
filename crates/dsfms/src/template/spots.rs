//! Surface spots on which gains and light are estimated: spread evenly by area, the same for the
//! same mesh.

use super::photometric::{AlbedoView, ObservationBounds, PreparedView, SpotObservation};
use crate::geometry::{Point3, Vector3, point_at};
use crate::light::LightModel;
use crate::mesh::{Mesh, Topology, normals::vertex_normals};
use rayon::prelude::*;

/// Views used per spot; more add time, not accuracy.
const MAX_VIEWS_PER_SPOT: usize = 24;

/// Vertex normals averaged `rounds` times with those of the one-ring: noise of the reconstructed
/// surface would otherwise print itself into the albedo.
pub(super) fn smoothed_normals(mesh: &Mesh, rounds: usize) -> Vec<Vector3> {
    let mut normals = vertex_normals(&mesh.topology, &mesh.positions);
    for _ in 0..rounds {
        let sums = smooth_once(&mesh.topology, &normals);
        normals = sums.iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect();
    }
    normals
}

/// Every vertex's value and those of its ring, summed.
pub(super) fn smooth_once(topology: &Topology, values: &[Vector3]) -> Vec<Vector3> {
    let sum = |(v, ring): (usize, &Vec<u32>)| {
        ring.iter().fold(values[v], |sum, &j| sum + values[j as usize])
    };
    topology.one_ring.iter().enumerate().map(sum).collect()
}

/// A point of the surface and what the views say of it.
pub(super) struct SurfaceSpot {
    pub face: usize,
    pub weights: [f64; 3],
    pub seen: Vec<SpotObservation>,
}

/// Position and interpolated unit normal at a point of a face; `None` where normals cancel.
pub(super) fn surface_point(
    mesh: &Mesh,
    normals: &[Vector3],
    face: usize,
    w: [f64; 3],
) -> Option<(Point3, Vector3)> {
    let [a, b, c] = mesh.topology.faces[face].map(|v| normals[v as usize]);
    let normal = (a * w[0] + b * w[1] + c * w[2]).try_normalize(0.0)?;
    Some((point_at(mesh.corners(face), w), normal))
}

/// `count` points of the surface, evenly spread by area (stratified along the face order, with
/// barycentrics from a low-discrepancy sequence).
pub(crate) fn even_points(mesh: &Mesh, count: usize) -> Vec<(usize, [f64; 3])> {
    let areas = mesh.face_areas();
    let total: f64 = areas.iter().sum();
    let (mut face, mut passed) = (0, areas.first().copied().unwrap_or(0.0));
    (0..count)
        .map(|i| {
            let target = (i as f64 + 0.5) / count as f64 * total;
            while passed < target && face + 1 < areas.len() {
                face += 1;
                passed += areas[face];
            }
            (face, low_discrepancy(i))
        })
        .collect()
}

/// Roberts' R2 sequence folded into the triangle.
fn low_discrepancy(i: usize) -> [f64; 3] {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let mut u = (0.5 + i as f64 / PLASTIC).fract();
    let mut v = (0.5 + i as f64 / (PLASTIC * PLASTIC)).fract();
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    [1.0 - u - v, u, v]
}

/// Observations of evenly spread spots that at least one view sees.
pub(super) fn observe_spots(
    mesh: &Mesh,
    normals: &[Vector3],
    views: &[PreparedView],
    light: &LightModel,
    bounds: &ObservationBounds,
    count: usize,
) -> Vec<SurfaceSpot> {
    even_points(mesh, count)
        .into_par_iter()
        .filter_map(|(face, weights)| {
            let (point, normal) = surface_point(mesh, normals, face, weights)?;
            let mut seen: Vec<_> = views
                .iter()
                .enumerate()
                .filter_map(|(v, view)| view.observe(v, &point, &normal, light, bounds))
                .collect();
            thin(&mut seen);
            (!seen.is_empty()).then_some(SurfaceSpot { face, weights, seen })
        })
        .collect()
}

/// What is seen of the spots that at least two views see.
pub(super) fn repeated(spots: &[SurfaceSpot]) -> Vec<Vec<SpotObservation>> {
    spots.iter().filter(|s| s.seen.len() >= 2).map(|s| s.seen.clone()).collect()
}

fn thin(seen: &mut Vec<SpotObservation>) {
    let n = seen.len();
    if n > MAX_VIEWS_PER_SPOT {
        *seen = (0..MAX_VIEWS_PER_SPOT).map(|i| seen[i * n / MAX_VIEWS_PER_SPOT]).collect();
    }
}

/// Z-buffers and trust maps of all views.
pub(super) fn prepare<'a>(
    mesh: &Mesh,
    views: &'a [AlbedoView<'a>],
    bounds: &ObservationBounds,
) -> Vec<PreparedView<'a>> {
    views.iter().map(|view| PreparedView::new(mesh, view, bounds)).collect()
}
