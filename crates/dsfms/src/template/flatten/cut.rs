//! Cutting a connected surface open to a disc.

use crate::geometry::DisjointSets;
use crate::mesh::Mesh;
use crate::mesh::paths::{Distances, shortest_paths};
use crate::mesh::{Topology, boundary::boundary_loops};

/// A connected surface, the edges it is cut along, and the disc that results.
pub(super) struct Cut<'a> {
    pub mesh: &'a Mesh,
    lengths: Vec<f64>,
    /// Per edge: whether it is cut. Boundary edges are open anyway and not marked.
    pub open: Vec<bool>,
}

impl<'a> Cut<'a> {
    /// A short cut that makes the surface a disc: nothing for a disc, shortest paths between the
    /// boundaries, loops for handles, and a path between two extremal points of a closed sphere.
    pub(super) fn to_disc(mesh: &'a Mesh) -> Self {
        let lengths = mesh.edge_lengths();
        let open = cut_graph(&mesh.topology, &lengths);
        let mut cut = Self { mesh, lengths, open };
        if cut.cut_vertices().is_empty() {
            let far = cut.farthest_from(&[mesh.topology.faces[0][0]]);
            let distances = shortest_paths(&mesh.topology, &cut.lengths, &[far]);
            let other = argmax(&distances.distance);
            cut.open_along(&distances, other);
        }
        cut
    }

    /// Lengthen the cut by the shortest path to a vertex. `false` where it already lies on it.
    pub(super) fn extend_to(&mut self, vertex: u32) -> bool {
        let on = self.cut_vertices();
        let distances = shortest_paths(&self.mesh.topology, &self.lengths, &on);
        distances.previous[vertex as usize] != vertex && {
            self.open_along(&distances, vertex);
            true
        }
    }

    /// Vertices on the cut or on a boundary.
    fn cut_vertices(&self) -> Vec<u32> {
        let t = &self.mesh.topology;
        let mut on = t.boundary.clone();
        for (edge, _) in t.edges.iter().zip(&self.open).filter(|(_, open)| **open) {
            edge.iter().for_each(|&v| on[v as usize] = true);
        }
        (0..on.len() as u32).filter(|&v| on[v as usize]).collect()
    }

    fn farthest_from(&self, sources: &[u32]) -> u32 {
        argmax(&shortest_paths(&self.mesh.topology, &self.lengths, sources).distance)
    }

    fn open_along(&mut self, distances: &Distances, vertex: u32) {
        for step in distances.path(vertex).windows(2) {
            if let Some(edge) = self.mesh.topology.edge_index(step[0], step[1])
                && self.mesh.topology.edge_faces[edge][1] != u32::MAX
            {
                self.open[edge] = true;
            }
        }
    }

    /// The surface opened along the cut: every corner gets the vertex of its own fan. Second: the
    /// old vertex of each new one.
    pub(super) fn opened(&self) -> (Mesh, Vec<u32>) {
        let t = &self.mesh.topology;
        let mut fans = DisjointSets::new(3 * t.faces.len());
        let corner = |f: u32, v: u32| {
            3 * f + t.faces[f as usize].iter().position(|&w| w == v).unwrap_or(0) as u32
        };
        for (e, &[f, g]) in t.edge_faces.iter().enumerate() {
            if g != u32::MAX && !self.open[e] {
                for &v in &t.edges[e] {
                    fans.join(corner(f, v), corner(g, v));
                }
            }
        }
        let mut name = vec![u32::MAX; 3 * t.faces.len()];
        let (mut positions, mut old) = (Vec::new(), Vec::new());
        let mut faces = Vec::with_capacity(t.faces.len());
        for (f, face) in t.faces.iter().enumerate() {
            faces.push([0, 1, 2].map(|k| {
                let root = fans.root((3 * f + k) as u32) as usize;
                if name[root] == u32::MAX {
                    name[root] = old.len() as u32;
                    old.push(face[k]);
                    positions.push(self.mesh.positions[face[k] as usize]);
                }
                name[root]
            }));
        }
        let topology = std::sync::Arc::new(Topology::from_checked(positions.len(), faces));
        (Mesh { topology, positions }, old)
    }
}

