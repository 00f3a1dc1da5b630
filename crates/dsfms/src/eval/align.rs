//! Alignment before a comparison.

use crate::geometry::{Point3, Similarity, Vector3, align_rigid, align_similarity, normal};
use crate::mesh::Mesh;
use crate::mesh::surface_points::{ClosestPoints, SurfacePoint};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// What is fitted and taken out before errors are measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Alignment {
    /// Nothing: absolute errors.
    #[default]
    None,
    /// Rotation and translation.
    Rigid,
    /// Rotation, translation and scale.
    Similarity,
}

impl Alignment {
    /// Least-squares `target ≈ S · source` over pairs.
    fn of_pairs(self, source: &[Point3], target: &[Point3]) -> Option<Similarity> {
        match self {
            Self::None => Some(Similarity::identity()),
            Self::Rigid => Some(Similarity::from_isometry(align_rigid(source, target)?, 1.0)),
            Self::Similarity => align_similarity(source, target),
        }
    }
}

/// The alignment of `found` to `truth`: over vertices for the same connectivity, else by closest
/// points from where the surfaces lie.
pub(super) fn fit(
    found: &Mesh,
    truth: &Mesh,
    same_connectivity: bool,
    kind: Alignment,
) -> Option<Similarity> {
    match kind {
        Alignment::None => Some(Similarity::identity()),
        _ if same_connectivity => kind.of_pairs(&found.positions, &truth.positions),
        _ => starts(found, truth, kind)
            .into_iter()
            .filter_map(|start| align_surfaces(&found.positions, truth, kind, start))
            .map(|fit| (apart(found, truth, &fit), fit))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, fit)| fit),
    }
}

/// Where to start from: as the surfaces lie; and, where the scale is free, scaled about the origin,
/// which is the camera of both where both are in camera axes.
fn starts(found: &Mesh, truth: &Mesh, kind: Alignment) -> Vec<Similarity> {
    let mut starts = vec![Similarity::identity()];
    let far = |mesh: &Mesh| {
        mesh.positions.iter().map(|p| p.coords).sum::<Vector3>().norm()
            / mesh.positions.len().max(1) as f64
    };
    let scale = far(truth) / far(found);
    if kind == Alignment::Similarity && scale.is_finite() && scale > 0.0 {
        starts.push(Similarity::from_scaling(scale));
    }
    starts
}

/// Mean distance between the surfaces, from both sides: a surface that shrinks onto a point is far
/// from what it should cover.
fn apart(found: &Mesh, truth: &Mesh, fit: &Similarity) -> f64 {
    let moved = found.with_positions(found.positions.iter().map(|p| fit * p).collect());
    let mean = |from: &Mesh, to: &Mesh| {
        let surface = ClosestPoints::new(to);
        let distances = from.positions.iter().filter_map(|p| Some(surface.closest(p)?.distance));
        distances.sum::<f64>() / from.positions.len().max(1) as f64
    };
    mean(&moved, truth) + mean(truth, &moved)
}

/// Closest-point registration from `start`: `truth ≈ S · points`. Every round moves along the
/// normals of the closest faces (point to plane) and leaves out the tenth of the points that lies
/// farthest. Finds the nearest local optimum only; `None` if the step has no solution.
#[doc(alias = "ICP")]
pub fn align_surfaces(
    points: &[Point3],
    truth: &Mesh,
    kind: Alignment,
    start: Similarity,
) -> Option<Similarity> {
    /// A bound on time.
    const ROUNDS: usize = 40;
    let surface = ClosestPoints::new(truth);
    let mut fit = start;
    for _ in 0..ROUNDS {
        let moved = points.iter().map(|p| fit * p);
        let mut pairs: Vec<_> = moved.filter_map(|p| Some((p, surface.closest(&p)?))).collect();
        pairs.sort_by(|a, b| a.1.distance.total_cmp(&b.1.distance));
        pairs.truncate((pairs.len() * 9).div_ceil(10));
        let centre = pairs.iter().map(|p| p.0.coords).sum::<Vector3>() / pairs.len() as f64;
        let step = point_to_plane_step(&pairs, truth, centre, kind)?;
        fit = step * fit;
        if step.isometry.rotation.angle() + (step.scaling() - 1.0).abs() < 1e-10 {
            break;
        }
    }
    Some(fit)
}

/// Gauss–Newton step of `Σ (n·(S x − q))²` in rotation, translation and, where asked for, scale
/// about `centre`, slightly damped so that a direction that no normal sees stays still.
fn point_to_plane_step(
    pairs: &[(Point3, SurfacePoint)],
    truth: &Mesh,
    centre: Vector3,
    kind: Alignment,
) -> Option<Similarity> {
    let (mut normal_matrix, mut gradient) = (SMatrix::<f64, 7, 7>::zeros(), SVector::zeros());
    for (x, on) in pairs {
        let [a, b, c] = truth.corners(on.face as usize);
        let Some(n) = normal(a, b, c) else { continue };
        let arm = x.coords - centre;
        let turn = arm.cross(&n);
        let stretch = if kind == Alignment::Similarity { arm.dot(&n) } else { 0.0 };
        let row = SVector::from([turn.x, turn.y, turn.z, n.x, n.y, n.z, stretch]);
        normal_matrix += row * row.transpose();
        gradient += row * (x - on.point).dot(&n);
    }
    for k in 0..7 {
        normal_matrix[(k, k)] += 1e-9 * normal_matrix[(k, k)] + 1e-12;
    }
    let d = -normal_matrix.cholesky()?.solve(&gradient);
    let rotation = Similarity::new(Vector3::zeros(), Vector3::new(d[0], d[1], d[2]), 1.0 + d[6]);
    let there = Similarity::new(centre + Vector3::new(d[3], d[4], d[5]), Vector3::zeros(), 1.0);
    let back = Similarity::new(-centre, Vector3::zeros(), 1.0);
    Some(there * rotation * back)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use std::sync::Arc;

    #[test]
    fn closest_points_find_a_small_similarity() {
        let height = |x: f64, y: f64| (0.6 * x).sin() + 0.7 * (0.9 * y).cos() + 0.1 * x * y;
        let n = 12u32;
        let positions: Vec<Point3> = (0..n * n)
            .map(|i| (f64::from(i % n), f64::from(i / n)))
            .map(|(x, y)| Point3::new(x, y, height(x, y)))
            .collect();
        let faces = (0..(n - 1) * (n - 1))
            .map(|k| k / (n - 1) * n + k % (n - 1))
            .flat_map(|i| [[i, i + 1, i + n], [i + 1, i + n + 1, i + n]])
            .collect();
        let topology = Arc::new(Topology::new((n * n) as usize, faces).unwrap());
        let truth = Mesh { topology, positions };
        let s = Similarity::new(Vector3::new(0.1, -0.1, 0.05), Vector3::new(0.01, 0.02, 0.0), 1.02);
        let moved: Vec<Point3> = truth.positions.iter().map(|p| s.inverse() * p).collect();
        let found =
            align_surfaces(&moved, &truth, Alignment::Similarity, Similarity::identity()).unwrap();
        let worst = moved.iter().zip(&truth.positions).map(|(m, t)| (found * m - t).norm());
        assert!(worst.fold(0.0, f64::max) < 1e-6);
    }
}
