//! What the stages read of one frame.

use super::{Method, Observation, ReconstructError};
use crate::camera::Camera;
use crate::image::{Mask, Outline, Picture, usable, viewport};
use crate::light::Coated;
use crate::refine::Photograph;
use crate::register::Match;
use crate::register::find::Search;
use crate::sfm::{Features2d, SfmOptions, detect};
use crate::template::{SurfaceTexels, Template};

/// The descriptors of a template, and those of a frame.
pub(super) struct Described<'a> {
    pub(super) search: Search<'a>,
    pub(super) seen: Features2d,
}

/// What the stages read of one frame, made once.
pub(super) struct Sight<'a> {
    pub(super) template: &'a Template,
    pub(super) observation: &'a Observation<'a>,
    /// Pixels where the organ may be seen.
    pub(super) usable: Mask,
    /// Where the organ ends, if a mask says and the method asks.
    pub(super) outline: Option<Outline>,
    pub(super) light: Coated,
    /// The frame beside the albedo, where there is one.
    pub(super) compared: Option<(Picture, &'a SurfaceTexels)>,
}

impl<'a> Sight<'a> {
    pub(super) fn new(
        template: &'a Template,
        observation: &'a Observation,
        method: Method,
    ) -> Self {
        let Observation { frame, tone, light, vignetting, instrument, organ, .. } = *observation;
        let lit = viewport(std::slice::from_ref(frame));
        let albedo = template.albedo.as_ref();
        Self {
            template,
            observation,
            usable: usable(frame.size, lit, instrument, organ),
            outline: organ
                .filter(|_| method == Method::Joint)
                .map(|organ| Outline::new(organ, instrument)),
            light: template.lighting_of(light, vignetting),
            compared: albedo.map(|albedo| (Picture::of(frame, tone), albedo)),
        }
    }

    /// Descriptors, where the template has some.
    pub(super) fn described(&self) -> Option<Described<'a>> {
        let search = Search::new(&self.template.mesh, self.template.features.as_ref()?);
        let seen = detect(self.observation.frame, Some(&self.usable), &SfmOptions::of_frames());
        Some(Described { search, seen })
    }

    pub(super) fn photograph(&self) -> Option<Photograph<'_>> {
        let (picture, albedo) = self.compared.as_ref()?;
        Some(Photograph {
            camera: self.observation.camera,
            picture,
            usable: &self.usable,
            outline: self.outline.as_ref(),
            light: &self.light,
            albedo,
            exposure: self.template.exposure(),
        })
    }
}

/// Whether a method can begin with what there is.
pub(super) fn check(
    template: &Template,
    observation: &Observation,
    method: Method,
) -> Result<(), ReconstructError> {
    let (found, expected) = (observation.frame.size, observation.camera.size());
    if found != expected {
        return Err(ReconstructError::SizeMismatch { found, expected });
    }
    let masks = [("instrument mask", observation.instrument), ("organ mask", observation.organ)];
    for (what, mask) in masks {
        if let Some(found) = mask.map(|mask| mask.size).filter(|size| *size != expected) {
            return Err(ReconstructError::MaskSize { what, found, expected });
        }
    }
    let faces = template.mesh.topology.faces.len();
    let beyond = |m: &Match| m.face as usize >= faces;
    let matches = observation.matches.unwrap_or_default();
    if let Some(index) = matches.iter().position(beyond) {
        return Err(ReconstructError::MatchFace { index, face: matches[index].face, faces });
    }
    let brightest = observation.frame.rgb.iter().flatten().copied().max().unwrap_or(0);
    if brightest < 16 {
        return Err(ReconstructError::Black(brightest));
    }
    if matches!(method, Method::Sfs | Method::Dsfms | Method::Joint) && template.albedo.is_none() {
        return Err(ReconstructError::NoAlbedo(method));
    }
    Ok(())
}
