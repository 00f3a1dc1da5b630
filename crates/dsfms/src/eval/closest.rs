//! Closest point on a triangle mesh.

use crate::geometry::{Point3, point_at};
use crate::mesh::Mesh;

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// 0-based face.
    pub face: u32,
    /// Barycentrics on the face.
    pub barycentric: [f64; 3],
    /// Position.
    pub point: Point3,
    /// Distance from the query, length units.
    pub distance: f64,
}

/// Faces per leaf of the tree.
const LEAF: usize = 4;

/// A bounding-volume tree over the faces of a mesh.
#[derive(Clone, Debug)]
pub struct SurfaceIndex<'a> {
    mesh: &'a Mesh,
    /// Faces in tree order.
    order: Vec<u32>,
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    low: Point3,
    high: Point3,
    /// Range of `order`.
    faces: (usize, usize),
    /// Second child (the first follows its parent); 0 for a leaf.
    right: usize,
}

impl<'a> SurfaceIndex<'a> {
    /// Index the faces of a mesh.
    pub fn new(mesh: &'a Mesh) -> Self {
        let centroid: Vec<Point3> = (0..mesh.topology.faces.len())
            .map(|f| point_at(mesh.corners(f), [1.0 / 3.0; 3]))
            .collect();
        let order = (0..centroid.len() as u32).collect();
        let mut index = Self { mesh, order, nodes: Vec::new() };
        index.split(0, centroid.len(), &centroid);
        index
    }

    /// Build the subtree over `order[from..to]` by halving along the longest side.
    fn split(&mut self, from: usize, to: usize, centroid: &[Point3]) {
        let (low, high) = self.bounds(&self.order[from..to]);
        let node = self.nodes.len();
        self.nodes.push(Node { low, high, faces: (from, to), right: 0 });
        if to - from <= LEAF {
            return;
        }
        let axis = (high - low).imax();
        let middle = (from + to) / 2;
        self.order[from..to].select_nth_unstable_by(middle - from, |&a, &b| {
            let key = |f: u32| centroid[f as usize][axis];
            key(a).total_cmp(&key(b)).then(a.cmp(&b))
        });
        self.split(from, middle, centroid);
        self.nodes[node].right = self.nodes.len();
        self.split(middle, to, centroid);
    }

    fn bounds(&self, faces: &[u32]) -> (Point3, Point3) {
        let empty = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
        faces
            .iter()
            .flat_map(|&f| self.mesh.corners(f as usize))
            .fold(empty, |(low, high), p| (low.inf(p), high.sup(p)))
    }

    /// The point of the surface closest to `p`; of equally close faces the one met first.
    pub fn closest(&self, p: &Point3) -> SurfacePoint {
        let mut best = SurfacePoint {
            face: 0,
            barycentric: [1.0, 0.0, 0.0],
            point: *p,
            distance: f64::INFINITY,
        };
        self.visit(0, p, &mut best);
        best
    }

    fn visit(&self, node: usize, p: &Point3, best: &mut SurfacePoint) {
        let n = &self.nodes[node];
        if self.box_distance(node, p) > best.distance {
            return;
        }
        if n.right == 0 {
            for &face in &self.order[n.faces.0..n.faces.1] {
                self.try_face(face, p, best);
            }
            return;
        }
        let (left, right) = (node + 1, n.right);
        let (near, far) = match self.box_distance(left, p) <= self.box_distance(right, p) {
            true => (left, right),
            false => (right, left),
        };
        self.visit(near, p, best);
        self.visit(far, p, best);
    }

    fn box_distance(&self, node: usize, p: &Point3) -> f64 {
        let n = &self.nodes[node];
        (p - p.sup(&n.low).inf(&n.high)).norm()
    }

    fn try_face(&self, face: u32, p: &Point3, best: &mut SurfacePoint) {
        let corners = self.mesh.corners(face as usize);
        let barycentric = closest_barycentric(p, corners);
        let point = point_at(corners, barycentric);
        let distance = (point - p).norm();
        if distance < best.distance {
            *best = SurfacePoint { face, barycentric, point, distance };
        }
    }
}

/// Barycentrics of the point of a triangle closest to `p` (Ericson, Real-Time Collision Detection,
/// §5.1.5: by the region of the plane in which `p` lies).
pub fn closest_barycentric(p: &Point3, [a, b, c]: [&Point3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (ap, bp, cp) = (p - a, p - b, p - c);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let sum = va + vb + vc;
    [va / sum, vb / sum, vc / sum]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;
    use std::sync::Arc;

    #[test]
    fn every_region_of_a_triangle() {
        let (a, b, c) = (Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0));
        let foot = |x, y| {
            let w = closest_barycentric(&Point3::new(x, y, 7.0), [&a, &b, &c]);
            point_at([&a, &b, &c], w)
        };
        let cases = [
            ((-1.0, -1.0), (0.0, 0.0)),
            ((3.0, -1.0), (1.0, 0.0)),
            ((-1.0, 3.0), (0.0, 1.0)),
            ((0.4, -2.0), (0.4, 0.0)),
            ((-2.0, 0.4), (0.0, 0.4)),
            ((1.0, 1.0), (0.5, 0.5)),
            ((0.2, 0.3), (0.2, 0.3)),
        ];
        for ((x, y), (u, v)) in cases {
            assert!((foot(x, y) - Point3::new(u, v, 0.0)).norm() < 1e-12, "at {x}, {y}");
        }
    }

    #[test]
    fn tree_agrees_with_a_plain_search() {
        let n = 9u32;
        let positions: Vec<Point3> = (0..n * n)
            .map(|i| (f64::from(i % n), f64::from(i / n)))
            .map(|(x, y)| Point3::new(x, y, (0.8 * x).sin() * (0.5 * y).cos() * 2.0))
            .collect();
        let faces = (0..(n - 1) * (n - 1))
            .map(|k| k / (n - 1) * n + k % (n - 1))
            .flat_map(|i| [[i, i + 1, i + n], [i + 1, i + n + 1, i + n]])
            .collect();
        let topology = Arc::new(Topology::new((n * n) as usize, faces).unwrap());
        let mesh = Mesh { topology, positions };
        let index = SurfaceIndex::new(&mesh);
        for k in 0..60 {
            let t = f64::from(k);
            let p = Point3::new(
                4.0 + 5.0 * t.sin(),
                4.0 + 5.0 * (1.7 * t).cos(),
                (0.3 * t).sin() * 3.0,
            );
            let plain = (0..mesh.topology.faces.len())
                .map(|f| {
                    let corners = mesh.corners(f);
                    (point_at(corners, closest_barycentric(&p, corners)) - p).norm()
                })
                .fold(f64::INFINITY, f64::min);
            assert!((index.closest(&p).distance - plain).abs() < 1e-12);
        }
    }
}
