//! Connected pieces of a surface.

use super::Topology;
use super::faces::pieces;

/// Which piece each face belongs to. Pieces are joined by shared edges; two that only touch at a
/// vertex are separate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Components {
    /// Number of pieces.
    pub count: usize,
    /// Piece of every face; numbered by their first face.
    pub of_face: Vec<u32>,
}

/// The connected components of a surface.
pub fn components(topology: &Topology) -> Components {
    let mut number = vec![u32::MAX; topology.faces.len()];
    let mut count = 0;
    let numbered = |first: u32| {
        let number = &mut number[first as usize];
        if *number == u32::MAX {
            *number = count;
            count += 1;
        }
        *number
    };
    let of_face = pieces(&topology.faces).into_iter().map(numbered).collect();
    Components { count: count as usize, of_face }
}

/// Edges of every face: `[i]` lies opposite corner `i`.
pub(crate) fn face_edges(topology: &Topology) -> Vec<[u32; 3]> {
    let mut edges = vec![[u32::MAX; 3]; topology.faces.len()];
    for (e, (&[a, b], faces)) in topology.edges.iter().zip(&topology.edge_faces).enumerate() {
        for &f in faces.iter().filter(|&&f| f != u32::MAX) {
            let opposite = topology.faces[f as usize].iter().position(|&v| v != a && v != b);
            if let Some(corner) = opposite {
                edges[f as usize][corner] = e as u32;
            }
        }
    }
    edges
}

/// The piece with the largest area as a mesh of its own, unused vertices removed, order kept.
/// Second: for each new vertex its old number.
pub fn largest_component(mesh: &super::Mesh) -> (super::Mesh, Vec<u32>) {
    let parts = components(&mesh.topology);
    let mut areas = vec![0.0; parts.count];
    for (&part, area) in parts.of_face.iter().zip(mesh.face_areas()) {
        areas[part as usize] += area;
    }
    let largest = (0..parts.count).max_by(|&a, &b| areas[a].total_cmp(&areas[b])).unwrap_or(0);
    let keep: Vec<usize> =
        (0..parts.of_face.len()).filter(|&f| parts.of_face[f] as usize == largest).collect();
    mesh.subset(&keep)
}

/// Connected sets of vertices of one label, in the order of their first vertices; vertices without
/// a label are in none.
pub fn vertex_parts<L: PartialEq>(
    topology: &Topology,
    label: impl Fn(usize) -> Option<L>,
) -> Vec<Vec<usize>> {
    let mut open: Vec<Option<L>> = (0..topology.vertex_count).map(label).collect();
    let mut parts = Vec::new();
    for start in 0..open.len() {
        let Some(label) = open[start].take() else { continue };
        let (mut part, mut at) = (vec![start], 0);
        while at < part.len() {
            for &w in &topology.one_ring[part[at]] {
                let w = w as usize;
                if open[w].as_ref() == Some(&label) {
                    open[w] = None;
                    part.push(w);
                }
            }
            at += 1;
        }
        parts.push(part);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn two_triangles_that_touch_at_a_vertex_are_two() {
        let t = Topology::new(5, vec![[0, 1, 2], [2, 3, 4]]).unwrap();
        assert_eq!(components(&t), Components { count: 2, of_face: vec![0, 1] });
        assert_eq!(components(&shapes::icosphere(1, 1.0).topology).count, 1);
    }

    #[test]
    fn the_largest_piece_keeps_its_order() {
        let p = |x: f64, y: f64| crate::geometry::Point3::new(x, y, 0.0);
        let all = vec![p(9., 9.), p(0., 0.), p(1., 0.), p(0., 1.), p(5., 0.), p(9., 0.), p(5., 9.)];
        let mesh = shapes::mesh(all, vec![[1, 2, 3], [6, 4, 5]]);
        let (part, old) = largest_component(&mesh);
        assert_eq!(old, [4, 5, 6]);
        assert_eq!(part.topology.faces, [[2, 0, 1]]);
    }
}
