//! What is laid on what: points of the template, and the preoperative surface under them.

use crate::geometry::{Point3, Vector3, normal, point_at};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;
use crate::mesh::surface_points::{ClosestPoints, SurfacePoint};
use crate::template::even_points;

/// A point of the template's surface and its unit normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    /// Template frame.
    pub point: Point3,
    /// Mean of the corners' normals: reconstructed faces are rough.
    pub normal: Vector3,
}

/// `count` points of a surface, evenly spread by area; fewer where normals cancel.
pub fn samples(mesh: &Mesh, count: usize) -> Vec<SurfaceSample> {
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let of = |(face, w): (usize, [f64; 3])| {
        let corners = mesh.topology.faces[face];
        let sum: Vector3 = corners.iter().zip(w).map(|(&v, w)| normals[v as usize] * w).sum();
        Some(SurfaceSample {
            point: point_at(mesh.corners(face), w),
            normal: sum.try_normalize(0.0)?,
        })
    };
    even_points(mesh, count).into_iter().filter_map(of).collect()
}

/// Smallest cosine between the normals of a point and of the place it is laid on.
const MIN_COSINE: f64 = 0.3;

/// The preoperative surface.
pub struct Target<'a> {
    /// The surface.
    pub mesh: &'a Mesh,
    closest: ClosestPoints<'a>,
}

/// Where a point is laid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Unit vector in which the distance grows.
    pub direction: Vector3,
    pub distance: f64,
    pub place: SurfacePoint,
}

impl<'a> Target<'a> {
    /// Of an oriented surface.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, closest: ClosestPoints::new(mesh) }
    }

    /// The nearest place, unless it lies on an edge of the surface (the point is beyond it) or
    /// faces another way.
    pub(super) fn hit(&self, point: &Point3, facing: &Vector3) -> Option<Hit> {
        let place = self.closest.closest(point)?;
        let [a, b, c] = self.mesh.corners(place.face as usize);
        let face_normal = normal(a, b, c)?;
        if face_normal.dot(facing) <= MIN_COSINE || self.on_boundary(&place) {
            return None;
        }
        let away = point - place.point;
        // On the surface itself the direction is that of the normal.
        let sign = if away.dot(&face_normal) < 0.0 { -1.0 } else { 1.0 };
        let direction = away.try_normalize(1e-12).unwrap_or(face_normal * sign);
        Some(Hit { direction, distance: place.distance, place })
    }

    fn on_boundary(&self, place: &SurfacePoint) -> bool {
        /// Rounding of a barycentric.
        const ZERO: f64 = 1e-9;
        let topology = &self.mesh.topology;
        let face = topology.faces[place.face as usize];
        let on: Vec<u32> =
            (0..3).filter(|&k| place.barycentric[k] > ZERO).map(|k| face[k]).collect();
        match on[..] {
            [v] => topology.boundary[v as usize],
            [a, b] => {
                topology.edge_index(a, b).is_some_and(|e| topology.edge_faces[e][1] == u32::MAX)
            }
            _ => false,
        }
    }
}

/// Mean, and root mean square distance from it.
pub(super) fn extent<'p>(points: impl Iterator<Item = &'p Point3> + Clone) -> (Point3, f64) {
    let count = points.clone().count().max(1) as f64;
    let mean = Point3::from(points.clone().map(|p| p.coords).sum::<Vector3>() / count);
    let square = points.map(|p| (p - mean).norm_squared()).sum::<f64>() / count;
    (mean, square.sqrt())
}
