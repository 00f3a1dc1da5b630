//! Why a template could not be written or read.

use super::atomic::WriteError;
use super::mesh::MeshFileError;
use super::template_manifest::{MANIFEST, VERSION};
use std::path::{Path, PathBuf};

/// Why a template could not be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TemplateFileError {
    /// The target exists and is something else.
    #[error("{} exists and is not a template (no {MANIFEST} in it); choose another name or remove it first", path.display())]
    NotATemplate {
        /// The target.
        path: PathBuf,
    },
    /// The target is a template that holds something else besides, which would go with it.
    #[error("{} holds {name}, which is no part of a template and would be lost; move it elsewhere or choose another name", path.display())]
    Foreign {
        /// The target.
        path: PathBuf,
        /// The first such file.
        name: String,
    },
    /// Nothing there, or not a directory.
    #[error("no template at {}: expected a directory with {MANIFEST}; build one with 'dsfms template'", path.display())]
    Missing {
        /// The path asked for.
        path: PathBuf,
    },
    /// The manifest is damaged.
    #[error("template manifest {}: {reason}", path.display())]
    Manifest {
        /// The manifest.
        path: PathBuf,
        /// What the parser said.
        reason: String,
    },
    /// Written by another version.
    #[error("template {} has version {found}, this program reads version {VERSION}; build it again", path.display())]
    Version {
        /// The template.
        path: PathBuf,
        /// Its version.
        found: u32,
    },
    /// A file of the template is missing, truncated or damaged.
    #[error("template file {}: {reason}; build or copy the template again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        reason: String,
    },
    /// A file disagrees with the manifest.
    #[error("template file {} holds {found} {what}, the manifest says {expected}; files of two templates were mixed", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// What was counted.
        what: &'static str,
        /// In the manifest.
        expected: usize,
        /// In the file.
        found: usize,
    },
    /// The surface is damaged.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// What was about to be written would not read back.
    #[error("template {} was not written, since it would not read back: {source}", path.display())]
    Unreadable {
        /// The target.
        path: PathBuf,
        /// What reading it said.
        source: Box<TemplateFileError>,
    },
    /// The operating system refused.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// Compare a file with the manifest.
pub(super) fn expect(
    path: &Path,
    what: &'static str,
    expected: usize,
    found: usize,
) -> Result<(), TemplateFileError> {
    if expected == found {
        return Ok(());
    }
    Err(TemplateFileError::Count { path: path.to_path_buf(), what, expected, found })
}
