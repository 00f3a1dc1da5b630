//! The boundary of the surface that is remeshed.

use crate::geometry::Point3;
use crate::mesh::Mesh;
use crate::mesh::boundary::boundary_loops;

/// The input's boundary, onto which boundary vertices are projected.
pub(super) struct FixedEdges {
    segments: Vec<[Point3; 2]>,
    /// Per vertex of the input: a corner of the boundary.
    pub corners: Vec<bool>,
}

impl FixedEdges {
    pub(super) fn new(mesh: &Mesh, corner_deg: f64, length: f64) -> Self {
        let mut segments = Vec::new();
        let mut corners = vec![false; mesh.positions.len()];
        for vertices in boundary_loops(&mesh.topology) {
            let n = vertices.len();
            let at = |k: usize| mesh.positions[vertices[k % n] as usize];
            segments.extend((0..n).map(|k| [at(k), at(k + 1)]));
            let turns: Vec<f64> = (0..n)
                .map(|k| {
                    // Steps finer than the result are ragged edges, not corners: look further.
                    let ahead = (1..n).map(|j| at(k + j)).find(|p| (p - at(k)).norm() >= length);
                    let behind =
                        (1..n).map(|j| at(k + n - j)).find(|p| (p - at(k)).norm() >= length);
                    let (ahead, behind) =
                        (ahead.unwrap_or(at(k + 1)), behind.unwrap_or(at(k + n - 1)));
                    (at(k) - behind).angle(&(ahead - at(k)))
                })
                .collect();
            for k in 0..n {
                let peak = turns[k] >= turns[(k + 1) % n] && turns[k] > turns[(k + n - 1) % n];
                corners[vertices[k] as usize] |= peak && turns[k] > corner_deg.to_radians();
            }
        }
        Self { segments, corners }
    }

    pub(super) fn closest(&self, p: &Point3) -> Point3 {
        let on = |[a, b]: &[Point3; 2]| {
            let ab = b - a;
            a + ab * ((p - a).dot(&ab) / ab.norm_squared().max(1e-300)).clamp(0.0, 1.0)
        };
        let points = self.segments.iter().map(on);
        points.min_by(|a, b| (a - p).norm().total_cmp(&(b - p).norm())).unwrap_or(*p)
    }
}
