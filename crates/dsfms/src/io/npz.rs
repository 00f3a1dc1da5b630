//! Arrays out of NumPy's `.npz`, whose stated shapes are checked against the bytes that are there before
//! anything of their size is made.

use crate::guard;
use ndarray::{Array, Dimension, OwnedRepr};
use ndarray_npy::{ReadNpyExt, ReadableElement};
use std::io::{Cursor, Read};
use std::path::Path;
use zip::ZipArchive;

/// Deflate makes no more than so many bytes of one.
const MOST_RATIO: u64 = 1040;

/// Most bytes of an array: an hour of shapes.
const MOST_ENTRY: u64 = 4 << 30;

/// An npz being read. Errors say what is wrong; the caller names the file.
pub(crate) struct Npz(ZipArchive<Cursor<Vec<u8>>>);

impl Npz {
    pub(crate) fn open(path: &Path) -> Result<Self, String> {
        Self::of(guard::read(path).map_err(|e| e.to_string())?)
    }

    /// From the bytes of a file.
    pub(crate) fn of(bytes: Vec<u8>) -> Result<Self, String> {
        let archive = guard::caught(|| ZipArchive::new(Cursor::new(bytes)))?;
        archive.map(Self).map_err(|e| format!("not a whole npz ({e})"))
    }

    /// The array of a name.
    pub(crate) fn array<T: ReadableElement, D: Dimension>(
        &mut self,
        name: &str,
    ) -> Result<Array<T, D>, String> {
        let wrong = |reason: String| format!("array '{name}': {reason}");
        let bytes = self.entry(name).map_err(wrong)?;
        check_shape(&bytes, size_of::<T>()).map_err(wrong)?;
        let read = || ndarray::ArrayBase::<OwnedRepr<T>, D>::read_npy(Cursor::new(&bytes));
        guard::caught(read).map_err(wrong)?.map_err(|e| wrong(e.to_string()))
    }

    /// The numbers of an array of one dimension.
    pub(crate) fn list<T: ReadableElement>(&mut self, name: &str) -> Result<Vec<T>, String> {
        Ok(self.array::<T, ndarray::Ix1>(name)?.into_iter().collect())
    }

    fn entry(&mut self, name: &str) -> Result<Vec<u8>, String> {
        let at = [format!("{name}.npy"), name.to_owned()];
        let at = at.iter().find_map(|n| self.0.index_for_name(n)).ok_or("is missing")?;
        let file = self.0.by_index(at).map_err(|e| e.to_string())?;
        let (size, packed) = (file.size(), file.compressed_size());
        if size > MOST_ENTRY || size > packed.saturating_mul(MOST_RATIO).saturating_add(1024) {
            return Err(format!("states {size} bytes, packed in {packed}"));
        }
        let mut bytes = Vec::new();
        // The statement may be wrong in the other direction, too.
        let mut file = file.take(size + 1);
        guard::caught(|| file.read_to_end(&mut bytes))?.map_err(|e| e.to_string())?;
        if bytes.len() as u64 != size {
            return Err(format!("holds {} bytes of the {size} it states", bytes.len()));
        }
        Ok(bytes)
    }
}

/// Whether the shape in the head of a `.npy` needs exactly the bytes behind it, of `size` each.
fn check_shape(bytes: &[u8], size: usize) -> Result<(), String> {
    let (head, data) = head(bytes).ok_or("has no NumPy header")?;
    let shape = head.split_once("'shape'").and_then(|(_, rest)| {
        let (inner, _) = rest.split_once('(')?.1.split_once(')')?;
        let words = inner.split(',').map(str::trim).filter(|w| !w.is_empty());
        words.map(|w| w.trim_end_matches('L').parse::<usize>().ok()).collect::<Option<Vec<_>>>()
    });
    let shape = shape.ok_or("has no shape")?;
    let needed = shape.iter().try_fold(size, |n, &d| n.checked_mul(d));
    match needed {
        Some(needed) if needed == data.len() => Ok(()),
        _ => Err(format!("states the shape {shape:?}, but holds {} bytes", data.len())),
    }
}

/// The text of the header, and the data.
fn head(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let rest = bytes.strip_prefix(b"\x93NUMPY")?;
    let (start, length) = match rest.first()? {
        1 => (4, usize::from(u16::from_le_bytes([*rest.get(2)?, *rest.get(3)?]))),
        _ => (6, u32::from_le_bytes(rest.get(2..6)?.try_into().ok()?) as usize),
    };
    let (text, data) = rest.get(start..)?.split_at_checked(length)?;
    Some((std::str::from_utf8(text).ok()?, data))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use zip::write::{SimpleFileOptions, ZipWriter};

    /// An npz with one array of doubles whose header states a shape.
    fn npz(shape: &str, values: &[f64]) -> Vec<u8> {
        let text = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
        let width = (text.len() + 11).next_multiple_of(64) - 11;
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        zip.start_file("a.npy", SimpleFileOptions::default()).unwrap();
        zip.write_all(b"\x93NUMPY\x01\x00").unwrap();
        zip.write_all(&((width + 1) as u16).to_le_bytes()).unwrap();
        zip.write_all(format!("{text:<width$}\n").as_bytes()).unwrap();
        values.iter().for_each(|v| zip.write_all(&v.to_le_bytes()).unwrap());
        zip.finish().unwrap().into_inner()
    }

    fn read(bytes: Vec<u8>) -> Result<Vec<f64>, String> {
        Npz::of(bytes)?.list("a")
    }

    #[test]
    fn shapes_that_their_bytes_do_not_fill_are_refused() {
        assert_eq!(read(npz("(2,)", &[1.0, 2.0])), Ok(vec![1.0, 2.0]));
        for false_shape in
            ["(3,)", "(1,)", "(1000000000000,)", "(4611686018427387904, 3)", "(-1,)", "()"]
        {
            let error = read(npz(false_shape, &[1.0, 2.0])).unwrap_err();
            assert!(error.contains("shape"), "{false_shape}: {error}");
        }
        assert!(Npz::of(npz("(2,)", &[1.0, 2.0])).unwrap().list::<f32>("a").is_err());
        assert!(Npz::of(npz("(2,)", &[1.0, 2.0])).unwrap().list::<f64>("b").is_err());
        assert!(Npz::of(b"no zip".to_vec()).is_err());
    }

    #[test]
    fn an_entry_that_lies_about_its_size_is_refused() {
        let mut bytes = npz("(2,)", &[1.0, 2.0]);
        // The uncompressed size in the central directory.
        let central = bytes.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
        bytes[central + 24..central + 28].copy_from_slice(&0x7FFF_FFFFu32.to_le_bytes());
        assert!(read(bytes).is_err());
    }
}
