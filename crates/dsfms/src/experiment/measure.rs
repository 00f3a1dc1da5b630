//! The three errors of §8.1, over everything and in the deformed zone.

use crate::camera::Camera;
use crate::geometry::Point3;
use crate::pipeline::{
    Method, Observation, ReconstructError, ReconstructOptions, Reconstruction, reconstruct,
};
use crate::synth::Case;

/// A case as a frame to reconstruct, with its matches and without masks.
pub fn observation(case: &Case) -> Observation<'_> {
    Observation::new(&case.frame, &case.camera).matches(&case.matches)
}

/// The surface of a case, whatever is thought of it.
///
/// # Errors
/// No surface at all.
pub fn surface(
    case: &Case,
    method: Method,
    options: &ReconstructOptions,
) -> Result<Reconstruction, ReconstructError> {
    Reconstruction::even_refused(reconstruct(&case.template, &observation(case), method, options))
}

/// Errors of one surface against the truth, absolute, root mean squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Vertices, mm.
    pub rms: f64,
    /// Vertices of the zone, mm.
    pub zone: f64,
    /// Edge lengths, mm.
    pub edge: f64,
    /// Lengths of edges with both ends in the zone, mm.
    pub edge_zone: f64,
    /// Projections of the visible vertices, px.
    pub reprojection: f64,
    /// Projections of the visible vertices of the zone, px.
    pub reprojection_zone: f64,
}

impl Errors {
    /// Names of the errors, in the order of [`Errors::values`].
    pub const NAMES: [&str; 6] =
        ["rms", "zone", "edge", "edge_zone", "reprojection", "reprojection_zone"];

    /// All errors in order.
    pub fn values(&self) -> [f64; 6] {
        [self.rms, self.zone, self.edge, self.edge_zone, self.reprojection, self.reprojection_zone]
    }

    /// From values in order.
    pub(crate) fn from_values(v: [f64; 6]) -> Self {
        let [rms, zone, edge, edge_zone, reprojection, reprojection_zone] = v;
        Self { rms, zone, edge, edge_zone, reprojection, reprojection_zone }
    }
}

/// Errors of `shape` (vertices in camera axes) on a case.
pub fn measure(case: &Case, shape: &[Point3]) -> Errors {
    let truth = &case.truth;
    let zone = |v: usize| case.deformation.zone[v];
    let all = 0..shape.len();
    let vertex = |v: usize| (shape[v] - truth[v]).norm();
    let edges = &case.template.mesh.topology.edges;
    let edge = |e: &[u32; 2]| {
        let length = |x: &[Point3]| (x[e[0] as usize] - x[e[1] as usize]).norm();
        length(shape) - length(truth)
    };
    let in_zone = |e: &&[u32; 2]| zone(e[0] as usize) && zone(e[1] as usize);
    // A vertex behind the camera is as wrong as the picture is wide.
    let lost = case.camera.size[0] as f64;
    let pixel = |v: usize| {
        let (found, true_place) = (case.camera.project(&shape[v]), case.camera.project(&truth[v]));
        found.zip(true_place).map_or(lost, |(a, b)| (a.pixel - b.pixel).norm())
    };
    let seen = |v: &usize| case.visible[*v];
    Errors {
        rms: rms(all.clone().map(vertex)),
        zone: rms(all.clone().filter(|&v| zone(v)).map(vertex)),
        edge: rms(edges.iter().map(edge)),
        edge_zone: rms(edges.iter().filter(in_zone).map(edge)),
        reprojection: rms(all.clone().filter(seen).map(pixel)),
        reprojection_zone: rms(all.filter(|v| seen(v) && zone(*v)).map(pixel)),
    }
}

/// Root mean square; 0 of nothing.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(s, n), v| (s + v * v, n + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::{Cell, Protocol};

    #[test]
    fn a_shift_in_depth_by_hand() {
        let protocol = Protocol { vertices: 100, ..Default::default() };
        let case = protocol.case(Cell { extension: 10.0, noise: 1.0 }, 0);
        assert_eq!(measure(&case, &case.truth).values(), [0.0; 6]);
        let away: Vec<Point3> =
            case.truth.iter().map(|p| p + crate::geometry::Vector3::z() * 0.5).collect();
        let e = measure(&case, &away);
        assert!((e.rms - 0.5).abs() < 1e-12 && (e.zone - 0.5).abs() < 1e-12);
        assert!(e.edge < 1e-12 && e.edge_zone < 1e-12);
        assert!(e.reprojection > 0.1 && e.reprojection < 3.0, "{}", e.reprojection);
        // Twice as far: all edges of twice the length.
        let larger: Vec<Point3> = case.truth.iter().map(|p| Point3::from(p.coords * 2.0)).collect();
        let e = measure(&case, &larger);
        let lengths = case.template.mesh.with_positions(case.truth.clone()).edge_lengths();
        let mean_square = lengths.iter().map(|l| l * l).sum::<f64>() / lengths.len() as f64;
        assert!((e.edge - mean_square.sqrt()).abs() < 1e-9);
        assert!(e.reprojection < 1e-9 && e.reprojection_zone < 1e-9);
    }
}
