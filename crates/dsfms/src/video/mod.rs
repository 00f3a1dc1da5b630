//! Frames out of a video: decoding, and the choice of sharp frames that differ from one another.
//!
//! H.264 in mp4 is decoded without any system package; everything else through an installed
//! `ffmpeg`. Frames are looked at one by one; only the candidates are kept in memory.

mod colour;
mod error;
mod ffmpeg;
mod frame;
mod losses;
pub mod mjpeg;
pub mod motion;
mod mp4;
mod options;
pub mod passthrough;
pub mod ppm;
mod select;
pub mod watched;

pub use error::VideoError;
pub use frame::{VideoFrame, frame_name};
pub use options::SelectOptions;

use crate::guard;
use crate::image::Frame;
use losses::Losses;
use std::io::BufReader;
use std::path::Path;

/// Extensions of files that are taken for videos, in any case.
pub const EXTENSIONS: [&str; 10] =
    ["mp4", "m4v", "mov", "mkv", "avi", "webm", "mpg", "mpeg", "wmv", "ts"];

/// Whether a path is a video by its extension.
pub fn is_video(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    EXTENSIONS.contains(&extension.as_str())
}

/// Choose frames of a video, in display order, named `frame_NNN` by their 0-based number.
///
/// Every window's sharpest frame (variance of the Laplacian at half size) is a candidate; a
/// candidate that hardly moved against the frame chosen before it is left out, so that a resting
/// camera gives no duplicates. The first candidate is always chosen.
///
/// ```no_run
/// use dsfms::video::{SelectOptions, select_frames};
///
/// let frames = select_frames("exploration.mp4".as_ref(), &SelectOptions::default())?;
/// # Ok::<_, dsfms::video::VideoError>(())
/// ```
///
/// # Errors
/// A file that is no video, or of which no frame can be decoded.
pub fn select_frames(path: &Path, options: &SelectOptions) -> Result<Vec<Frame>, VideoError> {
    select_reporting(path, options, &mut |_, _| {})
}

/// [`select_frames`], telling after each decoded frame how many are done and, where the container
/// says so, how many there are.
///
/// # Errors
/// As [`select_frames`].
pub(crate) fn select_reporting(
    path: &Path,
    options: &SelectOptions,
    progress: &mut dyn FnMut(usize, Option<usize>),
) -> Result<Vec<Frame>, VideoError> {
    options.validate()?;
    let mut candidates = None;
    let mut lost = None;
    let read = each_frame(path, &mut |VideoFrame { number, total, content, rests_on }| {
        progress(number + 1, total);
        let candidates = candidates.get_or_insert_with(|| select::Candidates::new(options, total));
        match content {
            // What rests on a damaged frame may show two moments at once.
            Ok(frame) if rests_on.is_none() => candidates.offer(number, frame),
            Ok(_) => {}
            Err(reason) => {
                lost.get_or_insert(format!("{}: {reason}", frame_name(number)));
            }
        }
        true
    });
    match read {
        // The frames before are as good as without it.
        Err(VideoError::Lost { .. }) if candidates.as_ref().is_some_and(|c| !c.is_empty()) => {}
        read => read?,
    }
    let chosen = candidates.map_or(Vec::new(), |candidates| candidates.choose(options));
    match (chosen.is_empty(), lost) {
        (false, _) => Ok(chosen),
        (true, Some(reason)) => Err(VideoError::Damaged { path: path.into(), reason }),
        (true, None) => Err(VideoError::Empty { path: path.into() }),
    }
}

/// Every frame of a video in display order, one at a time, until `each` says that it wants no more.
/// A frame that cannot be decoded is given as lost under its own number; the others go on.
///
/// # Errors
/// A file that cannot be read, or of which nothing can be decoded. Where another decoder (`ffmpeg`)
/// fails in the middle, or more than 3000 pictures in a row are lost, the frames before have been
/// given by then.
pub fn each_frame(path: &Path, each: &mut dyn FnMut(VideoFrame) -> bool) -> Result<(), VideoError> {
    let file =
        guard::open(path).map_err(|source| VideoError::Read { path: path.into(), source })?;
    let damaged = |reason| VideoError::Damaged { path: path.into(), reason };
    let mut given = 0;
    let mut losses = Losses::new(each);
    let reason = match mp4::open(BufReader::new(file)) {
        Ok(stream) => {
            let total = Some(stream.frame_count());
            let decoded = stream.decode(&mut |mp4::ShownPicture { content, number, rests_on }| {
                given += 1;
                let content = content.map(|picture| picture.into_frame(number));
                losses.give(VideoFrame { number, total, content, rests_on })
            });
            if let Some(reason) = losses.too_many() {
                return Err(VideoError::Lost { path: path.into(), reason: reason.to_owned() });
            }
            losses.finish();
            match decoded {
                Ok(()) if given == 0 => return Err(VideoError::Empty { path: path.into() }),
                Ok(()) => return Ok(()),
                Err(mp4::DecodeStop::Unsupported(reason)) if given == 0 => reason,
                Err(mp4::DecodeStop::Unsupported(reason) | mp4::DecodeStop::Damaged(reason)) => {
                    return Err(damaged(reason));
                }
            }
        }
        Err(reason) => reason,
    };
    ffmpeg::decode(("ffmpeg", watched::SILENCE), path, &reason, &mut |number, picture| {
        let content = Ok(picture.into_frame(number));
        each(VideoFrame { number, total: None, content, rests_on: None })
    })
}

/// Frames a second of a video on average, where it is H.264 in mp4 and says so.
pub fn frame_rate(path: &Path) -> Option<f64> {
    mp4::open(BufReader::new(guard::open(path).ok()?)).ok()?.frame_rate()
}

/// Decode an mp4 file in memory and count pictures and losses; for tests of damaged input.
///
/// # Errors
/// Why nothing is decoded.
#[doc(hidden)]
pub fn count_frames(bytes: &[u8]) -> Result<[usize; 2], String> {
    let mut counts = [0; 2];
    let stream = mp4::open(std::io::Cursor::new(bytes))?;
    let decoded = stream.decode(&mut |shown| {
        counts[usize::from(shown.content.is_err())] += 1;
        true
    });
    match decoded {
        Ok(()) => Ok(counts),
        Err(mp4::DecodeStop::Unsupported(reason) | mp4::DecodeStop::Damaged(reason)) => Err(reason),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_no_video() {
        let dir = tempfile::tempdir().unwrap();
        let missing = select_frames(&dir.path().join("a.mp4"), &SelectOptions::default());
        assert!(matches!(missing, Err(VideoError::Read { .. })));
        for (name, bytes) in [("text.mp4", b"not a video".to_vec()), ("empty.mp4", Vec::new())] {
            let path = dir.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            // With or without an ffmpeg on this machine.
            let message = select_frames(&path, &SelectOptions::default()).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
        assert!(is_video(Path::new("a/B.MP4")) && !is_video(Path::new("mp4")));
    }

    #[test]
    fn options_are_checked() {
        let options = |text: &str| toml::from_str::<SelectOptions>(text);
        assert!(options("max_frames = 0").unwrap().validate().is_err());
        assert!(options("min_motion = 1.5").unwrap().validate().is_err());
        assert!(options("max_frame = 3").is_err());
        assert_eq!(options("").unwrap(), SelectOptions::default());
    }
}
