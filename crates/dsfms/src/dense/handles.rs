//! Handles of the fused surface: tunnels between noisy layers of depth, cut open where they are
//! thinnest.
//!
//! With every boundary loop closed by a cone, a surface has two independent loops a handle that
//! bound nothing. They come from a tree of edges and a tree of faces that cross none of its edges
//! (Erickson and Whittlesey 2005): each edge in neither closes one through the root.

use super::tetrahedra::Triangles;
use crate::geometry::DisjointSets;
use crate::mesh::faces::{edge_list, pieces, simple_loops};
use rayon::prelude::*;
use std::collections::{BTreeMap, VecDeque};

/// Roots tried: the shortest loop through a root need not be the shortest of its kind.
const ROUNDS: usize = 4;
/// Vertices of the best loop that become roots in the next round.
const ROOTS: usize = 3;
/// Edges that a path over the cone of a boundary counts as: it is no path on the surface.
const OUTSIDE: usize = 1_000_000;

/// Handles of a manifold surface, summed over its pieces. Expects one fan a vertex.
pub(super) fn handles(triangles: &Triangles) -> usize {
    by_piece(triangles).values().sum()
}

/// Handles of every piece, by its label: `χ = 2 − 2 g − b`.
fn by_piece(triangles: &Triangles) -> BTreeMap<u32, usize> {
    let labels = pieces(&triangles.faces);
    let mut of_vertex = vec![u32::MAX; triangles.positions.len()];
    let mut euler: BTreeMap<u32, i64> = BTreeMap::new();
    for (face, &label) in triangles.faces.iter().zip(&labels) {
        face.iter().for_each(|&v| of_vertex[v as usize] = label);
        *euler.entry(label).or_default() += 1;
    }
    let mut add = |label: u32, count: i64| {
        if let Some(sum) = euler.get_mut(&label) {
            *sum += count;
        }
    };
    of_vertex.iter().for_each(|&label| add(label, 1));
    let edges = edge_list(&triangles.faces);
    edges.chunk_by(|a, b| a.0 == b.0).for_each(|sides| add(labels[sides[0].1 as usize], -1));
    // As if every boundary were closed.
    simple_loops(&triangles.faces).iter().for_each(|r| add(of_vertex[r[0] as usize], 1));
    euler.into_iter().map(|(label, euler)| (label, ((2 - euler) / 2).max(0) as usize)).collect()
}

/// Take away the faces around the shortest loop of a handle that is found, if it has at most
/// `longest` edges. Expects one fan a vertex and all vertices in use.
pub(super) fn cut_one(triangles: &mut Triangles, longest: usize) -> bool {
    let closed = Closed::new(triangles);
    let with_handles = by_piece(triangles).into_iter().filter(|(_, handles)| *handles > 0);
    let mut roots: Vec<u32> =
        with_handles.map(|(label, _)| triangles.faces[label as usize][0]).collect();
    let mut best: Option<Vec<u32>> = None;
    for _ in 0..ROUNDS {
        let found: Vec<_> = roots.par_iter().map(|&root| closed.shortest_loop(root)).collect();
        let Some(ring) = found.into_iter().flatten().min_by_key(Vec::len) else { break };
        if best.as_ref().is_some_and(|b| b.len() <= ring.len()) {
            break;
        }
        roots = (0..ROOTS).map(|k| ring[k * ring.len() / ROOTS]).collect();
        best = Some(ring);
    }
    let Some(ring) = best.filter(|ring| ring.len() <= longest) else { return false };
    let mut on = vec![false; triangles.positions.len()];
    ring.iter().for_each(|&v| on[v as usize] = true);
    triangles.faces.retain(|face| !face.iter().any(|&v| on[v as usize]));
    true
}

/// The surface with a cone over every boundary loop.
struct Closed {
    /// First of the tips of the cones.
    tips: usize,
    /// Edges and the faces at their two sides.
    edges: Vec<([u32; 2], [u32; 2])>,
    faces: usize,
    /// Edges at each vertex.
    around: Vec<Vec<u32>>,
}

