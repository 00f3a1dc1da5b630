//! What a shape is compared with: the picture of one frame, its light and the albedo.

use crate::camera::CameraModel;
use crate::image::{Mask, Outline, Picture};
use crate::light::Coated;
use crate::template::{Exposure, SurfaceTexels};

/// The photometric side of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Photograph<'a> {
    /// Camera of the frame.
    pub camera: &'a CameraModel,
    /// Linear light.
    pub picture: &'a Picture,
    /// `true` where the organ may be seen (no instrument, inside the organ's mask or outline if
    /// there is one).
    pub usable: &'a Mask,
    /// Where the organ ends, if a mask or its colours say.
    pub outline: Option<&'a Outline>,
    /// Light of the frame.
    pub light: &'a Coated,
    /// Albedo of the template.
    pub albedo: &'a SurfaceTexels,
    /// What the exploration tells of the exposure; `None` without one.
    pub exposure: Option<Exposure>,
}
