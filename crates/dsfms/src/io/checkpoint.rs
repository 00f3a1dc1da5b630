//! A folder of the values of finished stages: one file a stage, written whole or not at all.

use super::atomic::{WriteError, write_atomic};
use crate::checkpoint::WriteValue;
use crate::guard;
use flate2::Crc;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// First line of every file.
const MAGIC: &str = "dsfms stage 2";
/// Name of every file, behind that of its stage.
const ENDING: &str = ".stage";
/// A head is no longer.
const MOST_HEAD: usize = 512;
/// Checksum of the value, at the end of a file.
const SUM: usize = 4;

/// The folder. Nothing is made before the first value is saved.
#[derive(Clone, Debug)]
pub struct StageFolder {
    path: PathBuf,
    build: String,
}

/// What a file of a stage holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kept {
    /// No file, or one of other input, other options or another build of the program.
    Nothing,
    /// The value.
    Value(Vec<u8>),
    /// A file that is not whole.
    Damaged(PathBuf),
}

impl StageFolder {
    /// Values of `build` in the folder `path`: those of another build are not used.
    pub fn new(path: &Path, build: &str) -> Self {
        Self { path: path.into(), build: build.replace('\n', " ") }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn file(&self, stage: &str) -> PathBuf {
        self.path.join(format!("{stage}{ENDING}"))
    }

    /// The head of a file: everything that must be the same for its value to be used.
    fn head(&self, stage: &str, key: u64) -> String {
        format!("{MAGIC}\n{stage}\n{}\n{key:016x}\n", self.build)
    }

    /// What is kept of a stage under a key.
    pub fn load(&self, stage: &str, key: u64) -> Kept {
        let path = self.file(stage);
        let bytes = match guard::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Kept::Nothing,
            Err(_) => return Kept::Damaged(path),
        };
        if let Some(rest) = bytes.strip_prefix(self.head(stage, key).as_bytes()) {
            let whole =
                rest.split_last_chunk::<SUM>().filter(|(value, sum)| **sum == sum_of(value));
            return whole.map_or(Kept::Damaged(path), |(value, _)| Kept::Value(value.to_vec()));
        }
        // Of something else, or with a head that is none.
        match is_head(&bytes[..bytes.len().min(MOST_HEAD)]) {
            true => Kept::Nothing,
            false => Kept::Damaged(path),
        }
    }

    /// Keep a value under a key.
    ///
    /// # Errors
    /// Where the file cannot be written, or is larger than what would be read back.
    pub fn save(&self, stage: &str, key: u64, value: WriteValue) -> Result<(), WriteError> {
        write_atomic(&self.file(stage), |file| {
            file.write_all(self.head(stage, key).as_bytes())?;
            let left = guard::MOST_BYTES - (MOST_HEAD + SUM) as u64;
            let mut summed = BufWriter::new(Summed { file, sum: Crc::new(), left });
            value(&mut summed)?;
            let Summed { file, sum, .. } = summed.into_inner()?;
            file.write_all(&sum.sum().to_le_bytes())
        })
    }

    /// Remove the files of stages, and the folder where nothing else is in it.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub fn remove(&self) -> io::Result<()> {
        let entries = match fs::read_dir(&self.path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            entries => entries?,
        };
        for entry in entries {
            let path = entry?.path();
            if path.to_string_lossy().ends_with(ENDING) {
                fs::remove_file(path)?;
            }
        }
        // What others put there stays, with the folder.
        super::atomic::remove_stale(&self.path)?;
        let _ = fs::remove_dir(&self.path);
        Ok(())
    }
}

/// A file that sums up what goes into it, and takes no more than so many bytes.
struct Summed<'a> {
    file: &'a mut dyn Write,
    sum: Crc,
    left: u64,
}

impl Write for Summed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.left = self
            .left
            .checked_sub(bytes.len() as u64)
            .ok_or_else(|| io::Error::from(io::ErrorKind::FileTooLarge))?;
        self.file.write_all(bytes)?;
        self.sum.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// The checksum of a value.
fn sum_of(value: &[u8]) -> [u8; SUM] {
    let mut sum = Crc::new();
    sum.update(value);
    sum.sum().to_le_bytes()
}

/// Whether bytes begin as the file of some stage does.
fn is_head(bytes: &[u8]) -> bool {
    let mut lines = bytes.split(|b| *b == b'\n');
    let hex = |line: &[u8]| line.len() == 16 && line.iter().all(u8::is_ascii_hexdigit);
    lines.next() == Some(MAGIC.as_bytes()) && lines.nth(2).is_some_and(hex)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_and_the_folder_goes() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("organ.template.partial");
        let folder = StageFolder::new(&path, "0.1.0\nab12");
        assert_eq!(folder.load("poses", 7), Kept::Nothing);
        assert!(!path.exists());
        folder.save("poses", 7, &|to| to.write_all(b"some\nvalue")).unwrap();
        assert_eq!(folder.load("poses", 7), Kept::Value(b"some\nvalue".to_vec()));
        // Other input, another stage, another build.
        assert_eq!(folder.load("poses", 8), Kept::Nothing);
        assert_eq!(folder.load("depth", 7), Kept::Nothing);
        assert_eq!(StageFolder::new(&path, "0.2.0").load("poses", 7), Kept::Nothing);
        fs::write(path.join("notes.txt"), "mine").unwrap();
        folder.remove().unwrap();
        assert_eq!(fs::read_dir(&path).unwrap().count(), 1);
        fs::remove_file(path.join("notes.txt")).unwrap();
        folder.remove().unwrap();
        assert!(!path.exists());
        folder.remove().unwrap();
    }

    #[test]
    fn every_byte_counts() {
        let place = tempfile::tempdir().unwrap();
        let folder = StageFolder::new(place.path(), "build");
        folder.save("poses", 7, &|to| to.write_all(b"value")).unwrap();
        let path = folder.file("poses");
        let whole = fs::read(&path).unwrap();
        let found = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            folder.load("poses", 7)
        };
        for length in 0..whole.len() {
            assert!(!matches!(found(&whole[..length]), Kept::Value(_)), "{length}");
        }
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            assert!(!matches!(found(&bytes), Kept::Value(_)), "{at}");
        }
        assert_eq!(found(b""), Kept::Damaged(path.clone()));
        assert_eq!(found(&whole[..whole.len() - 1]), Kept::Damaged(path.clone()));
        assert_eq!(found(&whole), Kept::Value(b"value".to_vec()));
    }
}
