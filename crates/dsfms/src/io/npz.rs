//! Arrays in NumPy's `.npz`. Shapes that are read are checked against the bytes that are there
//! before anything of their size is made.

use crate::guard;
use flate2::Compression;
use flate2::bufread::DeflateDecoder;
use flate2::write::DeflateEncoder;
use rawzip::{CompressionMethod, ZipArchive, ZipArchiveWriter, ZipSliceArchive};
use std::io::{self, Read, Write};
use std::path::Path;

/// An array of `N` dimensions, the last of them running fastest.
#[derive(Debug, PartialEq)]
pub(crate) struct NpyArray<T, const N: usize> {
    pub(crate) shape: [usize; N],
    pub(crate) values: Vec<T>,
}

/// What an array holds.
pub(crate) trait NpyValue: Copy {
    /// NumPy's name of it, of least byte first.
    const KIND: &'static str;
    /// From its bytes; `None` for bytes that are no value.
    fn of(bytes: &[u8]) -> Option<Self>;
    /// Its bytes, behind others.
    fn put(self, bytes: &mut Vec<u8>);
}

macro_rules! npy_number {
    ($($type:ty = $kind:literal),*) => {$(
        impl NpyValue for $type {
            const KIND: &'static str = $kind;
            fn of(bytes: &[u8]) -> Option<Self> {
                Some(Self::from_le_bytes(bytes.try_into().ok()?))
            }
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend(self.to_le_bytes());
            }
        }
    )*};
}
npy_number!(u8 = "|u1", u16 = "<u2", u32 = "<u4", f32 = "<f4", f64 = "<f8");

impl NpyValue for bool {
    const KIND: &'static str = "|b1";
    fn of(bytes: &[u8]) -> Option<Self> {
        (bytes[0] <= 1).then_some(bytes[0] == 1)
    }
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.push(self.into());
    }
}

/// Deflate makes no more than so many bytes of one.
const MOST_RATIO: u64 = 1040;

/// Most bytes of an array: half an hour of shapes. Up to three times that is held while it is read.
const MOST_ENTRY: u64 = 1 << 30;

/// Most rows without a value: the pictures of a video.
const MOST_EMPTY: usize = 1 << 21;

/// An npz being read. Errors say what is wrong; the caller names the file.
pub(crate) struct Npz(ZipSliceArchive<Vec<u8>>);

impl Npz {
    pub(crate) fn open(path: &Path) -> Result<Self, String> {
        Self::of(guard::read(path).map_err(|e| e.to_string())?)
    }

    /// From the bytes of a file.
    pub(crate) fn of(bytes: Vec<u8>) -> Result<Self, String> {
        let archive = ZipArchive::from_slice(bytes);
        archive.map(Self).map_err(|e| format!("not a whole npz ({e})"))
    }

    /// The array of a name.
    pub(crate) fn array<T: NpyValue, const N: usize>(
        &self,
        name: &str,
    ) -> Result<NpyArray<T, N>, String> {
        let wrong = |reason: String| format!("array '{name}': {reason}");
        let bytes = self.entry(name).map_err(wrong)?;
        parse(&bytes).map_err(wrong)
    }

    /// The numbers of an array of one dimension.
    pub(crate) fn list<T: NpyValue>(&self, name: &str) -> Result<Vec<T>, String> {
        Ok(self.array::<T, 1>(name)?.values)
    }

    /// The rows of an `n × N` array.
    pub(crate) fn rows<T: NpyValue, const N: usize>(
        &self,
        name: &str,
    ) -> Result<Vec<[T; N]>, String> {
        let NpyArray { shape: [_, columns], values } = self.array(name)?;
        if columns != N {
            return Err(format!("array '{name}' has {columns} columns, expected {N}"));
        }
        Ok(values.as_chunks().0.to_vec())
    }

    /// The bytes of an array, unpacked; their count and checksum are those that the file states.
    fn entry(&self, name: &str) -> Result<Vec<u8>, String> {
        let names = [format!("{name}.npy"), name.to_owned()];
        let mut entries = self.0.entries();
        let file = loop {
            let file = entries.next_entry().map_err(|e| e.to_string())?.ok_or("is missing")?;
            if names.iter().any(|n| n.as_bytes() == file.file_path().as_bytes()) {
                break file;
            }
        };
        let (size, packed) = (file.uncompressed_size_hint(), file.compressed_size_hint());
        if size > MOST_ENTRY || size > packed.saturating_mul(MOST_RATIO).saturating_add(1024) {
            return Err(format!("states {size} bytes, packed in {packed}"));
        }
        let entry = self.0.get_entry(file.wayfinder()).map_err(|e| e.to_string())?;
        let data: Box<dyn Read + '_> = match file.compression_method() {
            CompressionMethod::STORE => Box::new(entry.data()),
            CompressionMethod::DEFLATE => Box::new(DeflateDecoder::new(entry.data())),
            other => return Err(format!("is packed by {other:?}, expected deflate or nothing")),
        };
        let mut bytes = Vec::new();
        // The statement may be wrong in the other direction, too.
        let mut data = entry.verifying_reader(data).take(size + 1);
        guard::caught(|| data.read_to_end(&mut bytes))?.map_err(|e| e.to_string())?;
        if bytes.len() as u64 != size {
            return Err(format!("holds {} bytes of the {size} it states", bytes.len()));
        }
        Ok(bytes)
    }
}

