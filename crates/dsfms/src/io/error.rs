//! What can be wrong with an input file. Every message names the file.

use super::atomic::{parent, write_atomic};
use crate::guard;
use std::path::{Path, PathBuf};

/// An image, mask, camera, pose or match file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// The file or folder is not there.
    #[error("{}: no such file or folder", .0.display())]
    Missing(PathBuf),
    /// The operating system refused.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The operating system refused.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Nothing to read in a folder, or nothing matches a pattern.
    #[error("{}: {expected}, but none was found", path.display())]
    Empty {
        /// The folder or pattern.
        path: PathBuf,
        /// What was looked for.
        expected: String,
    },
    /// A file that is no readable image.
    #[error("{}: not a readable image: {reason}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Frames of different sizes.
    #[error(
        "{} is {}x{} px but {} is {}x{} px; all frames must have one size",
        other.display(), other_size[0], other_size[1], first.display(), first_size[0], first_size[1]
    )]
    FrameSizes {
        /// The first frame.
        first: PathBuf,
        /// Its size.
        first_size: [usize; 2],
        /// The frame that differs.
        other: PathBuf,
        /// Its size.
        other_size: [usize; 2],
    },
    /// Two frames whose outputs would have the same name.
    #[error(
        "{} and {} would both be called {name:?} in the output; rename one of them",
        first.display(), second.display()
    )]
    SameName {
        /// The common stem.
        name: String,
        /// One file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// The camera file belongs to another resolution.
    #[error(
        "frame {frame:?} is {}x{} px but the camera file {} says {}x{} px; use the camera file of this resolution, or scale its fx, fy, cx, cy",
        found[0], found[1], path.display(), expected[0], expected[1]
    )]
    CameraSize {
        /// Name of the frame.
        frame: String,
        /// Size of the frame.
        found: [usize; 2],
        /// The camera file.
        path: PathBuf,
        /// Size in the camera file.
        expected: [usize; 2],
    },
    /// A mask of another size than its frame.
    #[error(
        "{}: the mask is {}x{} px but frame {frame:?} is {}x{} px",
        path.display(), found[0], found[1], expected[0], expected[1]
    )]
    MaskSize {
        /// The mask file.
        path: PathBuf,
        /// Size of the mask.
        found: [usize; 2],
        /// Name of the frame.
        frame: String,
        /// Size of the frame.
        expected: [usize; 2],
    },
    /// No file of a folder belongs to a frame.
    #[error("{}: no {what} for frame {frame:?}; expected {expected}", path.display())]
    NoPartner {
        /// The folder.
        path: PathBuf,
        /// Mask or match file.
        what: &'static str,
        /// Name of the frame.
        frame: String,
        /// File names that would have been taken.
        expected: String,
    },
    /// Several files of a folder could belong to a frame.
    #[error(
        "{}: several files could be the {what} of frame {frame:?}: {}; keep one, or name it like the frame",
        path.display(), candidates.join(", ")
    )]
    Ambiguous {
        /// The folder.
        path: PathBuf,
        /// Mask or match file.
        what: &'static str,
        /// Name of the frame.
        frame: String,
        /// The file names.
        candidates: Vec<String>,
    },
    /// The file is not of its format.
    #[error("{}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong, with the line where there is one.
        reason: String,
    },
    /// A list of camera poses where intrinsics are expected.
    #[error(
        "{}: holds camera poses (R and t), no intrinsics; expected width, height, fx, fy, cx, cy",
        .0.display()
    )]
    PosesForCamera(PathBuf),
    /// Intrinsics where a list of camera poses is expected.
    #[error(
        "{}: holds intrinsics of a camera, no poses; expected a list of {{image, R, t}}",
        .0.display()
    )]
    CameraForPoses(PathBuf),
    /// A field is missing or has an impossible value.
    #[error("{}: field {field}: {problem}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Full name of the field, `light.spot.inner_deg`.
        field: String,
        /// What is wrong and what was expected.
        problem: String,
    },
    /// The camera's numbers make no camera.
    #[error("{}: {source}", path.display())]
    Camera {
        /// The camera file.
        path: PathBuf,
        /// What is wrong.
        source: crate::camera::CameraError,
    },
    /// The light's numbers make no light.
    #[error("{}: {source}", path.display())]
    Light {
        /// The camera file.
        path: PathBuf,
        /// What is wrong.
        source: crate::light::LightError,
    },
    /// A line of a text file is wrong.
    #[error("{}, line {line}: {problem}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// 1-based line.
        line: usize,
        /// What is wrong and what was expected.
        problem: String,
    },
}

impl InputError {
    pub(super) fn read(path: &Path, source: std::io::Error) -> Self {
        match source.kind() {
            std::io::ErrorKind::NotFound => Self::Missing(path.into()),
            _ => Self::Read { path: path.into(), source },
        }
    }

    pub(super) fn format(path: &Path, reason: impl Into<String>) -> Self {
        Self::Format { path: path.into(), reason: reason.into() }
    }

    pub(super) fn field(path: &Path, field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Field { path: path.into(), field: field.into(), problem: problem.into() }
    }

    pub(super) fn line(path: &Path, line: usize, problem: impl Into<String>) -> Self {
        Self::Line { path: path.into(), line, problem: problem.into() }
    }
}

/// The text of a file; a byte-order mark at its start is dropped.
pub(super) fn read_text(path: &Path) -> Result<String, InputError> {
    let bytes = guard::read(path).map_err(|source| InputError::read(path, source))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| InputError::format(path, "not a text file (invalid UTF-8)"))?;
    if text.trim().is_empty() {
        return Err(InputError::format(path, "the file is empty"));
    }
    Ok(text.trim_start_matches('\u{feff}').to_owned())
}

/// Write a text file as a whole ([`write_atomic`]) into a folder that is there.
pub(super) fn write_text(path: &Path, text: &str) -> Result<(), InputError> {
    let failed = |source| InputError::Write { path: path.into(), source };
    parent(path).metadata().map_err(failed)?;
    write_atomic(path, |file| file.write_all(text.as_bytes())).map_err(|error| failed(error.source))
}

/// A JSON document; NaN and infinities, which JSON does not have, get their own message.
pub(super) fn parse_json(path: &Path, text: &str) -> Result<serde_json::Value, InputError> {
    if text.len() as u64 > guard::MOST_JSON_BYTES {
        let mib = guard::MOST_JSON_BYTES >> 20;
        return Err(InputError::format(path, format!("JSON of more than {mib} MiB")));
    }
    serde_json::from_str(text).map_err(|error| {
        let line = text.lines().nth(error.line().saturating_sub(1)).unwrap_or_default();
        // The error's column points at the token, give or take its sign.
        let around: String = line.chars().skip(error.column().saturating_sub(3)).take(6).collect();
        let around = around.to_lowercase();
        let reason = if around.contains("nan") || around.contains("inf") {
            let line = error.line();
            format!(
                "line {line}: NaN and Infinity are not valid JSON, and every number must be finite"
            )
        } else {
            format!("not valid JSON: {error}")
        };
        InputError::format(path, reason)
    })
}
