//! Small holes closed by a fan around their middle.

use super::clean::boundary_edges;
use super::tetrahedra::Triangles;
use crate::geometry::{Point3, Vector3};
use std::collections::BTreeMap;

/// Close every boundary loop of at most `max_edges` edges but the longest, which is the rim of the
/// open surface. Expects one fan a vertex.
pub(super) fn close_small(triangles: &mut Triangles, max_edges: usize) {
    let loops = boundary_loops(&triangles.faces);
    let length = |ring: &Vec<u32>| -> f64 {
        let place = |i: usize| triangles.positions[ring[i % ring.len()] as usize];
        (0..ring.len()).map(|i| (place(i + 1) - place(i)).norm()).sum()
    };
    let lengths: Vec<f64> = loops.iter().map(length).collect();
    let rim = (0..loops.len()).max_by(|&a, &b| lengths[a].total_cmp(&lengths[b]));
    for (i, ring) in loops.iter().enumerate() {
        if Some(i) != rim && ring.len() >= 3 && ring.len() <= max_edges {
            close(triangles, ring);
        }
    }
}

fn close(triangles: &mut Triangles, ring: &[u32]) {
    let side = |i: usize| [ring[(i + 1) % ring.len()], ring[i]];
    if ring.len() == 3 {
        triangles.faces.push([ring[2], ring[1], ring[0]]);
        return;
    }
    let sum: Vector3 = ring.iter().map(|&v| triangles.positions[v as usize].coords).sum();
    let middle = triangles.positions.len() as u32;
    triangles.positions.push(Point3::from(sum / ring.len() as f64));
    for i in 0..ring.len() {
        let [a, b] = side(i);
        triangles.faces.push([a, b, middle]);
    }
}

/// Boundary loops in the direction of their faces, each begun at its smallest vertex.
pub(super) fn boundary_loops(faces: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut next: BTreeMap<u32, u32> = boundary_edges(faces).iter().map(|e| (e[0], e[1])).collect();
    let mut loops = Vec::new();
    while let Some((&start, _)) = next.first_key_value() {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(to) = next.remove(&at) {
            ring.push(at);
            at = to;
        }
        loops.push(ring);
    }
    loops
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;

    #[test]
    fn a_square_hole_in_a_square_is_closed() {
        // Outer ring 0..4, inner ring 4..8.
        let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let outer = [at(0.0, 0.0), at(3.0, 0.0), at(3.0, 3.0), at(0.0, 3.0)];
        let inner = [at(1.0, 1.0), at(2.0, 1.0), at(2.0, 2.0), at(1.0, 2.0)];
        let mut faces = Vec::new();
        for i in 0..4u32 {
            let j = (i + 1) % 4;
            faces.push([i, j, 4 + i]);
            faces.push([j, 4 + j, 4 + i]);
        }
        let mut square = Triangles { positions: [outer, inner].concat(), faces };
        assert_eq!(boundary_loops(&square.faces).len(), 2);
        close_small(&mut square, 10);
        assert_eq!(boundary_loops(&square.faces), vec![vec![0, 1, 2, 3]]);
        let topology = Topology::new(square.positions.len(), square.faces).unwrap();
        assert_eq!(topology.euler_characteristic(), 1);
        assert!((square.positions[8] - at(1.5, 1.5)).norm() < 1e-12);
    }
}