/// An npz being written. No entry has a time: the same arrays give the same bytes.
pub(crate) struct NpzWriter<W> {
    zip: ZipArchiveWriter<W>,
    level: Compression,
}

impl<W: Write> NpzWriter<W> {
    /// Of packed arrays, or as they are.
    pub(crate) fn new(out: W, packed: bool) -> Self {
        let level = if packed { Compression::new(6) } else { Compression::none() };
        Self { zip: ZipArchiveWriter::new(out), level }
    }

    /// An array of a shape.
    ///
    /// # Errors
    /// Values that do not fill the shape; what the writer says.
    pub(crate) fn add<T: NpyValue>(
        &mut self,
        name: &str,
        shape: &[usize],
        values: impl IntoIterator<Item = T>,
    ) -> io::Result<()> {
        let mut data = Vec::new();
        values.into_iter().for_each(|value| value.put(&mut data));
        self.copy::<T>(name, shape, &mut &data[..])
    }

    /// An array of a shape whose bytes are read one after another, also more than memory holds.
    ///
    /// # Errors
    /// Bytes that do not fill the shape; what reader and writer say.
    pub(crate) fn copy<T: NpyValue>(
        &mut self,
        name: &str,
        shape: &[usize],
        data: &mut impl Read,
    ) -> io::Result<()> {
        let file = self.zip.new_file(format!("{name}.npy"));
        let file = file.compression_method(CompressionMethod::DEFLATE);
        let (mut entry, config) = file.start().map_err(io_error)?;
        let mut out = config.wrap(DeflateEncoder::new(&mut entry, self.level));
        out.write_all(&header(T::KIND, shape))?;
        let count = io::copy(data, &mut out)?;
        if count != (shape.iter().product::<usize>() * size_of::<T>()) as u64 {
            return Err(io::Error::other(format!(
                "array '{name}' does not fill the shape {shape:?}"
            )));
        }
        let (encoder, sums) = out.finish().map_err(io_error)?;
        encoder.finish()?;
        entry.finish(sums).map_err(io_error)?;
        Ok(())
    }

    /// What was written on.
    ///
    /// # Errors
    /// What the writer says.
    pub(crate) fn finish(self) -> io::Result<W> {
        self.zip.finish().map_err(io_error)
    }
}

/// As it came from the file, where it did: a full disk keeps its name.
fn io_error(error: rawzip::Error) -> io::Error {
    match error.into_kind() {
        rawzip::ErrorKind::IO(error) => error,
        other => io::Error::other(other.to_string()),
    }
}

/// The array of a whole `.npy`, whose shape needs exactly the bytes behind it.
fn parse<T: NpyValue, const N: usize>(bytes: &[u8]) -> Result<NpyArray<T, N>, String> {
    let (head, data) = head(bytes).ok_or("has no NumPy header")?;
    let field =
        |name: &str| head.split_once(name).map(|(_, rest)| rest.trim_start_matches([':', ' ']));
    let shape = field("'shape'").and_then(|rest| {
        let (inner, _) = rest.strip_prefix('(')?.split_once(')')?;
        let words = inner.split(',').map(str::trim).filter(|w| !w.is_empty());
        words.map(|w| w.trim_end_matches('L').parse::<usize>().ok()).collect::<Option<Vec<_>>>()
    });
    let shape = shape.ok_or("has no shape")?;
    let needed = shape.iter().try_fold(size_of::<T>(), |n, &d| n.checked_mul(d));
    if needed != Some(data.len()) {
        return Err(format!("states the shape {shape:?}, but holds {} bytes", data.len()));
    }
    // Of nothing there may be rows, but not more than a reader can list.
    if needed == Some(0) && shape.iter().any(|&d| d > MOST_EMPTY) {
        return Err(format!("states the shape {shape:?} of nothing"));
    }
    let dimensions = shape.len();
    let shape: [usize; N] =
        shape.try_into().map_err(|_| format!("has {dimensions} dimensions, expected {N}"))?;
    let kind = field("'descr'").and_then(|rest| rest.strip_prefix('\'')?.split_once('\''));
    let kind = kind.map_or("", |(kind, _)| kind);
    let swapped =
        kind.strip_prefix('>').is_some_and(|rest| T::KIND.strip_prefix('<') == Some(rest));
    if !swapped && kind != T::KIND {
        return Err(format!("holds '{kind}', expected '{}'", T::KIND));
    }
    let value = |bytes: &[u8]| match swapped {
        true => T::of(&bytes.iter().rev().copied().collect::<Vec<u8>>()),
        false => T::of(bytes),
    };
    let values: Option<Vec<T>> = data.chunks_exact(size_of::<T>()).map(value).collect();
    let values = values.ok_or("holds what is no value")?;
    let first_fastest = field("'fortran_order'").is_some_and(|rest| rest.starts_with("True"));
    let values = if first_fastest { last_fastest(&values, &shape) } else { values };
    Ok(NpyArray { shape, values })
}

