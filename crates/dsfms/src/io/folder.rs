//! A folder of results that appears whole or not at all.

use super::atomic::{WriteError, old_prefix, parent, partial_prefix, share};
use std::fs;
use std::io;
use std::path::Path;

/// Check, before any work, that a folder of results can take this name: nothing is there, or one
/// with nothing but `content`, of which the first name tells that it is one.
///
/// # Errors
/// Anything else at `path`, named.
pub fn check_folder_target(path: &Path, content: &[&str]) -> Result<(), WriteError> {
    if !path.exists() {
        return Ok(());
    }
    let refuse = |text: String| Err(WriteError::new(path, io::Error::other(text)));
    let entries = match fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) => return Err(WriteError::new(path, error)),
    };
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    match names.iter().find(|name| !content.contains(&name.as_str())) {
        Some(name) => refuse(format!("it holds {name:?}, which would be lost")),
        None if names.is_empty()
            || content.first().is_some_and(|mark| names.iter().any(|n| n == mark)) =>
        {
            Ok(())
        }
        None => refuse(format!("it holds no {}, and is not of an older run", content[0])),
    }
}

/// Let `write` fill a temporary folder beside `path`, which then takes its name; an older one of
/// the same `content` is replaced, anything else is refused. On any error nothing is left and the
/// old one stands.
///
/// # Errors
/// Those of `write`, of [`check_folder_target`], and of the system.
pub fn write_folder<E: From<WriteError>>(
    path: &Path,
    content: &[&str],
    write: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    check_folder_target(path, content)?;
    let fail = |source| E::from(WriteError::new(path, source));
    let folder = parent(path);
    fs::create_dir_all(folder).map_err(fail)?;
    let temporary = |prefix: String| tempfile::Builder::new().prefix(&prefix).tempdir_in(folder);
    let fresh = temporary(partial_prefix("")).map_err(fail)?;
    write(fresh.path())?;
    share(fresh.path()).map_err(fail)?;
    // The old folder steps aside first, under its own name, by which it is found again after a
    // kill.
    let old = temporary(old_prefix()).map_err(fail)?;
    let aside = old.path().join(path.file_name().unwrap_or_default());
    let replaces = path.exists();
    if replaces {
        fs::rename(path, &aside).map_err(fail)?;
    }
    if let Err(error) = fs::rename(fresh.path(), path) {
        if replaces {
            fs::rename(&aside, path).map_err(fail)?;
        }
        return Err(fail(error));
    }
    // Its content lies under the final name; there is nothing left to remove.
    let _moved = fresh.keep();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_appears_whole_and_foreign_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/out");
        let content = ["mark.json", "a.txt"];
        let fill = |text: &'static str| {
            move |folder: &Path| -> Result<(), WriteError> {
                for name in ["mark.json", "a.txt"] {
                    fs::write(folder.join(name), text).map_err(|e| WriteError::new(folder, e))?;
                }
                Ok(())
            }
        };
        write_folder(&path, &content, fill("one")).unwrap();
        write_folder(&path, &content, fill("two")).unwrap();
        assert_eq!(fs::read_to_string(path.join("a.txt")).unwrap(), "two");
        let broken = |_: &Path| Err(WriteError::new(Path::new("x"), io::Error::other("half")));
        assert!(write_folder(&path, &content, broken).is_err());
        assert_eq!(fs::read_to_string(path.join("a.txt")).unwrap(), "two");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        fs::write(path.join("notes.txt"), "mine").unwrap();
        let refused = write_folder(&path, &content, fill("three")).unwrap_err().to_string();
        assert!(refused.contains("notes.txt"), "{refused}");
        fs::remove_file(path.join("mark.json")).unwrap();
        fs::remove_file(path.join("notes.txt")).unwrap();
        assert!(
            check_folder_target(&path, &content).unwrap_err().to_string().contains("mark.json")
        );
    }
}
