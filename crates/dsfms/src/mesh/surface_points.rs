//! Closest points on a surface, by a tree of bounding boxes.

use super::Mesh;
use crate::geometry::{Point3, Vector3, point_at};

/// A place on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Face of the mesh.
    pub face: u32,
    /// Barycentrics on it, each in `[0, 1]`.
    pub barycentric: [f64; 3],
    /// The point itself.
    pub point: Point3,
    /// Distance from the query, length units.
    pub distance: f64,
}

#[derive(Clone, Copy)]
struct TreeNode {
    low: Point3,
    high: Point3,
    /// Range of `ClosestPoints::order` below this node.
    range: [u32; 2],
    /// Second child (the first follows directly); 0 for a leaf.
    right: u32,
}

/// Answers "where on this surface is the point closest to …".
pub struct ClosestPoints<'a> {
    mesh: &'a Mesh,
    order: Vec<u32>,
    nodes: Vec<TreeNode>,
}

/// Faces of a leaf: few enough to look at all.
const LEAF: usize = 4;

impl<'a> ClosestPoints<'a> {
    /// Build the tree: O(n log n).
    pub fn new(mesh: &'a Mesh) -> Self {
        let faces = mesh.topology.faces.len();
        let mut tree = Self { mesh, order: (0..faces as u32).collect(), nodes: Vec::new() };
        let centres: Vec<Vector3> = (0..faces)
            .map(|f| mesh.corners(f).iter().map(|p| p.coords).sum::<Vector3>() / 3.0)
            .collect();
        if faces > 0 {
            tree.build(&centres, 0, faces);
        }
        tree
    }

    fn build(&mut self, centres: &[Vector3], from: usize, to: usize) {
        let (mut low, mut high) =
            (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for &f in &self.order[from..to] {
            for p in self.mesh.corners(f as usize) {
                (low, high) = (low.inf(&p.coords), high.sup(&p.coords));
            }
        }
        let index = self.nodes.len();
        let range = [from as u32, to as u32];
        self.nodes.push(TreeNode { low: low.into(), high: high.into(), range, right: 0 });
        if to - from <= LEAF {
            return;
        }
        let axis = (high - low).imax();
        let middle = (from + to) / 2;
        self.order[from..to].select_nth_unstable_by(middle - from, |&a, &b| {
            let key = |f: u32| centres[f as usize][axis];
            key(a).total_cmp(&key(b)).then(a.cmp(&b))
        });
        self.build(centres, from, middle);
        self.nodes[index].right = self.nodes.len() as u32;
        self.build(centres, middle, to);
    }

    /// The closest point of the surface; `None` for a surface without faces or a query that is not
    /// finite. Of equally close faces the one found first, which is the same in every run.
    pub fn closest(&self, query: &Point3) -> Option<SurfacePoint> {
        let mut best: Option<SurfacePoint> = None;
        let mut stack = if self.nodes.is_empty() { vec![] } else { vec![0u32] };
        while let Some(n) = stack.pop() {
            let node = &self.nodes[n as usize];
            let reach = best.map_or(f64::INFINITY, |b| b.distance);
            if box_distance(node, query) >= reach {
                continue;
            }
            if node.right == 0 {
                for &face in &self.order[node.range[0] as usize..node.range[1] as usize] {
                    let found = self.on_face(face, query);
                    if found.distance < best.map_or(f64::INFINITY, |b| b.distance) {
                        best = Some(found);
                    }
                }
                continue;
            }
            let (first, second) = (n + 1, node.right);
            let distance = |c: u32| box_distance(&self.nodes[c as usize], query);
            let nearer_first = distance(first) <= distance(second);
            stack.extend(if nearer_first { [second, first] } else { [first, second] });
        }
        best
    }

    fn on_face(&self, face: u32, query: &Point3) -> SurfacePoint {
        let corners = self.mesh.corners(face as usize);
        let barycentric = closest_barycentric(query, corners);
        let point = point_at(corners, barycentric);
        SurfacePoint { face, barycentric, point, distance: (query - point).norm() }
    }
}

fn box_distance(node: &TreeNode, p: &Point3) -> f64 {
    let outside = (node.low - p).sup(&(p - node.high)).sup(&Vector3::zeros());
    outside.norm()
}

/// Barycentrics of the point of a triangle closest to `p` (Ericson, "Real-Time Collision
/// Detection", 5.1.5).
pub(crate) fn closest_barycentric(p: &Point3, [a, b, c]: [&Point3; 3]) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(&(p - a)), ac.dot(&(p - a)));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (d3, d4) = (ab.dot(&(p - b)), ac.dot(&(p - b)));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3);
        return [1.0 - v, v, 0.0];
    }
    let (d5, d6) = (ab.dot(&(p - c)), ac.dot(&(p - c)));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    [va / sum, vb / sum, vc / sum]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn the_tree_agrees_with_trying_every_face() {
        let mesh = shapes::hemisphere(2, 2.0);
        let tree = ClosestPoints::new(&mesh);
        for k in 0..50 {
            let t = k as f64;
            let p =
                Point3::new((t * 0.7).sin() * 3.0, (t * 1.3).cos() * 3.0, (t * 0.4).sin() * 3.0);
            let found = tree.closest(&p).unwrap();
            let least = (0..mesh.topology.faces.len() as u32)
                .map(|f| tree.on_face(f, &p).distance)
                .fold(f64::INFINITY, f64::min);
            assert_eq!(found.distance, least);
            assert!(found.barycentric.iter().all(|b| (-1e-12..=1.0 + 1e-12).contains(b)));
        }
        assert!(tree.closest(&Point3::new(f64::NAN, 0.0, 0.0)).is_none());
    }
}
