//! How the smoothed vertex normals turn when vertices move along given directions.

use super::spots::smooth_once;
use crate::geometry::{Point3, Vector3, area_normal};
use crate::mesh::Topology;

/// The linear map from displacements to normals at one shape, applied without a matrix.
pub(super) struct NormalMap<'a> {
    topology: &'a Topology,
    /// By how much the area normal of each face changes with the displacement of its corners.
    corners: Vec<[Vector3; 3]>,
    /// Unit normals, and one over the length of the sum they come from: of the faces around a
    /// vertex, then of every round of smoothing.
    stages: Vec<(Vec<Vector3>, Vec<f64>)>,
}

impl<'a> NormalMap<'a> {
    /// At `positions`, moved along `directions`, with so many rounds of smoothing.
    pub(super) fn new(
        topology: &'a Topology,
        positions: &[Point3],
        directions: &[Vector3],
        rounds: usize,
    ) -> Self {
        let mut sums = vec![Vector3::zeros(); topology.vertex_count];
        let mut corners = Vec::with_capacity(topology.faces.len());
        for face in &topology.faces {
            let p = face.map(|v| &positions[v as usize]);
            let normal = area_normal(p[0], p[1], p[2]);
            face.iter().for_each(|&v| sums[v as usize] += normal);
            let turn =
                |i: usize| directions[face[i] as usize].cross(&(p[(i + 1) % 3] - p[(i + 2) % 3]));
            corners.push([turn(0), turn(1), turn(2)]);
        }
        let mut stages = vec![normalised(sums)];
        for round in 0..rounds {
            stages.push(normalised(smooth_once(topology, &stages[round].0)));
        }
        Self { topology, corners, stages }
    }

    /// The normals themselves.
    pub(super) fn normals(&self) -> &[Vector3] {
        &self.stages[self.stages.len() - 1].0
    }

    /// Change of every normal with the displacements.
    pub(super) fn forward(&self, displacement: &[f64]) -> Vec<Vector3> {
        let mut change = vec![Vector3::zeros(); displacement.len()];
        for (face, corners) in self.topology.faces.iter().zip(&self.corners) {
            let moved: Vector3 =
                face.iter().zip(corners).map(|(&v, c)| c * displacement[v as usize]).sum();
            face.iter().for_each(|&v| change[v as usize] += moved);
        }
        for (round, stage) in self.stages.iter().enumerate() {
            if round > 0 {
                change = smooth_once(self.topology, &change);
            }
            tangential(stage, &mut change);
        }
        change
    }

    /// The transposed map.
    pub(super) fn adjoint(&self, mut change: Vec<Vector3>) -> Vec<f64> {
        for (round, stage) in self.stages.iter().enumerate().rev() {
            tangential(stage, &mut change);
            if round > 0 {
                change = smooth_once(self.topology, &change);
            }
        }
        let mut displacement = vec![0.0; change.len()];
        for (face, corners) in self.topology.faces.iter().zip(&self.corners) {
            let sum: Vector3 = face.iter().map(|&v| change[v as usize]).sum();
            for (&v, c) in face.iter().zip(corners) {
                displacement[v as usize] += c.dot(&sum);
            }
        }
        displacement
    }
}

fn normalised(sums: Vec<Vector3>) -> (Vec<Vector3>, Vec<f64>) {
    let inverse = |s: &Vector3| if s.norm() > 0.0 { 1.0 / s.norm() } else { 0.0 };
    sums.into_iter().map(|s| (s * inverse(&s), inverse(&s))).unzip()
}

/// Derivative of the normalisation.
fn tangential((units, inverses): &(Vec<Vector3>, Vec<f64>), change: &mut [Vector3]) {
    for ((c, n), inverse) in change.iter_mut().zip(units).zip(inverses) {
        *c = (*c - n * n.dot(c)) * *inverse;
    }
}

#[cfg(test)]
mod tests {
    use super::super::spots::smoothed_normals;
    use super::super::test_scene::patch;
    use super::*;

    #[test]
    fn derivative_and_transpose() {
        let mesh = patch();
        let n = mesh.positions.len();
        let directions = smoothed_normals(&mesh, 0);
        let map = NormalMap::new(&mesh.topology, &mesh.positions, &directions, 2);
        let h: Vec<f64> = (0..n).map(|i| (1.3 * i as f64).sin()).collect();
        let moved = |step: f64| {
            let place = |i: usize| mesh.positions[i] + directions[i] * (step * h[i]);
            smoothed_normals(&mesh.with_positions((0..n).map(place).collect()), 2)
        };
        let (up, down, change) = (moved(1e-5), moved(-1e-5), map.forward(&h));
        for i in 0..n {
            let numeric = (up[i] - down[i]) / 2e-5;
            assert!((numeric - change[i]).norm() < 1e-6, "vertex {i}");
        }
        let g: Vec<Vector3> =
            (0..n).map(|i| Vector3::new((i as f64).cos(), 0.2, (0.7 * i as f64).sin())).collect();
        let left: f64 = change.iter().zip(&g).map(|(a, b)| a.dot(b)).sum();
        let right: f64 = map.adjoint(g).iter().zip(&h).map(|(a, b)| a * b).sum();
        assert!((left - right).abs() < 1e-9 * left.abs().max(1.0));
    }
}
