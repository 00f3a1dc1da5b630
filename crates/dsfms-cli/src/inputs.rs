//! Reading what a user points at, with the options of the command line.

use crate::args::Global;
use anyhow::Context;
use dsfms::camera::CameraModel;
use dsfms::guard;
use dsfms::image::Frame;
use dsfms::io::InputError;
use dsfms::io::images::{find_frames, read_size};
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::io::matches::{all_matches, find_matches, read_matches};
pub use dsfms::pipeline::inputs::{CameraInput, check_size, mask_of};
pub use dsfms::pipeline::sources::{
    Purpose, Source, each_source, predicted_from, rest_lost, sources,
};
use dsfms::template::Template;
use dsfms::video::{each_frame, is_video};
use std::path::{Path, PathBuf};

/// Read `--camera`; `--tone` counts more than what the file says.
pub fn camera(path: &Path, global: &Global) -> anyhow::Result<CameraInput> {
    CameraInput::read(path, global.tone.map(Into::into)).context("camera file")
}

/// Read an options file.
pub fn options<T, E>(path: &Path, parse: impl FnOnce(&str) -> Result<T, E>) -> anyhow::Result<T>
where
    E: std::error::Error + Send + Sync + 'static,
{
    let text = guard::read_text_at_most(path, guard::MOST_OPTIONS_BYTES)
        .with_context(|| format!("cannot read the options file {}", path.display()))?;
    parse(&text).with_context(|| format!("{} is not a valid options file", path.display()))
}

/// Camera of frames of the deformed organ: of `--camera`, or else of the template.
pub fn frame_camera(
    path: Option<&Path>,
    global: &Global,
    template: &Template,
) -> anyhow::Result<CameraInput> {
    match path {
        Some(path) => camera(path, global),
        None => CameraInput::of_template(template, global.tone.map(Into::into))
            .context("the template holds no camera; give the frames' camera with --camera"),
    }
}

/// Images that are looked at before the work.
const LOOKED_AT: usize = 3;

/// Refuse, before anything is written, frames of which none can be used: files that are no images,
/// images that are all of another size than the camera. That is one mistake, told once; a few that
/// differ fail on their own.
pub fn check_sizes(sources: &[Source], camera: &CameraModel, path: &Path) -> anyhow::Result<()> {
    let mut sizes = Vec::new();
    let mut unread = None;
    for source in some(sources.iter().filter(|s| !matches!(s, Source::Lost(..)))) {
        match source.size() {
            Ok(size) => sizes.push((source, size)),
            Err(error) => unread = unread.or(Some(error)),
        }
    }
    match (sizes.first(), unread) {
        (None, Some(error)) => Err(error).context(NO_IMAGE),
        (Some(&(source, found)), _) if sizes.iter().all(|s| s.1 != camera.size) => {
            let file = source.path().and_then(Path::file_name);
            let frame = file.map_or(source.name(), |name| name.to_string_lossy().into_owned());
            let (path, expected) = (path.into(), camera.size);
            Err(InputError::CameraSize { frame, found, path, expected }.into())
        }
        _ => Ok(()),
    }
}

/// What is said of a file that is given as a frame.
const NO_IMAGE: &str = "neither a video nor an image";

/// A few, evenly spaced.
fn some<T>(all: impl Iterator<Item = T>) -> impl Iterator<Item = T> {
    let all: Vec<T> = all.collect();
    let every = all.len().div_ceil(LOOKED_AT).max(1);
    all.into_iter().step_by(every)
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

/// Refuse, before anything is written, match files of which none that is looked at can be used.
/// `faces` of the template; pixels must lie in the camera's image.
pub fn check_matches(
    sources: &[Source],
    matches: Option<&Path>,
    faces: usize,
    camera: &CameraModel,
) -> Result<(), InputError> {
    let Some(matches) = matches else { return Ok(()) };
    // A folder without any is refused before what it lacks for a frame.
    all_matches(matches)?;
    let read =
        |source: &Source| read_matches(&find_matches(matches, &source.name())?, faces, camera.size);
    let found: Vec<_> = some(sources.iter()).map(read).collect();
    match found.iter().all(Result::is_err) {
        true => found.into_iter().next().map_or(Ok(()), |first| first.map(drop)),
        false => Ok(()),
    }
}

/// A few image files and their sizes; what cannot be read is told with its frame.
fn looked_at(sources: &[Source]) -> Vec<(&Path, [usize; 2])> {
    let files = some(sources.iter().filter_map(Source::path));
    files.filter_map(|file| Some((file, read_size(file).ok()?))).collect()
}

/// Look at what a video is to be read from: a file must be an image or a video, of which the first
/// frame is decoded. Streams are told of by their readers.
pub fn look(inputs: &[PathBuf]) -> anyhow::Result<Vec<Source>> {
    let mut sources = Vec::new();
    let local = |path: &&PathBuf| !path.to_string_lossy().contains("://");
    for input in inputs.iter().filter(local) {
        if input.is_file() && is_video(input) {
            sources.extend(first_frame(input)?);
            continue;
        }
        for file in find_frames(std::slice::from_ref(input))? {
            if file == *input {
                read_size(input).context(NO_IMAGE)?;
            }
            sources.push(Source::File(file));
        }
    }
    Ok(sources)
}

/// The first frame of a video, where it can be decoded.
fn first_frame(path: &Path) -> anyhow::Result<Option<Source>> {
    let mut first = None;
    each_frame(path, &mut |frame| {
        first = frame.content.ok().map(|frame| Source::Decoded(frame, None));
        false
    })?;
    Ok(first)
}

/// A path that must be there before any work begins.
pub fn must_exist(path: &Path, option: &str) -> anyhow::Result<()> {
    match path.exists() {
        true => Ok(()),
        false => Err(InputError::Missing(path.into())).context(option.to_string()),
    }
}
