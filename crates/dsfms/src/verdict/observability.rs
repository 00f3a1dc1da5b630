//! What the matches leave open, whatever they agree on.

use crate::camera::{Camera, CameraModel};
use crate::geometry::{Point3, Vector3};
use crate::mesh::Topology;
use crate::register::Match;
use nalgebra::{Matrix2x3, Matrix3, Matrix6, SMatrix};
use serde::Serialize;
use std::collections::BTreeSet;

/// Matches that share a square of this side, of the frame's diagonal, repeat one another.
const SAME: f64 = 0.003;

/// A match is never better than this, px.
const NOISE_PX: f64 = 0.5;

/// Indices of matches in different places of the frame and of the surface.
pub fn distinct(matches: &[Match], diagonal: f64) -> Vec<usize> {
    let side = (SAME * diagonal).max(1.0);
    let mut taken = BTreeSet::new();
    let place = |m: &Match| m.pixel.coords.map(|c| (c / side).floor() as i64);
    (0..matches.len())
        .filter(|&i| {
            let at = place(&matches[i]);
            taken.insert([at.x, at.y])
        })
        .collect()
}

/// How uncertain a rigid pose is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseUncertainty {
    /// Standard deviation of the position that nine in ten of the asked points keep within, length
    /// units.
    pub length: f64,
    /// Largest standard deviation of the orientation, degrees.
    pub degrees: f64,
}

/// Covariance of the pose of a shape (camera axes) from matches on it with the noise of their
/// residuals, as it moves the points `asked`. Infinite where the matches leave a motion open.
pub fn pose_uncertainty(
    camera: &CameraModel,
    topology: &Topology,
    shape: &[Point3],
    matches: &[Match],
    residual_px: f64,
    asked: &[Point3],
) -> PoseUncertainty {
    let open = PoseUncertainty { length: f64::INFINITY, degrees: f64::INFINITY };
    let points: Vec<Point3> =
        matches.iter().map(|m| topology.point(m.face, m.barycentric, shape)).collect();
    let n = points.len().max(1) as f64;
    let centre = points.iter().map(|p| p.coords).sum::<Vector3>() / n;
    let mut information = Matrix6::<f64>::zeros();
    for point in &points {
        let Some(seen) = camera.project(point) else { continue };
        let row: SMatrix<f64, 2, 6> = row(&seen.jacobian, &(point.coords - centre));
        information += row.transpose() * row;
    }
    let sigma = residual_px.max(NOISE_PX);
    // Rotations by the size of the surface, so that all unknowns are lengths and one limit fits.
    let radius = asked.iter().map(|p| (p.coords - centre).norm()).fold(0.0, f64::max);
    if !(radius > 0.0 && radius.is_finite()) {
        return open;
    }
    let scale = Matrix6::from_diagonal(&nalgebra::Vector6::new(
        1.0 / radius,
        1.0 / radius,
        1.0 / radius,
        1.0,
        1.0,
        1.0,
    ));
    let eigen = (scale * information * scale).symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    if largest.is_nan() || largest <= 0.0 || eigen.eigenvalues.min() <= 1e-12 * largest {
        return open;
    }
    let inverse = Matrix6::from_diagonal(&eigen.eigenvalues.map(|e| sigma * sigma / e));
    let covariance =
        scale * (eigen.eigenvectors * inverse * eigen.eigenvectors.transpose()) * scale;
    let mut spread: Vec<f64> = asked
        .iter()
        .map(|p| {
            let moves: SMatrix<f64, 3, 6> = motion(&(p.coords - centre));
            (moves * covariance * moves.transpose()).trace().sqrt()
        })
        .collect();
    spread.sort_unstable_by(f64::total_cmp);
    let turn: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into();
    PoseUncertainty {
        length: spread[spread.len() * 9 / 10],
        degrees: turn.symmetric_eigenvalues().max().max(0.0).sqrt().to_degrees(),
    }
}

/// `∂point/∂(rotation, translation)` at an arm from the centre of the rotation.
fn motion(arm: &Vector3) -> SMatrix<f64, 3, 6> {
    let mut found = SMatrix::<f64, 3, 6>::zeros();
    found.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-arm.cross_matrix()));
    found.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    found
}

fn row(jacobian: &Matrix2x3<f64>, arm: &Vector3) -> SMatrix<f64, 2, 6> {
    jacobian * motion(arm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;
    use crate::geometry::Point2;
    use crate::synth::patch;

    fn camera() -> CameraModel {
        CameraModel {
            size: [720, 576],
            focal: [750.0, 750.0],
            centre: [359.5, 287.5],
            lens: Lens::Pinhole,
        }
    }

    fn found(which: impl Fn(&Point3) -> bool) -> (usize, PoseUncertainty) {
        let mesh = patch(400, 1).mesh;
        let shape: Vec<Point3> =
            mesh.positions.iter().map(|p| p + Vector3::new(0.0, 0.0, 75.0)).collect();
        let camera = camera();
        let matches: Vec<Match> = (0..mesh.topology.faces.len())
            .filter_map(|face| {
                let barycentric = [1.0 / 3.0; 3];
                let corners = mesh.topology.faces[face].map(|v| &shape[v as usize]);
                let point = crate::geometry::point_at(corners, barycentric);
                let pixel = camera.project(&point)?.pixel;
                which(&point).then_some(Match { face: face as u32, barycentric, pixel })
            })
            .collect();
        let places = distinct(&matches, 922.0).len();
        (places, pose_uncertainty(&camera, &mesh.topology, &shape, &matches, 0.3, &shape))
    }

    #[test]
    fn a_line_and_a_small_place_leave_the_pose_open_and_a_spread_does_not() {
        let (_, whole) = found(|_| true);
        assert!(whole.length < 0.1 && whole.degrees < 0.5, "{whole:?}");
        let (_, line) = found(|p| p.y.abs() < 0.8);
        assert!(line.length > 5.0 * whole.length, "{line:?} {whole:?}");
        let (_, small) = found(|p| p.x.hypot(p.y) < 2.5);
        assert!(small.length > 1.0 && small.degrees > 2.0, "{small:?}");
        assert_eq!(found(|_| false).1.length, f64::INFINITY);
    }

    #[test]
    fn repeated_matches_count_once() {
        let at =
            |x: f64| Match { face: 0, barycentric: [1.0, 0.0, 0.0], pixel: Point2::new(x, 10.0) };
        let matches: Vec<Match> = (0..500).map(|i| at(40.0 * f64::from(i % 4))).collect();
        assert_eq!(distinct(&matches, 734.0), [0, 1, 2, 3]);
    }
}
