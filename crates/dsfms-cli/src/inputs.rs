//! Reading what a user points at: frames, cameras, masks, with warnings in plain words.

use crate::args::Global;
use anyhow::Context;
use dsfms::camera::CameraModel;
use dsfms::image::{Frame, Mask, ToneCurve};
use dsfms::io::InputError;
use dsfms::io::camera::{CameraFile, read_camera};
use dsfms::io::images::{check_camera_size, find_frames, read_frame, read_size};
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::pipeline::Progress;
use dsfms::template::Template;
use dsfms::video::{
    VideoError, VideoFrame, VideoOptions, each_frame, frame_name, is_video, select_reporting,
};
use std::path::{Path, PathBuf};

/// A camera file with the tone curve that counts: `--tone`, else the file's, else sRGB.
pub struct CameraInput {
    pub file: CameraFile,
    pub tone: ToneCurve,
}

/// Read `--camera`.
pub fn camera(path: &Path, global: &Global) -> anyhow::Result<CameraInput> {
    let file = read_camera(path).context("camera file")?;
    let tone = match global.tone {
        Some(tone) => tone.into(),
        None => file.tone.clone().unwrap_or_default(),
    };
    Ok(CameraInput { file, tone })
}

/// One frame to work on, not yet decoded where it is a file.
pub enum Source {
    File(PathBuf),
    /// A frame of a video, and the lost one that it is predicted from.
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

/// Frames of files, folders, patterns and videos, in order.
pub fn sources(
    inputs: &[PathBuf],
    purpose: Purpose,
    progress: &dyn Progress,
) -> anyhow::Result<Vec<Source>> {
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
) -> anyhow::Result<Vec<Source>> {
    let mut report = |done: usize, total: Option<usize>| {
        progress.step("video", done, total.unwrap_or(done));
    };
    if purpose == Purpose::Template {
        let frames = select_reporting(path, &VideoOptions::default(), &mut report)?;
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
        Err(error) if sources.is_empty() => return Err(error.into()),
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

/// What frames are wanted for: it decides which frames of a video are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Sharp frames with parallax between them.
    Template,
    /// Every frame.
    Reconstruct,
}

/// Read an options file.
pub fn options<T, E>(path: &Path, parse: impl FnOnce(&str) -> Result<T, E>) -> anyhow::Result<T>
where
    E: std::error::Error + Send + Sync + 'static,
{
    let text = dsfms::guard::read_text(path)
        .with_context(|| format!("cannot read the options file {}", path.display()))?;
    parse(&text).with_context(|| format!("{} is not a valid options file", path.display()))
}

/// Camera and tone curve of frames of the deformed organ: of the file, or else of the template. The
/// file's lens and, where the template knows none, its light become the template's.
pub fn frame_camera(
    path: Option<&Path>,
    global: &Global,
    template: &mut Template,
) -> anyhow::Result<(CameraModel, ToneCurve)> {
    if let Some(path) = path {
        let input = camera(path, global)?;
        // A template of a bare mesh knows no light; the camera file may.
        template.light = template.light.take().or(input.file.light);
        // The frames' own lens, which need not be that of the exploration.
        if let Some(a) = input.file.vignetting {
            template.coat.vignetting = a;
        }
        return Ok((input.file.camera, input.tone));
    }
    let camera = template.camera.clone();
    let camera =
        camera.context("the template holds no camera; give the frames' camera with --camera")?;
    Ok((camera, global.tone.map_or(template.tone.clone(), Into::into)))
}

/// Check a frame against the camera it is said to come from.
pub fn check_size(frame: &Frame, camera: &CameraModel, path: &Path) -> Result<(), InputError> {
    check_camera_size(std::slice::from_ref(frame), camera.size, path)
}

/// Images that are looked at before the work.
const LOOKED_AT: usize = 3;

/// Refuse, before anything is written, images that are all of another size than the camera: that is one
/// mistake, told once. A few that differ fail on their own.
pub fn check_sizes(sources: &[Source], camera: &CameraModel, path: &Path) -> anyhow::Result<()> {
    let sizes = looked_at(sources);
    match sizes.first() {
        Some(&(file, found)) if sizes.iter().all(|s| s.1 != camera.size) => {
            let frame = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let (path, expected) = (path.into(), camera.size);
            Err(InputError::CameraSize { frame, found, path, expected }.into())
        }
        _ => Ok(()),
    }
}

/// Refuse, before anything is written, masks of which none that is looked at can be used.
pub fn check_masks(
    sources: &[Source],
    masks: Option<&Path>,
    kind: MaskKind,
) -> Result<(), InputError> {
    let Some(masks) = masks else { return Ok(()) };
    let read = |(file, size): (&Path, [usize; 2])| {
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let frame = Frame { name, size, rgb: Vec::new() };
        read_masks(std::slice::from_ref(&frame), &[file.into()], masks, kind).map(|_| ())
    };
    let found: Vec<Result<(), InputError>> = looked_at(sources).into_iter().map(read).collect();
    match found.iter().all(Result::is_err) {
        true => found.into_iter().next().unwrap_or(Ok(())),
        false => Ok(()),
    }
}

/// A few image files and their sizes; what cannot be read is told with its frame.
fn looked_at(sources: &[Source]) -> Vec<(&Path, [usize; 2])> {
    let files: Vec<&Path> = sources.iter().filter_map(Source::path).collect();
    let every = files.len().div_ceil(LOOKED_AT).max(1);
    let mut found = Vec::new();
    for file in files.into_iter().step_by(every) {
        found.extend(read_size(file).ok().map(|size| (file, size)));
    }
    found
}

/// Look at what a video is to be read from: a file must be an image or a video. Streams and folders that
/// hold no images (recordings) are told of by their readers.
pub fn look(inputs: &[PathBuf]) -> anyhow::Result<Vec<Source>> {
    let mut sources = Vec::new();
    let local = |path: &&PathBuf| !path.to_string_lossy().contains("://");
    for input in inputs.iter().filter(local).filter(|path| !is_video(path)) {
        if input.is_dir() {
            let files = find_frames(std::slice::from_ref(input)).unwrap_or_default();
            sources.extend(files.into_iter().map(Source::File));
            continue;
        }
        for file in find_frames(std::slice::from_ref(input))? {
            if file == *input {
                read_size(input).context("neither a video nor an image")?;
            }
            sources.push(Source::File(file));
        }
    }
    Ok(sources)
}

/// A path that must be there before any work begins.
pub fn must_exist(path: &Path, option: &str) -> anyhow::Result<()> {
    match path.exists() {
        true => Ok(()),
        false => Err(InputError::Missing(path.into())).context(option.to_string()),
    }
}

/// The mask of one frame.
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
    use super::*;
    use dsfms::camera::Lens;
    use dsfms::io::camera::write_camera;
    use dsfms::light::{LightModel, PointLight, Spot};
    use dsfms::pipeline::{Silent, TemplateOptions, template_from_mesh};
    use dsfms::template::LengthUnit;

    /// Both `reconstruct` and `track` take camera, lens and light from here.
    #[test]
    fn a_template_without_light_takes_that_of_the_camera_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.json");
        let light = LightModel::Point(PointLight {
            positions: vec![dsfms::geometry::Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Isotropic,
        });
        let camera = CameraModel {
            size: [64, 48],
            focal: [60.0; 2],
            centre: [31.5, 23.5],
            lens: Lens::Pinhole,
        };
        let (light, vignetting) = (Some(light), Some(-0.2));
        write_camera(&path, &CameraFile { camera, tone: None, light, vignetting }).unwrap();
        let mesh = dsfms::synth::patch(60, 1).mesh;
        let options = TemplateOptions::default();
        let mut template =
            template_from_mesh(mesh, LengthUnit::Millimetre, None, &options, &Silent);
        let progress = crate::progress::ProgressKind::Auto;
        let global = Global { threads: None, seed: 0, progress, quiet: true, tone: None };
        assert!(frame_camera(None, &global, &mut template).is_err());
        frame_camera(Some(&path), &global, &mut template).unwrap();
        assert!(matches!(template.light, Some(LightModel::Point(_))));
        assert_eq!(template.coat.vignetting, -0.2);
        // One that was measured stays.
        template.light = Some(LightModel::Collinear);
        frame_camera(Some(&path), &global, &mut template).unwrap();
        assert_eq!(template.light, Some(LightModel::Collinear));
    }
}
