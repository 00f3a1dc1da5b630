//! Shortest paths along edges (Dijkstra), the distances that cutting and ordering need. They
//! overestimate the geodesic distance by a few per cent, depending on the triangulation.

use super::Topology;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Distance of every vertex from a set of sources along edges, and the way back.
#[derive(Clone, Debug)]
pub struct Distances {
    /// In the unit of the edge costs; infinity where no path leads.
    pub distance: Vec<f64>,
    /// The vertex before on the path; itself at a source or where no path leads.
    pub previous: Vec<u32>,
}

impl Distances {
    /// Vertices from `vertex` back to its source, both included.
    pub fn path(&self, mut vertex: u32) -> Vec<u32> {
        let mut path = vec![vertex];
        while self.previous[vertex as usize] != vertex {
            vertex = self.previous[vertex as usize];
            path.push(vertex);
        }
        path
    }
}

#[derive(PartialEq)]
struct QueuedVertex(f64, u32);

impl Eq for QueuedVertex {}

impl Ord for QueuedVertex {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

impl PartialOrd for QueuedVertex {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Shortest paths from the nearest of `sources`; `cost` holds a value ≥ 0 for every edge of the
/// topology. Equal lengths are decided by the smaller vertex number.
pub fn shortest_paths(topology: &Topology, cost: &[f64], sources: &[u32]) -> Distances {
    let n = topology.vertex_count;
    let mut result =
        Distances { distance: vec![f64::INFINITY; n], previous: (0..n as u32).collect() };
    let mut heap = BinaryHeap::new();
    for &s in sources {
        result.distance[s as usize] = 0.0;
        heap.push(Reverse(QueuedVertex(0.0, s)));
    }
    while let Some(Reverse(QueuedVertex(distance, v))) = heap.pop() {
        if distance > result.distance[v as usize] {
            continue;
        }
        for &w in &topology.one_ring[v as usize] {
            let Some(edge) = topology.edge_index(v, w) else { continue };
            let through = distance + cost[edge];
            if through < result.distance[w as usize] {
                result.distance[w as usize] = through;
                result.previous[w as usize] = v;
                heap.push(Reverse(QueuedVertex(through, w)));
            }
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn along_the_rim_of_a_tube() {
        let tube = shapes::tube(8, 3, 1.0);
        let found = shortest_paths(&tube.topology, &tube.edge_lengths(), &[0]);
        let side = 2.0 * (std::f64::consts::PI / 8.0).sin();
        assert!((found.distance[2] - 2.0 * side).abs() < 1e-12);
        assert_eq!(found.path(2), [2, 1, 0]);
        assert!((found.distance[8] - 0.5).abs() < 1e-12);
    }
}
