//! What every front end does with what a user points at: frames of files, folders and videos, the
//! camera file and what it says of a template, masks by name.

use super::{Exploration, Observation, Progress};
use crate::camera::CameraModel;
use crate::image::{Frame, Mask, ToneCurve};
use crate::io::InputError;
use crate::io::camera::{CameraFile, read_camera};
use crate::io::images::{check_camera_size, find_frames, read_frame};
use crate::io::masks::{MaskKind, read_masks};
use crate::template::Template;
use crate::video::{
    SelectOptions, VideoError, VideoFrame, each_frame, frame_name, is_video, select_reporting,
};
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

    /// What the camera file of other frames says of a template: the light where the template knows
    /// none (a bare mesh), and the frames' own lens, which need not be that of the exploration.
    pub(crate) fn tell_template(&self, template: &mut Template) {
        template.light = template.light.take().or_else(|| self.file.light.clone());
        if let Some(a) = self.file.vignetting {
            template.coat.vignetting = a;
        }
    }
}

/// Camera and tone curve of the frames to reconstruct: the given ones, else the template's own;
/// `None` where it has no camera either.
pub fn frames_camera(
    template: &mut Template,
    given: Option<CameraInput>,
    tone: Option<ToneCurve>,
) -> Option<(CameraModel, ToneCurve)> {
    if let Some(input) = given {
        input.tell_template(template);
        return Some((input.file.camera, input.tone));
    }
    let camera = template.camera.clone()?;
    Some((camera, tone.unwrap_or_else(|| template.tone.clone())))
}

/// One frame to work on, not yet decoded where it is a file.
#[derive(Clone, Debug)]
pub enum Source {
    /// An image file.
    File(PathBuf),
    /// A frame of a video, and a reservation: the lost one that it is predicted from.
    Decoded(Frame, Option<String>),
    /// A frame of a video that cannot be decoded: its name, and why.
    Lost(String, String),
}

impl Source {
    /// File stem, or the name that a video frame was given.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) => path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            Self::Decoded(frame, _) => frame.name.clone(),
            Self::Lost(name, _) => name.clone(),
        }
    }

    /// The file a frame came from.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::File(path) => Some(path),
            Self::Decoded(..) | Self::Lost(..) => None,
        }
    }

    /// Decode.
    ///
    /// # Errors
    /// As [`read_frame`]; a lost frame is an [`InputError::Image`].
    pub fn frame(&self) -> Result<Frame, InputError> {
        match self {
            Self::File(path) => read_frame(path),
            Self::Decoded(frame, _) => Ok(frame.clone()),
            Self::Lost(name, reason) => {
                Err(InputError::Image { path: name.into(), reason: reason.clone() })
            }
        }
    }

    /// What else must be said of it.
    pub fn reservation(&self) -> Option<&str> {
        match self {
            Self::Decoded(_, rests_on) => rests_on.as_deref(),
            _ => None,
        }
    }
}

/// Why no list of frames came of what a user pointed at.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// A file or folder.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A video.
    #[error(transparent)]
    Video(#[from] VideoError),
}

/// What frames are wanted for: it decides which frames of a video are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Purpose<'a> {
    /// Sharp frames with parallax between them.
    Template(&'a SelectOptions),
    /// Every frame.
    Reconstruct,
}

/// Frames of files, folders, patterns and videos, in order.
///
/// # Errors
/// A path that does not exist, a folder without frames, a video that cannot be decoded.
pub fn sources(
    inputs: &[PathBuf],
    purpose: Purpose,
    progress: &dyn Progress,
) -> Result<Vec<Source>, SourceError> {
    let mut sources = Vec::new();
    for input in inputs {
        if input.is_file() && is_video(input) {
            sources.extend(video_frames(input, purpose, progress)?);
        } else {
            let found = find_frames(std::slice::from_ref(input))?;
            sources.extend(found.into_iter().map(Source::File));
        }
    }
    Ok(sources)
}

fn video_frames(
    path: &Path,
    purpose: Purpose,
    progress: &dyn Progress,
) -> Result<Vec<Source>, VideoError> {
    let report = |done: usize, total: Option<usize>| {
        progress.step("video", done, total.unwrap_or(done));
    };
    if let Purpose::Template(options) = purpose {
        let mut shown = 0;
        let mut report = |done: usize, total: Option<usize>| {
            shown = shown.max(done);
            report(done, total);
        };
        let frames = select_reporting(path, options, &mut report)?;
        progress.note(&format!("{} frames chosen of {shown}", frames.len()));
        return Ok(frames.into_iter().map(|frame| Source::Decoded(frame, None)).collect());
    }
    let mut sources = Vec::new();
    let read = each_frame(path, &mut |VideoFrame { number, total, content, rests_on }| {
        report(number + 1, total);
        sources.push(match content {
            Ok(frame) => Source::Decoded(frame, rests_on.map(predicted_from)),
            Err(reason) => Source::Lost(frame_name(number), reason),
        });
        true
    });
    match read {
        Err(error) if sources.is_empty() => return Err(error),
        // What was decoded before is not lost.
        Err(error) => sources.push(Source::Lost(frame_name(sources.len()), rest_lost(&error))),
        Ok(()) => {}
    }
    Ok(sources)
}

/// Of a frame that a decoder predicted from a lost one.
pub fn predicted_from(lost: usize) -> String {
    let name = frame_name(lost);
    format!("the picture is predicted from {name}, which is lost: parts of it may be older")
}

/// Of a video that ends too early.
pub fn rest_lost(error: &VideoError) -> String {
    format!("this and all later frames are lost: {error}")
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
    fn a_camera_file_fills_what_the_template_does_not_know() {
        let (mesh, options) = (patch(60, 1).mesh, TemplateOptions::default());
        let mut bare = template_from_mesh(mesh, LengthUnit::Millimetre, None, &options, &Silent);
        assert!(frames_camera(&mut bare, None, None).is_none(), "no camera anywhere");
        let input = CameraInput::new(file(Some(LightModel::Collinear), Some(-0.2)), None);
        let (camera, tone) = frames_camera(&mut bare, Some(input), None).unwrap();
        assert_eq!((camera.size, tone), ([8, 6], ToneCurve::Linear));
        assert_eq!(bare.light, Some(LightModel::Collinear));
        assert_eq!(bare.coat.vignetting, -0.2);
        let asked = CameraInput::new(file(None, None), Some(ToneCurve::Srgb));
        assert_eq!(asked.tone, ToneCurve::Srgb, "what is asked for counts more than the file");
        asked.tell_template(&mut bare);
        assert_eq!(bare.light, Some(LightModel::Collinear), "a known light stays");
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
    }
}
