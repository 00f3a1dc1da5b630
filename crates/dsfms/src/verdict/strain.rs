//! How far a shape is from rest, and from the shape before.

use crate::geometry::{GRAIN, Point3, align_rigid_few};
use crate::mesh::Mesh;
use rayon::prelude::*;

/// Relative change of length that one edge in twenty exceeds.
pub fn strain(rest: &Mesh, shape: &[Point3]) -> f64 {
    let length = |x: &[Point3], e: &[u32; 2]| (x[e[0] as usize] - x[e[1] as usize]).norm();
    let change = |e: &[u32; 2]| (length(shape, e) / length(&rest.positions, e) - 1.0).abs();
    let mut changes: Vec<f64> =
        rest.topology.edges.par_iter().with_min_len(GRAIN).map(change).collect();
    let place = changes.len() * 19 / 20;
    if changes.is_empty() { 0.0 } else { *changes.select_nth_unstable_by(place, f64::total_cmp).1 }
}

/// Root mean square distance between two shapes after the best rigid motion, of the radius of a
/// disc of the organ's area.
pub fn jump(rest: &Mesh, before: &[Point3], now: &[Point3]) -> Option<f64> {
    let motion = align_rigid_few(before, now)?;
    let squares = before.iter().zip(now).map(|(a, b)| (motion * a - b).norm_squared());
    let rms = (squares.sum::<f64>() / now.len().max(1) as f64).sqrt();
    let area: f64 = rest.face_areas().iter().sum();
    Some(rms / (area / std::f64::consts::PI).sqrt())
}