/// Values of which the first dimension runs fastest, with the last doing so.
fn last_fastest<T: Copy>(values: &[T], shape: &[usize]) -> Vec<T> {
    let at = |mut place: usize| {
        let (mut from, mut step) = (0, values.len());
        for &n in shape.iter().rev() {
            step /= n;
            from += place % n * step;
            place /= n;
        }
        values[from]
    };
    (0..values.len()).map(at).collect()
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

/// The head of a `.npy` file, version 1.0, padded by a byte or more to a multiple of 64 bytes.
pub(crate) fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let dimensions: Vec<String> = shape.iter().map(usize::to_string).collect();
    let comma = if shape.len() == 1 { "," } else { "" };
    let shape = dimensions.join(", ");
    let text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}{comma})}}");
    let length = (10 + text.len() + 2).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{text:<width$}\n", width = length - 1).bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An npz with one array of doubles whose header states a shape.
    fn npz(shape: &str, values: &[f64]) -> Vec<u8> {
        let values: Vec<[u8; 8]> = values.iter().map(|v| v.to_le_bytes()).collect();
        let head = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
        npz_of(&head, &values)
    }

    fn npz_of(text: &str, values: &[[u8; 8]]) -> Vec<u8> {
        let width = (text.len() + 11).next_multiple_of(64) - 11;
        let mut zip = ZipArchiveWriter::new(Vec::new());
        let (mut entry, config) = zip.new_file("a.npy").start().unwrap();
        let mut out = config.wrap(&mut entry);
        out.write_all(b"\x93NUMPY\x01\x00").unwrap();
        out.write_all(&((width + 1) as u16).to_le_bytes()).unwrap();
        out.write_all(format!("{text:<width$}\n").as_bytes()).unwrap();
        values.iter().for_each(|v| out.write_all(v).unwrap());
        let (_, sums) = out.finish().unwrap();
        entry.finish(sums).unwrap();
        zip.finish().unwrap()
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
    fn rows_without_values_are_few() {
        let rows = |shape: &str| Npz::of(npz(shape, &[])).unwrap().array::<f64, 2>("a");
        assert_eq!(rows("(5, 0)").unwrap().shape, [5, 0]);
        let error = rows("(1152921504606846976, 0)").unwrap_err();
        assert!(error.contains("of nothing"), "{error}");
    }

    #[test]
    fn arrays_come_back_whatever_runs_fastest() {
        let mut npz = NpzWriter::new(Vec::new(), true);
        npz.add("a", &[2, 3], [1u16, 2, 3, 4, 5, 600]).unwrap();
        npz.add("b", &[2], [true, false]).unwrap();
        let npz = Npz::of(npz.finish().unwrap()).unwrap();
        assert_eq!(npz.rows("a"), Ok(vec![[1u16, 2, 3], [4, 5, 600]]));
        assert_eq!(npz.list("b"), Ok(vec![true, false]));
        assert!(npz.list::<u16>("a").is_err() && npz.rows::<u16, 2>("a").is_err());
        assert!(npz.list::<u8>("b").unwrap_err().contains("'|b1'"));
        assert_eq!(last_fastest(&[1, 4, 2, 5, 3, 6], &[2, 3]), [1, 2, 3, 4, 5, 6]);
        let other = npz_of(
            "{'descr': '>f8', 'fortran_order': False, 'shape': (1,), }",
            &[1.5f64.to_be_bytes()],
        );
        assert_eq!(read(other), Ok(vec![1.5]));
    }

    #[test]
    fn an_array_that_does_not_fill_its_shape_is_not_written() {
        assert!(NpzWriter::new(Vec::new(), true).add("c", &[3], [1.0f32]).is_err());
        assert!(NpzWriter::new(Vec::new(), false).add("c", &[1], [1.0f32, 2.0]).is_err());
    }

    #[test]
    fn a_changed_byte_is_told() {
        for packed in [true, false] {
            let mut npz = NpzWriter::new(Vec::new(), packed);
            npz.add("a", &[200], (0..200).map(f64::from)).unwrap();
            let mut bytes = npz.finish().unwrap();
            assert!(read(bytes.clone()).is_ok());
            bytes[400] ^= 1;
            assert!(read(bytes).is_err());
        }
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
