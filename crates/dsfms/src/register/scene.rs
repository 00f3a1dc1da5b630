//! What eqs. 3 and 4 share about one frame: the posed rest shape, what of it is seen, and scales.

use super::correspondence::Match;
use crate::camera::CameraModel;
use crate::energy::RestFaces;
use crate::geometry::{Point3, Vector3, align_rigid_robust};
use crate::mesh::Mesh;
use crate::mesh::laplacian::Laplacian;
use crate::raster::{rasterize, visible_vertices};
use std::borrow::Cow;
use std::sync::OnceLock;

/// The posed template in one frame.
pub struct Scene<'a> {
    /// Camera of the frame.
    pub camera: &'a CameraModel,
    /// Rest shape (template frame).
    pub rest: &'a Mesh,
    /// Rest shape in camera axes, rigidly posed: `x₀`.
    pub posed: Vec<Point3>,
    /// Vertices the camera sees of `x₀`.
    pub visible: Vec<bool>,
    /// Area of the rest surface that is seen.
    pub visible_area: f64,
    /// Cotangent Laplacian of the rest shape.
    pub laplacian: Cow<'a, Laplacian>,
    faces: OnceLock<RestFaces>,
}

impl<'a> Scene<'a> {
    /// Look at the posed rest shape.
    pub fn new(camera: &'a CameraModel, rest: &'a Mesh, posed: Vec<Point3>) -> Self {
        let visible = visibility(camera, rest, &posed);
        Self::seen(camera, rest, posed, visible, Cow::Owned(Laplacian::new(rest)))
    }

    /// The posed rest shape where it is known which vertices the camera sees; `laplacian` is that
    /// of the rest shape.
    pub fn seen(
        camera: &'a CameraModel,
        rest: &'a Mesh,
        posed: Vec<Point3>,
        visible: Vec<bool>,
        laplacian: Cow<'a, Laplacian>,
    ) -> Self {
        let total: f64 = laplacian.mass.iter().sum();
        let seen: f64 =
            laplacian.mass.iter().zip(&visible).filter(|(_, v)| **v).map(|(m, _)| m).sum();
        // Less than a tenth of the surface in view is a wrong pose or a close-up; either way the
        // prior must not be blown up without bound.
        let visible_area = seen.max(0.1 * total);
        Self { camera, rest, posed, visible, visible_area, laplacian, faces: OnceLock::new() }
    }

    /// Rest metric, weighted by visible area.
    pub fn faces(&self) -> &RestFaces {
        self.faces.get_or_init(|| RestFaces::new(self.rest, self.visible_area))
    }

    /// The same frame with the rest shape posed again: where most of what is seen of `shape` lies.
    pub fn reposed(&self, shape: &[Point3]) -> Self {
        let seen = || (0..shape.len()).filter(|&v| self.visible[v]);
        let rest: Vec<Point3> = seen().map(|v| self.rest.positions[v]).collect();
        let now: Vec<Point3> = seen().map(|v| shape[v]).collect();
        let posed = match align_rigid_robust(&rest, &now) {
            Some(pose) => self.rest.positions.iter().map(|p| pose * p).collect(),
            None => self.posed.clone(),
        };
        let visible = visibility(self.camera, self.rest, &posed);
        Self::seen(self.camera, self.rest, posed, visible, self.laplacian.clone())
    }

    /// The same frame for a coarser mesh on the vertices `kept`; `laplacian` is that of the mesh.
    pub fn on_some<'b>(
        &self,
        rest: &'b Mesh,
        kept: &[u32],
        laplacian: Cow<'b, Laplacian>,
    ) -> Scene<'b>
    where
        'a: 'b,
    {
        Scene {
            camera: self.camera,
            rest,
            posed: kept.iter().map(|&v| self.posed[v as usize]).collect(),
            visible: kept.iter().map(|&v| self.visible[v as usize]).collect(),
            visible_area: self.visible_area,
            laplacian,
            faces: OnceLock::new(),
        }
    }

    /// Radius of a disc of the visible area: the length scale of the frame.
    pub fn radius(&self) -> f64 {
        (self.visible_area / std::f64::consts::PI).sqrt()
    }

    /// How far the vertices of a shape (camera axes) are from the posed rest shape.
    pub fn displacement(&self, shape: &[Point3]) -> Vec<Vector3> {
        shape.iter().zip(&self.posed).map(|(now, posed)| now - posed).collect()
    }

    /// Corner vertices of a match's face.
    pub fn face(&self, m: &Match) -> [u32; 3] {
        self.rest.topology.faces[m.face as usize]
    }

    /// The surface point of a match on a shape with this topology.
    pub fn point(&self, m: &Match, shape: &[Point3]) -> Point3 {
        self.rest.topology.point(m.face, m.barycentric, shape)
    }
}

/// Which vertices of a shape the camera sees, with a z-buffer tolerance of half an edge.
pub fn visibility(camera: &CameraModel, rest: &Mesh, shape: &[Point3]) -> Vec<bool> {
    let raster = rasterize(camera, &rest.topology, shape);
    visible_vertices(camera, &rest.topology, shape, &raster, 0.5 * rest.mean_edge_length())
}
