//! What shape from shading sees.

use crate::camera::CameraModel;
use crate::geometry::Isometry;
use crate::image::{Mask, Plane};
use crate::light::LightModel;
use crate::mesh::Mesh;
use crate::template::SurfaceTexels;

/// What shape from shading sees of one frame.
#[derive(Clone, Copy, Debug)]
pub struct SfsInput<'a> {
    /// Rest surface in the template frame.
    pub mesh: &'a Mesh,
    /// `camera_from_template` of the rigid registration.
    pub pose: Isometry,
    /// Camera of the frame.
    pub camera: &'a CameraModel,
    /// The frame, linear grey in `[0, 1]`.
    pub grey: &'a Plane,
    /// `true` where the organ may be seen (no instrument, inside the organ's outline).
    pub usable: &'a Mask,
    /// `true` where the frame is saturated.
    pub saturated: &'a Mask,
    /// The template's albedo; `None` = the same everywhere.
    pub albedo: Option<&'a SurfaceTexels>,
    /// The light; a near one is moved to the camera's centre.
    pub light: &'a LightModel,
}
