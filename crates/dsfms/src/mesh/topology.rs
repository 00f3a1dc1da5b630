//! Connectivity: faces, edges, one-rings, boundary. Holds no position.

use crate::geometry::{Point3, point_at};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Connectivity of an oriented, edge-manifold triangle mesh; vertex and face order are the file's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topology {
    /// Number of vertices; those that no face uses are allowed and stay in every output.
    pub vertex_count: usize,
    /// Corner vertices of each face, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Undirected edges `[a, b]`, `a < b`, in lexicographic order.
    pub edges: Vec<[u32; 2]>,
    /// The one or two faces of each edge; the second is `u32::MAX` on the boundary.
    pub edge_faces: Vec<[u32; 2]>,
    /// Neighbour vertices of each vertex, ascending, without itself.
    pub one_ring: Vec<Vec<u32>>,
    /// Faces around each vertex, ascending.
    pub vertex_faces: Vec<Vec<u32>>,
    /// Whether the vertex lies on a boundary edge.
    pub boundary: Vec<bool>,
}

/// Why a face list is not a usable surface.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TopologyError {
    /// The file held no triangle.
    #[error("the mesh has no faces; expected a triangle mesh")]
    NoFaces,
    /// A corner index past the vertex list.
    #[error(
        "face {face} names vertex {vertex}, but the mesh has {count} vertices (indices start at 0)"
    )]
    VertexOutOfRange {
        /// 0-based face.
        face: usize,
        /// The index found.
        vertex: u32,
        /// Vertices in the mesh.
        count: usize,
    },
    /// A face that uses one vertex twice.
    #[error("face {face} uses vertex {vertex} twice; remove degenerate faces first")]
    DegenerateFace {
        /// 0-based face.
        face: usize,
        /// The repeated vertex.
        vertex: u32,
    },
    /// Two faces with the same three corners.
    #[error("faces {first} and {second} have the same three corners; remove duplicate faces first")]
    DuplicateFace {
        /// 0-based face.
        first: usize,
        /// 0-based face.
        second: usize,
    },
    /// An edge with three or more faces.
    #[error(
        "edge {a}-{b} is shared by {count} faces: the mesh is not manifold; repair it (MeshLab: 'Repair non manifold edges')"
    )]
    NonManifoldEdge {
        /// Vertex of the edge.
        a: u32,
        /// Vertex of the edge.
        b: u32,
        /// Faces that share it.
        count: usize,
    },
    /// Neighbouring faces wound against each other.
    #[error(
        "faces {first} and {second} run along edge {a}-{b} in the same direction: orient the faces consistently first"
    )]
    InconsistentOrientation {
        /// 0-based face.
        first: usize,
        /// 0-based face.
        second: usize,
        /// Vertex of the edge.
        a: u32,
        /// Vertex of the edge.
        b: u32,
    },
}

impl Topology {
    /// Build and check: indices in range, no degenerate or duplicate face, at most two faces per
    /// edge, consistently oriented.
    ///
    /// # Errors
    /// The first face or edge that breaks one of these rules.
    pub fn new(vertex_count: usize, faces: Vec<[u32; 3]>) -> Result<Self, TopologyError> {
        check_faces(vertex_count, &faces)?;
        let by_edge = faces_by_edge(&faces);
        by_edge.chunk_by(same_edge).try_for_each(check_edge)?;
        Ok(Self::assemble(vertex_count, faces, &by_edge))
    }

    /// The point at barycentrics of a face, on a shape: a position for every vertex of this
    /// topology.
    pub fn point(&self, face: u32, barycentric: [f64; 3], shape: &[Point3]) -> Point3 {
        point_at(self.faces[face as usize].map(|v| &shape[v as usize]), barycentric)
    }

    /// Build from faces already known to be good, such as a part of a checked surface.
    pub(crate) fn from_checked(vertex_count: usize, faces: Vec<[u32; 3]>) -> Self {
        let by_edge = faces_by_edge(&faces);
        Self::assemble(vertex_count, faces, &by_edge)
    }

    fn assemble(vertex_count: usize, faces: Vec<[u32; 3]>, by_edge: &[EdgeUse]) -> Self {
        let (mut edges, mut edge_faces) = (Vec::new(), Vec::new());
        let mut boundary = vec![false; vertex_count];
        let mut one_ring = vec![Vec::new(); vertex_count];
        for users in by_edge.chunk_by(same_edge) {
            let [a, b] = users[0].edge;
            edges.push([a, b]);
            edge_faces.push([users[0].face, users.get(1).map_or(u32::MAX, |u| u.face)]);
            one_ring[a as usize].push(b);
            one_ring[b as usize].push(a);
            if users.len() == 1 {
                boundary[a as usize] = true;
                boundary[b as usize] = true;
            }
        }
        one_ring.iter_mut().for_each(|ring| ring.sort_unstable());
        let mut vertex_faces = vec![Vec::new(); vertex_count];
        for (f, face) in faces.iter().enumerate() {
            face.iter().for_each(|&v| vertex_faces[v as usize].push(f as u32));
        }
        Self { vertex_count, faces, edges, edge_faces, one_ring, vertex_faces, boundary }
    }

