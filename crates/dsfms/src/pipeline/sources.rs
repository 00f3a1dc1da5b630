//! Frames of the files, folders and videos that a user points at.
//!
//! Frames of a video to reconstruct are listed first and decoded once more one by one
//! ([`each_source`]): a video of any length takes the memory of the few frames that are worked on.

use super::Progress;
use crate::image::Frame;
use crate::io::InputError;
use crate::io::images::{find_frames, read_frame, read_size};
use crate::video::{
    SelectOptions, VideoError, VideoFrame, each_frame, frame_name, is_video, select_reporting,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// One frame to work on, not yet decoded where it is a file.
#[derive(Clone, Debug)]
pub enum Source {
    /// An image file.
    File(PathBuf),
    /// A frame of a video.
    Video(VideoPlace),
    /// A decoded frame, and a reservation: the lost one that it is predicted from.
    Decoded(Frame, Option<String>),
    /// A frame of a video that cannot be decoded: its name, and why.
    Lost(String, String),
}

/// Where a frame lies in a video that was decoded once.
#[derive(Clone, Debug, PartialEq)]
pub struct VideoPlace {
    video: Arc<Path>,
    /// In display order, from 0.
    number: usize,
    /// Width and height in px.
    size: [usize; 2],
}

impl Source {
    /// File stem, or the name that a video frame was given.
    pub fn name(&self) -> String {
        match self {
            Self::File(path) => path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            Self::Video(place) => frame_name(place.number),
            Self::Decoded(frame, _) => frame.name.clone(),
            Self::Lost(name, _) => name.clone(),
        }
    }

    /// The image file a frame came from.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::File(path) => Some(path),
            _ => None,
        }
    }

    /// Width and height in px, of an image file by its head.
    ///
    /// # Errors
    /// As [`read_size`]; a lost frame is an [`InputError::Image`].
    pub fn size(&self) -> Result<[usize; 2], InputError> {
        match self {
            Self::File(path) => read_size(path),
            Self::Video(place) => Ok(place.size),
            Self::Decoded(frame, _) => Ok(frame.size),
            Self::Lost(name, reason) => Err(lost(name, reason)),
        }
    }

    /// Decode. For a frame of a video all before it are decoded too: of many take [`each_source`].
    ///
    /// # Errors
    /// As [`read_frame`]; a lost frame is an [`InputError::Image`].
    pub fn frame(&self) -> Result<Frame, InputError> {
        match self {
            Self::File(path) => read_frame(path),
            Self::Video(_) => {
                let mut found = Err(lost(&self.name(), NOT_AGAIN));
                each_source(std::slice::from_ref(self), &mut |_, decoded| {
                    found = decoded.frame();
                    false
                });
                found
            }
            Self::Decoded(frame, _) => Ok(frame.clone()),
            Self::Lost(name, reason) => Err(lost(name, reason)),
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

fn lost(name: &str, reason: &str) -> InputError {
    InputError::Image { path: name.into(), reason: reason.into() }
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
            sources.extend(match purpose {
                Purpose::Template(options) => chosen(input, options, progress)?,
                Purpose::Reconstruct => listed(input, progress)?,
            });
        } else {
            let found = find_frames(std::slice::from_ref(input))?;
            sources.extend(found.into_iter().map(Source::File));
        }
    }
    Ok(sources)
}

/// Frames of a video with parallax between them, decoded.
fn chosen(
    path: &Path,
    options: &SelectOptions,
    progress: &dyn Progress,
) -> Result<Vec<Source>, VideoError> {
    let mut shown = 0;
    let frames = select_reporting(path, options, &mut |done, total| {
        shown = shown.max(done);
        progress.step("video", done, total.unwrap_or(done));
    })?;
    progress.note(&format!("{} frames chosen of {shown}", frames.len()));
    Ok(frames.into_iter().map(|frame| Source::Decoded(frame, None)).collect())
}

/// Every frame of a video: its place, or its loss.
fn listed(path: &Path, progress: &dyn Progress) -> Result<Vec<Source>, VideoError> {
    let video: Arc<Path> = path.into();
    let mut sources = Vec::new();
    let read = each_frame(path, &mut |VideoFrame { number, total, content, .. }| {
        progress.step("video", number + 1, total.unwrap_or(number + 1));
        sources.push(match content {
            Ok(Frame { size, .. }) => {
                Source::Video(VideoPlace { video: video.clone(), number, size })
            }
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

/// Of a frame that was there when the video was listed.
const NOT_AGAIN: &str = "it is not decoded a second time: did the video change?";

/// Every source with its place in the list, frames of videos decoded, until `each` says that it
/// wants no more. Frames of one video that follow each other are decoded in one pass, one at a
/// time; one that was there when the video was listed and is not now is [`Source::Lost`].
pub fn each_source(sources: &[Source], each: &mut dyn FnMut(usize, Source) -> bool) {
    let mut next = 0;
    let mut give = |source| {
        next += 1;
        each(next - 1, source)
    };
    let mut rest = sources;
    while let [first, others @ ..] = rest {
        let more = match first {
            Source::Video(place) => {
                let run;
                (run, rest) = rest.split_at(run_length(rest, place));
                give_run(&place.video, run, &mut give)
            }
            other => {
                rest = others;
                give(other.clone())
            }
        };
        if !more {
            return;
        }
    }
}

/// Sources at the head of the list that one pass over the video of `first` gives, with the lost
/// ones between them.
fn run_length(sources: &[Source], first: &VideoPlace) -> usize {
    let mut next = first.number;
    let in_run = |source: &&Source| match source {
        Source::Video(place) => {
            let ascends = place.video == first.video && place.number >= next;
            next = place.number + 1;
            ascends
        }
        Source::Lost(..) => true,
        _ => false,
    };
    sources.iter().take_while(in_run).count()
}

/// Give a run of [`run_length`]; whether more is wanted.
fn give_run(video: &Path, run: &[Source], give: &mut dyn FnMut(Source) -> bool) -> bool {
    let mut rest = run.iter().peekable();
    let mut more = true;
    let read = each_frame(video, &mut |VideoFrame { number, content, rests_on, .. }| {
        while let Some(lost) = rest.next_if(|s| matches!(s, Source::Lost(..))) {
            more = more && give(lost.clone());
        }
        let asked = |source: &&Source| matches!(source, Source::Video(p) if p.number == number);
        if more && rest.next_if(asked).is_some() {
            more = give(match content {
                Ok(frame) => Source::Decoded(frame, rests_on.map(predicted_from)),
                Err(reason) => Source::Lost(frame_name(number), reason),
            });
        }
        more && rest.peek().is_some()
    });
    let reason = read.map_or_else(|error| rest_lost(&error), |()| NOT_AGAIN.to_owned());
    for source in rest {
        more = more
            && give(match source {
                Source::Video(place) => Source::Lost(frame_name(place.number), reason.clone()),
                other => other.clone(),
            });
    }
    more
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
