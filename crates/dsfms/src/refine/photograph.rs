//! What a shape is compared with: the picture of one frame, its light and the albedo.

use crate::camera::CameraModel;
use crate::image::picture::is_grey;
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

/// Texels, about, that tell whether an albedo has colours.
const ENOUGH: usize = 2000;

impl Photograph<'_> {
    /// Whether the picture is grey and the template is not: it was taken by another camera.
    pub(crate) fn lost_colour(&self) -> bool {
        let texels = &self.albedo.value;
        let some = texels.iter().step_by(texels.len().div_ceil(ENOUGH).max(1));
        self.picture.grey && !is_grey(some)
    }

    /// What is expected of the exposure: nothing where colour was lost, since what another spectrum
    /// makes of tissue is no exposure (`docs/results/exposure.md`).
    pub(super) fn told_exposure(&self) -> Option<Exposure> {
        self.exposure.filter(|_| !self.lost_colour())
    }
}
