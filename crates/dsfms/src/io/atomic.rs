//! Writing without half-written results: a temporary file beside the target, then one rename.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file or folder that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}; check that the folder exists and that you may write there", path.display())]
pub struct WriteError {
    /// The file or folder under its final name.
    pub path: PathBuf,
    /// What the operating system said.
    #[source]
    pub source: io::Error,
}

impl WriteError {
    /// An error about `path`.
    pub fn new(path: &Path, source: impl Into<io::Error>) -> Self {
        Self { path: path.to_path_buf(), source: source.into() }
    }
}

/// Write a file so that its final name appears only once it is complete: `write` fills a temporary
/// file in the same folder (created where missing), which is then flushed to disk and renamed over
/// `path`. On any error the temporary file is removed and an older file of that name is untouched.
pub fn write_atomic(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    let fail = |source: io::Error| WriteError::new(path, source);
    let folder = parent(path);
    fs::create_dir_all(folder).map_err(fail)?;
    let file = tempfile::Builder::new().prefix(".partial-").tempfile_in(folder).map_err(fail)?;
    let mut writer = BufWriter::new(file);
    write(&mut writer).map_err(fail)?;
    let file = writer.into_inner().map_err(|e| fail(e.into_error()))?;
    file.as_file().sync_all().map_err(fail)?;
    share(file.path()).map_err(fail)?;
    file.persist(path).map_err(|e| fail(e.error))?;
    Ok(())
}

/// The folder a path lies in; `.` for a bare name.
pub(super) fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Temporary files and folders are private to their owner; results get the usual permissions.
#[cfg(unix)]
pub(super) fn share(path: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let mode = if path.is_dir() { 0o755 } else { 0o644 };
    fs::set_permissions(path, fs::Permissions::from_mode(mode))
}

/// Nothing to do where permissions are inherited from the folder.
#[cfg(not(unix))]
pub(super) fn share(_path: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new/a.txt");
        write_atomic(&path, |w| w.write_all(b"first")).unwrap();
        let error = write_atomic(&path, |w| {
            w.write_all(b"half")?;
            Err(io::Error::other("no more"))
        })
        .unwrap_err();
        assert!(error.to_string().contains("a.txt"));
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_that_is_a_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, b"x").unwrap();
        let error = write_atomic(&file.join("out.ply"), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("out.ply"), "{error}");
    }
}
