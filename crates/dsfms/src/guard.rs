//! Where input that others made meets memory, time and third-party code: files are read within
//! bounds, and a decoder that panics is an error.

use std::cell::Cell;
use std::fs::File;
use std::io::{self, Read};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::sync::Once;

/// Most bytes of a file that is read as a whole (everything but videos, which are read piece by
/// piece).
pub const MOST_BYTES: u64 = 1 << 30;

/// Most bytes of a file of options.
pub const MOST_OPTIONS_BYTES: u64 = 1 << 20;

/// Most bytes of a JSON document: what it is parsed to takes up to 32 times as much.
pub const MOST_JSON_BYTES: u64 = 32 << 20;

/// Most bytes that a picture may take while it is decoded.
pub(crate) const MOST_IMAGE_BYTES: u64 = 512 << 20;

/// Most px of a picture's side.
pub(crate) const MOST_IMAGE_SIDE: u32 = 16384;

/// Open a regular file. A pipe would wait for its writer, and a device need not end.
///
/// # Errors
/// Those of the system; [`io::ErrorKind::InvalidInput`] for what is no regular file.
pub fn open(path: &Path) -> io::Result<File> {
    // Asked before opening, which already waits on a pipe; asked again of what was opened.
    if !path.metadata()?.is_file() {
        return Err(not_regular());
    }
    let file = File::open(path)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(not_regular()) }
}

fn not_regular() -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidInput,
        "not a regular file (a folder, pipe or device); copy its content to a file first",
    )
}

/// The bytes of a regular file of at most [`MOST_BYTES`].
///
/// # Errors
/// Those of [`open`]; [`io::ErrorKind::FileTooLarge`] beyond the bound.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    read_at_most(path, MOST_BYTES)
}

/// The bytes of a regular file of at most `most` bytes.
fn read_at_most(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = open(path)?;
    let length = file.metadata()?.len();
    let mut bytes = Vec::new();
    // A file may grow while it is read.
    if length <= most {
        bytes.reserve_exact(length as usize);
        file.take(most + 1).read_to_end(&mut bytes)?;
    }
    if length > most || bytes.len() as u64 > most {
        let mib = most >> 20;
        let reason = format!("larger than {mib} MiB, which no input of this kind is");
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, reason));
    }
    Ok(bytes)
}

/// The text of a regular file of at most [`MOST_BYTES`].
///
/// # Errors
/// Those of [`read`]; [`io::ErrorKind::InvalidData`] where it is no UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    read_text_at_most(path, MOST_BYTES)
}

/// The same of at most `most` bytes.
///
/// # Errors
/// As [`read_text`].
pub fn read_text_at_most(path: &Path, most: u64) -> io::Result<String> {
    String::from_utf8(read_at_most(path, most)?)
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "not a text file (invalid UTF-8)"))
}

thread_local! {
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Run third-party code on data of others; a panic is an error with its message. What `work`
/// changed before it panicked must not be used any more.
///
/// # Errors
/// What the panic said.
pub fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    let outer = GUARDED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(work));
    GUARDED.set(outer);
    result.map_err(|panic| {
        let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
        format!("its decoder gave up ({})", text.unwrap_or_default())
    })
}

/// Let panics that [`caught`] turns into errors print nothing. For programs: it wraps the panic
/// hook of the whole process, once.
pub fn quiet_hook() {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = take_hook();
        set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                usual(info);
            }
        }));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_within_bounds_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, [1, 2, 3]).unwrap();
        assert_eq!(read_at_most(&path, 3).unwrap(), [1, 2, 3]);
        let large = read_at_most(&path, 2).unwrap_err();
        assert_eq!(large.kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(read(folder.path()).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        assert_eq!(read(&folder.path().join("b")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[cfg(unix)]
    #[test]
    fn devices_and_pipes_are_refused_at_once() {
        let zero = read(Path::new("/dev/zero")).unwrap_err();
        assert!(zero.to_string().contains("not a regular file"), "{zero}");
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            assert_eq!(read(&pipe).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        }
    }

    #[test]
    fn a_panic_is_an_error_with_its_message() {
        assert_eq!(caught(|| 7), Ok(7));
        let text = caught(|| panic!("index {} of {}", 3, 2)).unwrap_err();
        assert!(text.contains("index 3 of 2"), "{text}");
    }
}
