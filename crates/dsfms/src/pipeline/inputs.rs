//! What every front end does with the camera file that a user points at, what it says of a
//! template, and with masks by name.

use super::{Exploration, Observation, Progress};
use crate::camera::CameraModel;
use crate::image::{Frame, Mask, ToneCurve};
use crate::io::InputError;
use crate::io::camera::{CameraFile, read_camera};
use crate::io::images::check_camera_size;
use crate::io::masks::{MaskKind, read_masks};
use crate::template::Template;
use std::path::{Path, PathBuf};

/// A camera file with the tone curve that counts.
#[derive(Clone, Debug)]
pub struct CameraInput {
    /// The file.
    pub file: CameraFile,
    /// Tone curve of the frames.
    pub tone: ToneCurve,
}

impl CameraInput {
    /// With the tone curve that is asked for, else the file's, else sRGB.
    pub fn new(file: CameraFile, tone: Option<ToneCurve>) -> Self {
        let tone = tone.or_else(|| file.tone.clone()).unwrap_or_default();
        Self { file, tone }
    }

    /// Read a camera file; `tone` as in [`CameraInput::new`].
    ///
    /// # Errors
    /// As [`read_camera`].
    pub fn read(path: &Path, tone: Option<ToneCurve>) -> Result<Self, InputError> {
        Ok(Self::new(read_camera(path)?, tone))
    }

    /// Frames of this camera at rest.
    pub fn exploration<'a>(&'a self, frames: &'a [Frame]) -> Exploration<'a> {
        let CameraFile { camera, light, vignetting, .. } = &self.file;
        let exploration = Exploration::new(frames, camera).tone(&self.tone);
        exploration.light(light.as_ref()).vignetting(*vignetting)
    }

    /// A deformed frame of this camera.
    pub fn observation<'a>(&'a self, frame: &'a Frame) -> Observation<'a> {
        let CameraFile { camera, light, vignetting, .. } = &self.file;
        let observation = Observation::new(frame, camera).tone(&self.tone);
        observation.light(light.as_ref()).vignetting(*vignetting)
    }

    /// The camera that a template was made with, for frames of the same; `None` where it has none.
    pub fn of_template(template: &Template, tone: Option<ToneCurve>) -> Option<Self> {
        let camera = template.camera.clone()?;
        let tone = tone.unwrap_or_else(|| template.tone.clone());
        let file = CameraFile { camera, tone: None, light: None, vignetting: None };
        Some(Self { file, tone })
    }
}

/// Check a frame against the camera it is said to come from.
///
/// # Errors
/// Another size; the message names the camera's file.
pub fn check_size(frame: &Frame, camera: &CameraModel, path: &Path) -> Result<(), InputError> {
    check_camera_size(std::slice::from_ref(frame), camera.size, path)
}

/// The mask of one frame, by the frame's name or number.
///
/// # Errors
/// No mask for it, or one that cannot be read or has another size.
pub fn mask_of(
    frame: &Frame,
    path: Option<&Path>,
    source: &Path,
    kind: MaskKind,
    progress: &dyn Progress,
) -> Result<Mask, InputError> {
    let paths: Vec<PathBuf> = path.map(Path::to_path_buf).into_iter().collect();
    let (masks, warnings) = read_masks(std::slice::from_ref(frame), &paths, source, kind)?;
    warnings.iter().for_each(|w| progress.warn(&w.to_string()));
    masks.into_iter().next().ok_or_else(|| InputError::Missing(source.into()))
}

#[cfg(test)]
mod tests {
    use super::super::sight::Sight;
    use super::*;
    use crate::light::LightModel;
    use crate::pipeline::{Method, Silent, TemplateOptions, template_from_mesh};
    use crate::synth::{Case, patch};
    use crate::template::LengthUnit;

    fn file(light: Option<LightModel>, vignetting: Option<f64>) -> CameraFile {
        let camera = CameraModel::pinhole([8, 6], [10.0; 2], [3.5, 2.5]);
        CameraFile { camera, tone: Some(ToneCurve::Linear), light, vignetting }
    }

    #[test]
    fn the_camera_of_frames_is_the_given_one_or_the_template_s() {
        let (mesh, options) = (patch(60, 1).mesh, TemplateOptions::default());
        let mut bare = template_from_mesh(mesh, LengthUnit::Millimetre, None, &options, &Silent);
        assert!(CameraInput::of_template(&bare, None).is_none(), "no camera anywhere");
        let given = CameraInput::new(file(None, None), None);
        assert_eq!(given.tone, ToneCurve::Linear);
        let asked = CameraInput::new(file(None, None), Some(ToneCurve::Srgb));
        assert_eq!(asked.tone, ToneCurve::Srgb, "what is asked for counts more than the file");
        (bare.camera, bare.tone) = (Some(given.file.camera), ToneCurve::Linear);
        let own = CameraInput::of_template(&bare, None).unwrap();
        assert_eq!((own.file.camera.size, own.tone), ([8, 6], ToneCurve::Linear));
        assert_eq!(
            CameraInput::of_template(&bare, Some(ToneCurve::Srgb)).unwrap().tone,
            ToneCurve::Srgb
        );
    }

    #[test]
    fn what_a_camera_file_says_goes_with_its_frames() {
        let input = CameraInput::new(file(Some(LightModel::Collinear), Some(-0.1)), None);
        let exploration = input.exploration(&[]);
        assert_eq!(
            (exploration.light, exploration.vignetting),
            (Some(&LightModel::Collinear), Some(-0.1))
        );
        let mut case = Case::example(1);
        case.template.coat.vignetting = -0.3;
        let lit = |observation: &Observation| {
            Sight::new(&case.template, observation, Method::Joint).light
        };
        let own = lit(&input.observation(&case.frame));
        assert_eq!(own.coat.vignetting, -0.1);
        assert_eq!(Some(&own.light), case.template.light.as_ref(), "a known light stays");
        let other = lit(&Observation::new(&case.frame, &case.camera));
        assert_eq!(other.coat.vignetting, -0.3);
        case.template.light = None;
        let told = Sight::new(&case.template, &input.observation(&case.frame), Method::Joint).light;
        assert_eq!(told.light, LightModel::Collinear, "what the template does not know");
    }
}
