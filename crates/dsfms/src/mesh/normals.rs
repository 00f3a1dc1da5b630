//! Area-weighted vertex normals.

use super::{Mesh, Topology};
use crate::geometry::{Point3, Vector3, area_normal};

/// Unit normal of every vertex, the area-weighted mean of its faces' normals (outward for a
/// consistently oriented surface); zero where a vertex has no face.
pub fn vertex_normals(topology: &Topology, positions: &[Point3]) -> Vec<Vector3> {
    normals_of(&topology.faces, positions)
}

/// [`vertex_normals`] of bare faces.
pub(crate) fn normals_of(faces: &[[u32; 3]], positions: &[Point3]) -> Vec<Vector3> {
    let mut normals = vec![Vector3::zeros(); positions.len()];
    for &[a, b, c] in faces {
        let n = area_normal(&positions[a as usize], &positions[b as usize], &positions[c as usize]);
        for v in [a, b, c] {
            normals[v as usize] += n;
        }
    }
    normals.iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect()
}

/// A third of the area of the faces around each vertex.
pub(crate) fn lumped_areas(mesh: &Mesh) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.positions.len()];
    for (face, area) in mesh.topology.faces.iter().zip(mesh.face_areas()) {
        face.iter().for_each(|&v| areas[v as usize] += area / 3.0);
    }
    areas
}
