//! Where a shape asks for a finer control mesh: where it bends within few control vertices.
//!
//! A displacement `d` that is carried between control vertices `h` apart is off in its gradient,
//! and so the normals that brightness reads, by about `h ‖Lap d‖`. A narrow pull carried by a
//! thousand control vertices has normals up to 6 degrees off, a ring of wrong brightness about it
//! which the solve takes for shape (`docs/results/choices.md`).

use super::Scene;
use crate::geometry::Vector3;

/// `h ‖Lap d‖` that a control mesh may have. Other values are not measured.
const BEND: f64 = 0.15;

/// Edges are at most this much shorter than those of the control mesh: a bound on the work. Other
/// values are not measured.
const FINEST: f64 = 3.0;

/// How much shorter the edges of the mesh of `scene` should be at each of its vertices, 1 or more,
/// where these are displaced from the posed rest shape by `displacement` (length units). What is
/// not seen stays as it is.
pub(super) fn fineness(scene: &Scene, displacement: &[Vector3]) -> Vec<f64> {
    let topology = &scene.rest.topology;
    let around = |of: &[f64], join: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
        let ring = |v: usize| topology.one_ring[v].iter().map(|&w| of[w as usize]);
        (0..of.len()).map(|v| ring(v).fold(of[v], join)).collect()
    };
    let bend = |v: usize| match scene.visible[v] && !topology.boundary[v] {
        true => scene.laplacian.apply(v, displacement).norm(),
        false => 0.0,
    };
    let bend: Vec<f64> = (0..displacement.len()).map(bend).collect();
    let mut mean = around(&bend, &|a, b| a + b);
    mean.iter_mut().zip(&topology.one_ring).for_each(|(m, ring)| *m /= (1 + ring.len()) as f64);
    // The shape is that of a coarse blur: the bend may end two rings further.
    let wide = around(&around(&mean, &f64::max), &f64::max);
    let edge = scene.rest.mean_edge_length();
    wide.iter().map(|bend| (edge * bend / BEND).clamp(1.0, FINEST)).collect()
}
