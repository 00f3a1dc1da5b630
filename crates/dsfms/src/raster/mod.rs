//! Z-buffer rasteriser: depth, face and barycentrics of every pixel; vertex visibility.

use crate::camera::CameraModel;
use crate::geometry::Point3;
use crate::mesh::Topology;

/// What the camera sees of a surface, per pixel, row major.
#[derive(Clone, Debug)]
pub struct Raster {
    /// Width and height in px.
    pub size: [usize; 2],
    /// Depth z of the nearest surface point, length units; infinity where there is none.
    pub depth: Vec<f64>,
    /// Its face; `u32::MAX` where there is none.
    pub face: Vec<u32>,
    /// Its barycentrics on the face (perspective-correct: they weight 3D corners).
    pub barycentric: Vec<[f64; 3]>,
}

/// Render the surface (positions in camera axes) at every pixel centre; both sides of a face are
/// drawn. Faces with a corner that does not project are skipped.
pub fn rasterize(_camera: &CameraModel, _topology: &Topology, _positions: &[Point3]) -> Raster {
    todo!()
}

/// Which vertices the camera sees: projected inside the image, some face around them turned to the
/// camera, and not behind the z-buffer by more than `tolerance` length units.
pub fn visible_vertices(
    _camera: &CameraModel,
    _topology: &Topology,
    _positions: &[Point3],
    _raster: &Raster,
    _tolerance: f64,
) -> Vec<bool> {
    todo!()
}
