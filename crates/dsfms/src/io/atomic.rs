//! Writing without half-written results: a temporary file beside the target, then one rename.

use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

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
///
/// # Errors
/// A file that cannot be written.
pub fn write_atomic(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    let fail = |source: io::Error| WriteError::new(path, source);
    let _writing = Writing::begin();
    let folder = parent(path);
    fs::create_dir_all(folder).map_err(fail)?;
    let file = tempfile::Builder::new().prefix(&partial_prefix("")).tempfile_in(folder);
    let file = file.map_err(fail)?;
    let mut writer = BufWriter::new(file);
    write(&mut writer).map_err(fail)?;
    let file = writer.into_inner().map_err(|e| fail(e.into_error()))?;
    file.as_file().sync_all().map_err(fail)?;
    share(file.path()).map_err(fail)?;
    file.persist(path).map_err(|e| fail(e.error))?;
    Ok(())
}

/// How many files are being written, and whether no more may be begun.
static WRITERS: Mutex<(usize, bool)> = Mutex::new((0, false));
static ALL_WRITTEN: Condvar = Condvar::new();

/// A file, or a folder of files, is being written while it lives.
pub(crate) struct Writing(());

impl Writing {
    /// Waits for ever once [`finish_writing`] has begun and nothing is being written any more.
    pub(crate) fn begin() -> Self {
        let mut state = WRITERS.lock().unwrap_or_else(PoisonError::into_inner);
        // What is being written may consist of parts, which may be begun still.
        while state.1 && state.0 == 0 {
            state = ALL_WRITTEN.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.0 += 1;
        Self(())
    }
}

impl Drop for Writing {
    fn drop(&mut self) {
        WRITERS.lock().unwrap_or_else(PoisonError::into_inner).0 -= 1;
        ALL_WRITTEN.notify_all();
    }
}

/// For a process that is about to end: wait until every file that is being written is whole,
/// `limit` at most, and let no other be begun. Whether all are whole.
pub fn finish_writing(limit: Duration) -> bool {
    let mut state = WRITERS.lock().unwrap_or_else(PoisonError::into_inner);
    state.1 = true;
    let wait = ALL_WRITTEN.wait_timeout_while(state, limit, |state| state.0 > 0);
    wait.unwrap_or_else(PoisonError::into_inner).0.0 == 0
}

/// What partial files and folders begin with, before the number of their process.
const PARTIAL: &str = ".partial-";
/// What an older template is called while a new one takes its name.
const OLD: &str = ".old-template-";

/// The start of a name that tells [`remove_stale`] whose file or folder it is.
pub(super) fn partial_prefix(what: &str) -> String {
    format!("{PARTIAL}{what}{}-", std::process::id())
}

/// Likewise, for what steps aside.
pub(super) fn old_prefix() -> String {
    format!("{OLD}{}-", std::process::id())
}

/// Remove what killed runs were in the middle of writing in a folder: partial files and folders of
/// processes that are no more, or, where the system does not tell, older than an hour. Of a
/// template that had stepped aside for a newer one when the run was killed, the old one gets its
/// name back.
///
/// # Errors
/// A folder that cannot be read, or a file that cannot be removed.
pub fn remove_stale(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let own = [PARTIAL, OLD].iter().find_map(|start| name.strip_prefix(start));
        let Some(rest) = own.filter(|rest| is_stale(&path, rest)) else { continue };
        if name.starts_with(OLD) {
            for entry in fs::read_dir(&path)?.flatten() {
                let place = folder.join(entry.file_name());
                if !rest.is_empty() && !place.exists() {
                    fs::rename(entry.path(), place)?;
                }
            }
        }
        if path.is_dir() { fs::remove_dir_all(&path)? } else { fs::remove_file(&path)? }
    }
    Ok(())
}

/// Whether the process whose number a name holds is gone.
fn is_stale(path: &Path, rest: &str) -> bool {
    let process = rest.split('-').find_map(|word| word.parse::<u32>().ok());
    match process {
        Some(number) if number == std::process::id() => false,
        Some(number) if Path::new("/proc/self").exists() => {
            !Path::new(&format!("/proc/{number}")).exists()
        }
        _ => {
            let age =
                path.metadata().and_then(|m| m.modified()).ok().and_then(|t| t.elapsed().ok());
            age.is_some_and(|age| age.as_secs() > 3600)
        }
    }
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
    fn what_killed_runs_left_goes_and_what_others_write_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        // No process has the largest number; this one and its parent live.
        let dead = u32::MAX - 1;
        let (own, parent) = (std::process::id(), 1);
        for name in [
            format!(".partial-{dead}-x"),
            format!(".partial-{own}-x"),
            format!(".partial-{parent}-x"),
        ] {
            fs::write(at(&name), "half").unwrap();
        }
        fs::create_dir(at(&format!(".partial-template-{dead}-x"))).unwrap();
        fs::write(at("notes.txt"), "x").unwrap();
        let aside = at(&format!(".old-template-{dead}-x"));
        fs::create_dir_all(aside.join("organ.template")).unwrap();
        remove_stale(folder.path()).unwrap();
        let left = |name: &str| at(name).exists();
        assert!(
            !left(&format!(".partial-{dead}-x")) && !left(&format!(".partial-template-{dead}-x"))
        );
        assert!(left(&format!(".partial-{own}-x")) && left("notes.txt"));
        if Path::new("/proc/1").exists() {
            assert!(left(".partial-1-x"));
        }
        // The older template is whole, and would have been lost.
        assert!(left("organ.template") && !aside.exists());
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
