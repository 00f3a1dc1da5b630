//! Area-weighted vertex normals.

use super::{Mesh, Topology};
use crate::geometry::{GRAIN, Point3, Vector3, area_normal};
use rayon::prelude::*;

/// Unit normal of every vertex, the area-weighted mean of its faces' normals (outward for a
/// consistently oriented surface); zero where a vertex has no face.
pub fn vertex_normals(topology: &Topology, positions: &[Point3]) -> Vec<Vector3> {
    let of_faces = face_normals(&topology.faces, positions);
    let of_vertex = |faces: &Vec<u32>| {
        let sum: Vector3 = faces.iter().map(|&f| of_faces[f as usize]).sum();
        sum.try_normalize(0.0).unwrap_or_default()
    };
    topology.vertex_faces.par_iter().with_min_len(GRAIN).map(of_vertex).collect()
}

/// Normal of every face, as long as twice its area.
pub(crate) fn face_normals(faces: &[[u32; 3]], positions: &[Point3]) -> Vec<Vector3> {
    let normal = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|v| &positions[v as usize]);
        area_normal(a, b, c)
    };
    faces.par_iter().with_min_len(GRAIN).map(normal).collect()
}

/// [`vertex_normals`] of bare faces.
pub(crate) fn normals_of(faces: &[[u32; 3]], positions: &[Point3]) -> Vec<Vector3> {
    let mut normals = vec![Vector3::zeros(); positions.len()];
    for (face, normal) in faces.iter().zip(face_normals(faces, positions)) {
        face.iter().for_each(|&v| normals[v as usize] += normal);
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