impl Closed {
    fn new(triangles: &Triangles) -> Self {
        let tips = triangles.positions.len();
        let mut faces = triangles.faces.clone();
        let loops = simple_loops(&faces);
        for (tip, ring) in loops.iter().enumerate() {
            let next = ring.iter().cycle().skip(1);
            faces.extend(ring.iter().zip(next).map(|(&a, &b)| [b, a, (tips + tip) as u32]));
        }
        let list = edge_list(&faces);
        let edges: Vec<_> = list
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|sides| sides.len() == 2)
            .map(|sides| (sides[0].0, [sides[0].1, sides[1].1]))
            .collect();
        let mut around = vec![Vec::new(); tips + loops.len()];
        for (e, (ends, _)) in edges.iter().enumerate() {
            ends.iter().for_each(|&v| around[v as usize].push(e as u32));
        }
        Self { tips, edges, faces: faces.len(), around }
    }

    /// The shortest loop through `root` that bounds nothing, on the surface itself.
    fn shortest_loop(&self, root: u32) -> Option<Vec<u32>> {
        let (depth, parent, in_tree) = self.tree(root);
        let length = |e: usize| {
            let [a, b] = self.edges[e].0.map(|v| v as usize);
            depth[a].saturating_add(depth[b]).saturating_add(1)
        };
        // A spanning tree of the faces over the edges with the longest loops; the rest are short.
        let mut order: Vec<usize> = (0..self.edges.len()).filter(|&e| !in_tree[e]).collect();
        order.sort_by_key(|&e| (std::cmp::Reverse(length(e)), e));
        let mut parts = DisjointSets::new(self.faces);
        let left = order.into_iter().filter(|&e| {
            let [a, b] = self.edges[e].1;
            !parts.join(a, b)
        });
        let shortest = left.filter(|&e| length(e) < OUTSIDE).min_by_key(|&e| (length(e), e))?;
        let [a, b] = self.edges[shortest].0;
        let mut ring = path(&parent, a);
        ring.extend(path(&parent, b));
        ring.sort_unstable();
        ring.dedup();
        Some(ring)
    }

    /// Breadth first from the root, over the tips of cones last: depth and parent of every vertex,
    /// and which edges the tree takes.
    fn tree(&self, root: u32) -> (Vec<usize>, Vec<u32>, Vec<bool>) {
        let n = self.around.len();
        let (mut depth, mut parent) = (vec![usize::MAX; n], (0..n as u32).collect::<Vec<_>>());
        let mut in_tree = vec![false; self.edges.len()];
        let (mut queue, mut tips) = (VecDeque::from([root]), VecDeque::new());
        depth[root as usize] = 0;
        while let Some(v) = queue.pop_front().or_else(|| tips.pop_front()) {
            for &e in &self.around[v as usize] {
                let [a, b] = self.edges[e as usize].0;
                let w = if a == v { b } else { a };
                if depth[w as usize] != usize::MAX {
                    continue;
                }
                let tip = w as usize >= self.tips;
                depth[w as usize] = depth[v as usize] + if tip { OUTSIDE } else { 1 };
                parent[w as usize] = v;
                in_tree[e as usize] = true;
                if tip { tips.push_back(w) } else { queue.push_back(w) }
            }
        }
        (depth, parent, in_tree)
    }
}

/// From a vertex to the root.
fn path(parent: &[u32], mut v: u32) -> Vec<u32> {
    let mut path = vec![v];
    while parent[v as usize] != v {
        v = parent[v as usize];
        path.push(v);
    }
    path
}

#[cfg(test)]
mod tests {
    use super::super::clean::{compact, split_bow_ties};
    use super::super::holes::close_small;
    use super::*;
    use crate::geometry::Point3;

    /// An `n × m` grid on a torus; the square at its start is left out where asked.
    fn torus(n: u32, m: u32, open: bool) -> Triangles {
        let at = |x: u32, y: u32| (y % m) * n + x % n;
        let squares = (0..n * m).skip(usize::from(open)).map(|i| (i % n, i / n));
        let faces = squares.flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        let place = |i: u32| Point3::new(f64::from(i % n), f64::from(i / n), f64::from(i % 7));
        Triangles { positions: (0..n * m).map(place).collect(), faces: faces.collect() }
    }

    #[test]
    fn handles_by_hand() {
        assert_eq!(handles(&torus(5, 5, false)), 1);
        assert_eq!(handles(&torus(5, 5, true)), 1);
        let fan =
            Triangles { positions: vec![Point3::origin(); 4], faces: vec![[0, 1, 2], [0, 2, 3]] };
        assert_eq!(handles(&fan), 0);
    }

    #[test]
    fn a_torus_is_cut_where_it_is_thin() {
        let mut torus = torus(6, 30, true);
        assert!(!cut_one(&mut torus, 5));
        assert!(cut_one(&mut torus, 10));
        split_bow_ties(&mut torus);
        compact(&mut torus);
        close_small(&mut torus, 20);
        assert_eq!(handles(&torus), 0);
        assert!(pieces(&torus.faces).iter().all(|&label| label == 0));
    }
}
