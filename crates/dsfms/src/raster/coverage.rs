//! Which pixel centres a projected face covers, and where on the face they lie.

use crate::geometry::Point2;
use crate::mesh::Topology;
use rayon::prelude::*;

/// A projected vertex: pixel and `1/z`; `None` where it does not project.
pub(super) type Corner = Option<(Point2, f64)>;

/// The pixel centres that a face may cover. Small, since all faces of a mesh are listed.
pub(super) struct ScreenFace {
    /// Index in the topology.
    pub index: u32,
    /// First and last column.
    pub x: [u32; 2],
    /// First and last row.
    pub y: [u32; 2],
}

/// The corners of a face on the screen.
pub(super) struct ScreenCorners {
    /// `edges[k]` lies opposite corner `k`.
    edges: [Edge; 3],
    /// `1/z` of the corners.
    inverse_depth: [f64; 3],
}

/// An edge function with a canonical direction (from the lower vertex index to the higher), so
/// that the two faces of an edge compute bit for bit the same number and no pixel falls between.
#[derive(Clone, Copy)]
struct Edge {
    origin: [f64; 2],
    along: [f64; 2],
    sign: f64,
}

impl Edge {
    fn new(from: (u32, Point2), to: (u32, Point2)) -> Self {
        let ((low, high), sign) =
            if from.0 < to.0 { ((from.1, to.1), 1.0) } else { ((to.1, from.1), -1.0) };
        Self { origin: [low.x, low.y], along: [high.x - low.x, high.y - low.y], sign }
    }

    /// The part that a row has in common.
    fn row(&self, y: f64) -> f64 {
        self.along[0] * (y - self.origin[1])
    }

    fn at(&self, row: f64, x: f64) -> f64 {
        self.sign * (row - self.along[1] * (x - self.origin[0]))
    }
}

/// A row of pixel centres across a face.
pub(super) struct PixelRow<'a> {
    face: &'a ScreenCorners,
    edges: [f64; 3],
}

/// A pixel centre inside a face.
pub(super) struct Inside {
    /// Depth of the face there.
    pub depth: f64,
    weighted: [f64; 3],
    total: f64,
}

impl Inside {
    /// Perspective-correct barycentrics.
    pub(super) fn barycentric(&self) -> [f64; 3] {
        self.weighted.map(|v| v / self.total)
    }
}

impl ScreenCorners {
    /// Of a face whose corners all project.
    pub(super) fn of(vertices: [u32; 3], corners: &[Corner]) -> Option<Self> {
        let [a, b, c] = vertices.map(|v| corners[v as usize]);
        let (a, b, c) = (a?, b?, c?);
        let pixels = [a.0, b.0, c.0];
        let corner = |k: usize| (vertices[k], pixels[k]);
        let edges = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| Edge::new(corner(i), corner(j)));
        Some(Self { edges, inverse_depth: [a.1, b.1, c.1] })
    }

    /// A row of pixel centres.
    pub(super) fn row(&self, y: f64) -> PixelRow<'_> {
        PixelRow { face: self, edges: [0, 1, 2].map(|k| self.edges[k].row(y)) }
    }
}

impl PixelRow<'_> {
    /// What the face has at a column; `None` outside.
    pub(super) fn at(&self, x: f64) -> Option<Inside> {
        let (edges, rows) = (&self.face.edges, &self.edges);
        let w = [edges[0].at(rows[0], x), edges[1].at(rows[1], x), edges[2].at(rows[2], x)];
        let inside = (w[0] >= 0.0 && w[1] >= 0.0 && w[2] >= 0.0)
            || (w[0] <= 0.0 && w[1] <= 0.0 && w[2] <= 0.0);
        if !inside {
            return None;
        }
        let weighted: [f64; 3] = std::array::from_fn(|k| w[k] * self.face.inverse_depth[k]);
        let total = weighted[0] + weighted[1] + weighted[2];
        let depth = (w[0] + w[1] + w[2]) / total;
        (total != 0.0).then_some(Inside { depth, weighted, total })
    }
}

/// Every face that may cover a pixel centre, in face order.
pub(super) fn screen_faces(
    topology: &Topology,
    corners: &[Corner],
    size: [usize; 2],
) -> Vec<ScreenFace> {
    (0..topology.faces.len())
        .into_par_iter()
        .filter_map(|f| screen_face(f as u32, topology.faces[f], corners, size))
        .collect()
}

fn screen_face(
    index: u32,
    vertices: [u32; 3],
    corners: &[Corner],
    size: [usize; 2],
) -> Option<ScreenFace> {
    let [a, b, c] = vertices.map(|v| corners[v as usize]);
    let (a, b, c) = (a?, b?, c?);
    let pixels = [a.0, b.0, c.0];
    let x = centres(pixels.map(|p| p.x), size[0])?;
    let y = centres(pixels.map(|p| p.y), size[1])?;
    Some(ScreenFace { index, x, y })
}

/// First and last pixel centre within the span of three coordinates; `None` where there is none.
fn centres(v: [f64; 3], count: usize) -> Option<[u32; 2]> {
    let low = v[0].min(v[1]).min(v[2]).ceil().max(0.0);
    let high = v[0].max(v[1]).max(v[2]).floor().min(count as f64 - 1.0);
    (low <= high).then_some([low as u32, high as u32])
}