/// Tree-cotree cut: the edges that a spanning tree of the faces does not cross, dead ends removed.
/// The tree prefers to cross edges far from the root, so that what remains is short.
fn cut_graph(t: &Topology, lengths: &[f64]) -> Vec<bool> {
    let inner = |e: usize| t.edge_faces[e][1] != u32::MAX;
    let root = boundary_loops(t).into_iter().max_by_key(Vec::len).map_or(t.faces[0][0], |l| l[0]);
    // Boundaries are open already: going along them costs nothing.
    let cost: Vec<f64> =
        lengths.iter().enumerate().map(|(e, &l)| if inner(e) { l } else { 0.0 }).collect();
    let tree = shortest_paths(t, &cost, &[root]);
    let in_tree = |e: usize| {
        let [a, b] = t.edges[e].map(|v| v as usize);
        tree.previous[a] == b as u32 || tree.previous[b] == a as u32
    };
    let rank = |e: usize| {
        let [a, b] = t.edges[e].map(|v| tree.distance[v as usize]);
        (in_tree(e), -(a + b + cost[e]))
    };
    let mut order: Vec<usize> = (0..t.edges.len()).filter(|&e| inner(e)).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = ((rank(a), a), (rank(b), b));
        a.0.0.cmp(&b.0.0).then(a.0.1.total_cmp(&b.0.1)).then(a.1.cmp(&b.1))
    });
    let mut tree_of_faces = DisjointSets::new(t.faces.len());
    let mut kept = vec![true; t.edges.len()];
    for e in order {
        let [f, g] = t.edge_faces[e];
        kept[e] = !tree_of_faces.join(f, g);
    }
    prune(t, &mut kept);
    (0..kept.len()).map(|e| kept[e] && inner(e)).collect()
}

/// Remove dead ends of an edge set until none is left (boundary loops have none).
fn prune(t: &Topology, kept: &mut [bool]) {
    let mut degree = vec![0u32; t.vertex_count];
    for (edge, _) in t.edges.iter().zip(kept.iter()).filter(|(_, kept)| **kept) {
        edge.iter().for_each(|&v| degree[v as usize] += 1);
    }
    let mut ends: Vec<u32> =
        (0..t.vertex_count as u32).filter(|&v| degree[v as usize] == 1).collect();
    while let Some(v) = ends.pop() {
        let edges = t.one_ring[v as usize].iter().filter_map(|&w| t.edge_index(v, w));
        let Some(edge) = edges.into_iter().find(|&e| kept[e]) else { continue };
        kept[edge] = false;
        for &w in &t.edges[edge] {
            degree[w as usize] -= 1;
            if degree[w as usize] == 1 {
                ends.push(w);
            }
        }
    }
}

/// Vertex of the largest finite value, the first of equals.
fn argmax(values: &[f64]) -> u32 {
    let mut best = 0;
    for (i, v) in values.iter().enumerate() {
        if v.is_finite() && *v > values[best] {
            best = i;
        }
    }
    best as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn every_surface_opens_to_one_disc() {
        let torus = shapes::torus(12, 8);
        assert_eq!(torus.topology.euler_characteristic(), 0);
        for mesh in
            [shapes::icosphere(2, 1.0), shapes::hemisphere(2, 1.0), shapes::tube(10, 6, 2.0), torus]
        {
            let (disc, old) = Cut::to_disc(&mesh).opened();
            assert_eq!(disc.topology.euler_characteristic(), 1);
            assert_eq!(boundary_loops(&disc.topology).len(), 1);
            assert_eq!(disc.topology.faces.len(), mesh.topology.faces.len());
            assert_eq!(old.len(), disc.positions.len());
        }
    }

    #[test]
    fn a_disc_is_not_cut_and_a_tube_is_cut_straight() {
        let sheet = shapes::irregular_sheet(6);
        assert!(Cut::to_disc(&sheet).open.iter().all(|&open| !open));
        let tube = shapes::tube(10, 6, 2.0);
        assert_eq!(Cut::to_disc(&tube).open.iter().filter(|&&open| open).count(), 5);
    }
}
