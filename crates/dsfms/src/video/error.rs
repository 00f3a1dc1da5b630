//! Why a video gave no frames.

use super::losses::MOST_LOST;
use crate::options::OptionError;
use std::path::PathBuf;

/// Why a video gave no frames.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VideoError {
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The video.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Not a video, or a damaged one.
    #[error("{}: cannot be decoded: {reason}", path.display())]
    Damaged {
        /// The video.
        path: PathBuf,
        /// The decoder's reason.
        reason: String,
    },
    /// More pictures in a row are lost than in a video that is damaged here and there.
    #[error(
        "{}: more than {MOST_LOST} pictures in a row cannot be decoded, the first because of this: {reason}; is it a whole video?",
        path.display()
    )]
    Lost {
        /// The video.
        path: PathBuf,
        /// Why the first of them cannot be decoded.
        reason: String,
    },
    /// Not H.264 in mp4, and no `ffmpeg` to fall back on.
    #[error(
        "{}: {reason}; only H.264 in mp4 is decoded directly: install ffmpeg, or convert with `ffmpeg -i INPUT -c:v libx264 -pix_fmt yuv420p OUTPUT.mp4`, or extract PNG frames",
        path.display()
    )]
    Unsupported {
        /// The video.
        path: PathBuf,
        /// What it holds instead.
        reason: String,
    },
    /// The video has no picture.
    #[error("{}: the video holds no frame", path.display())]
    Empty {
        /// The video.
        path: PathBuf,
    },
}