    /// Place of the edge between two vertices in `edges`; `None` where there is none.
    pub(crate) fn edge_index(&self, a: u32, b: u32) -> Option<usize> {
        self.edges.binary_search(&[a.min(b), a.max(b)]).ok()
    }

    /// The face on the other side of an edge of `face`; `None` on the boundary.
    pub fn across(&self, edge: usize, face: u32) -> Option<u32> {
        let [f, g] = self.edge_faces[edge];
        let other = if f == face { g } else { f };
        (other != u32::MAX).then_some(other)
    }

    /// The corners of an edge's two faces: the edge a→b of the first, its apex c, and the apex d of
    /// the second; `None` on the boundary.
    pub(crate) fn quad(&self, edge: usize) -> Option<[u32; 4]> {
        let ([f, g], ends) = (self.edge_faces[edge], self.edges[edge]);
        if g == u32::MAX {
            return None;
        }
        let face = self.faces[f as usize];
        let k = (0..3).find(|&k| !ends.contains(&face[k]))?;
        let d = *self.faces[g as usize].iter().find(|v| !ends.contains(v))?;
        Some([face[(k + 1) % 3], face[(k + 2) % 3], face[k], d])
    }

    /// `V − E + F` over the vertices that faces use: 1 for a disc, 2 for a closed sphere.
    pub fn euler_characteristic(&self) -> i64 {
        let used = self.vertex_faces.iter().filter(|f| !f.is_empty()).count();
        used as i64 - self.edges.len() as i64 + self.faces.len() as i64
    }
}

fn check_faces(vertex_count: usize, faces: &[[u32; 3]]) -> Result<(), TopologyError> {
    if faces.is_empty() {
        return Err(TopologyError::NoFaces);
    }
    let mut seen = BTreeMap::new();
    for (f, face) in faces.iter().enumerate() {
        if let Some(&vertex) = face.iter().find(|&&v| v as usize >= vertex_count) {
            return Err(TopologyError::VertexOutOfRange { face: f, vertex, count: vertex_count });
        }
        let [a, b, c] = *face;
        if a == b || b == c || c == a {
            let vertex = if b == c { b } else { a };
            return Err(TopologyError::DegenerateFace { face: f, vertex });
        }
        let mut key = *face;
        key.sort_unstable();
        if let Some(first) = seen.insert(key, f) {
            return Err(TopologyError::DuplicateFace { first, second: f });
        }
    }
    Ok(())
}

/// One side of an undirected edge; `forward` = the face runs from the smaller vertex.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct EdgeUse {
    edge: [u32; 2],
    face: u32,
    forward: bool,
}

fn same_edge(a: &EdgeUse, b: &EdgeUse) -> bool {
    a.edge == b.edge
}

/// All sides of all edges, those of one edge together, by face.
fn faces_by_edge(faces: &[[u32; 3]]) -> Vec<EdgeUse> {
    let mut uses: Vec<EdgeUse> = faces
        .iter()
        .zip(0..)
        .flat_map(|(&[a, b, c], face)| {
            [(a, b), (b, c), (c, a)].map(|(from, to)| EdgeUse {
                edge: [from.min(to), from.max(to)],
                face,
                forward: from < to,
            })
        })
        .collect();
    // No two are equal: the order does not depend on the threads.
    uses.par_sort_unstable();
    uses
}

fn check_edge(users: &[EdgeUse]) -> Result<(), TopologyError> {
    let [a, b] = users[0].edge;
    match users {
        [_] => Ok(()),
        [first, second] if first.forward != second.forward => Ok(()),
        [first, second] => Err(TopologyError::InconsistentOrientation {
            first: first.face as usize,
            second: second.face as usize,
            a,
            b,
        }),
        _ => Err(TopologyError::NonManifoldEdge { a, b, count: users.len() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_triangles_by_hand() {
        let t = Topology::new(4, vec![[0, 1, 2], [2, 1, 3]]).unwrap();
        assert_eq!(t.edges.len(), 5);
        assert_eq!(t.edge_faces[t.edges.iter().position(|e| e == &[1, 2]).unwrap()], [0, 1]);
        assert_eq!(t.one_ring[1], [0, 2, 3]);
        assert_eq!(t.euler_characteristic(), 1);
        assert!(t.boundary.iter().all(|&b| b));
    }

    #[test]
    fn names_what_is_wrong() {
        use TopologyError::*;
        assert_eq!(Topology::new(3, vec![]), Err(NoFaces));
        assert!(matches!(
            Topology::new(2, vec![[0, 1, 2]]),
            Err(VertexOutOfRange { vertex: 2, .. })
        ));
        assert!(matches!(Topology::new(3, vec![[0, 1, 1]]), Err(DegenerateFace { vertex: 1, .. })));
        assert!(matches!(Topology::new(3, vec![[0, 1, 2], [1, 2, 0]]), Err(DuplicateFace { .. })));
        assert!(matches!(
            Topology::new(4, vec![[0, 1, 2], [1, 2, 3]]),
            Err(InconsistentOrientation { .. })
        ));
        assert!(matches!(
            Topology::new(5, vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
            Err(NonManifoldEdge { count: 3, .. })
        ));
    }
}
