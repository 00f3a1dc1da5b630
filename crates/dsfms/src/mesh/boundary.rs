//! Boundary loops.

use super::Topology;
use super::components::face_edges;

/// The closed loops of the boundary, each as its vertices in the direction of the faces' own
/// orientation (the surface lies to the left). Loops are ordered by their first edge; a vertex
/// where two fans touch appears once per fan.
pub fn boundary_loops(topology: &Topology) -> Vec<Vec<u32>> {
    let face_edges = face_edges(topology);
    let is_boundary = |e: u32| topology.edge_faces[e as usize][1] == u32::MAX;
    let mut seen = vec![false; topology.edges.len()];
    let mut loops = Vec::new();
    for start in 0..topology.edges.len() as u32 {
        if !is_boundary(start) || seen[start as usize] {
            continue;
        }
        let (mut vertices, mut edge) = (Vec::new(), start);
        while !seen[edge as usize] {
            seen[edge as usize] = true;
            let face = topology.edge_faces[edge as usize][0];
            let k = face_edges[face as usize].iter().position(|&e| e == edge).unwrap_or(0);
            let corners = topology.faces[face as usize];
            vertices.push(corners[(k + 1) % 3]);
            edge = next(topology, &face_edges, &is_boundary, face, corners[(k + 2) % 3], edge);
        }
        loops.push(vertices);
    }
    loops
}

/// Turn about the head of a boundary edge through its fan, to the next boundary edge.
fn next(
    topology: &Topology,
    face_edges: &[[u32; 3]],
    is_boundary: &impl Fn(u32) -> bool,
    mut face: u32,
    head: u32,
    mut edge: u32,
) -> u32 {
    loop {
        let other = face_edges[face as usize]
            .iter()
            .find(|&&e| e != edge && topology.edges[e as usize].contains(&head));
        let Some(&other) = other else { return edge };
        edge = other;
        if is_boundary(edge) {
            return edge;
        }
        let Some(across) = topology.across(edge as usize, face) else { return edge };
        face = across;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn loops_of_known_surfaces() {
        assert!(boundary_loops(&shapes::icosphere(1, 1.0).topology).is_empty());
        let tube = boundary_loops(&shapes::tube(8, 4, 1.0).topology);
        assert_eq!(tube.len(), 2);
        assert_eq!(tube[0], [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(tube[1].len(), 8);
        let square = Topology::new(4, vec![[0, 1, 2], [2, 1, 3]]).unwrap();
        assert_eq!(boundary_loops(&square), [[0, 1, 3, 2]]);
    }

    #[test]
    fn touching_fans_have_a_loop_each() {
        let t = Topology::new(5, vec![[0, 1, 2], [2, 3, 4]]).unwrap();
        assert_eq!(boundary_loops(&t), [[0, 1, 2], [2, 3, 4]]);
    }
}
