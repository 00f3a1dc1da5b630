//! Numbers out of the buffers of a glTF file.

use super::super::base64::from_base64;
use super::super::raw_mesh::FormatError;
use super::document::{Accessor, Document, SparsePart, malformed};
use crate::guard;
use std::borrow::Cow;
use std::path::{Component, Path};

/// Most vertices and most faces of all primitives together, each as often as nodes place it.
pub(super) const MOST: usize = 5_000_000;

/// The arrays of a document.
pub(super) struct Arrays<'a> {
    document: &'a Document,
    buffers: Vec<Cow<'a, [u8]>>,
}

/// Equal steps through a buffer.
struct Steps<'a> {
    bytes: &'a [u8],
    stride: usize,
    count: usize,
}

const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// Bytes of a number.
fn width(kind: u32) -> Result<usize, FormatError> {
    match kind {
        5120 | UNSIGNED_BYTE => Ok(1),
        5122 | UNSIGNED_SHORT => Ok(2),
        UNSIGNED_INT | FLOAT => Ok(4),
        _ => Err(malformed(format!("component type {kind} does not exist"))),
    }
}

impl<'a> Arrays<'a> {
    pub(super) fn new(
        document: &'a Document,
        chunk: Option<&'a [u8]>,
        path: &Path,
    ) -> Result<Self, FormatError> {
        let mut buffers = Vec::new();
        let mut total = 0;
        for (k, buffer) in document.buffers.iter().enumerate() {
            let bytes = match (&buffer.uri, chunk) {
                (Some(uri), _) => Cow::Owned(load(uri, path)?),
                (None, Some(chunk)) if k == 0 => Cow::Borrowed(chunk),
                _ => return Err(malformed(format!("buffer {k} is nowhere"))),
            };
            total += bytes.len() as u64;
            if total > guard::MOST_BYTES {
                return Err(malformed("its buffers are larger than 1 GiB"));
            }
            if bytes.len() < buffer.byte_length {
                return Err(FormatError::Truncated(format!(
                    "its buffers (buffer {k} holds {} of {} bytes)",
                    bytes.len(),
                    buffer.byte_length
                )));
            }
            buffers.push(bytes);
        }
        Ok(Self { document, buffers })
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor, FormatError> {
        let found = self.document.accessors.get(index);
        found.ok_or_else(|| malformed(format!("accessor {index} does not exist")))
    }

    /// Entries of an accessor as it states them.
    pub(super) fn count(&self, accessor: usize) -> Result<usize, FormatError> {
        Ok(self.accessor(accessor)?.count)
    }

    /// Vectors of `N` numbers; whole numbers where the file says that they are fractions of their
    /// range.
    pub(super) fn floats<const N: usize>(
        &self,
        index: usize,
        name: &str,
    ) -> Result<Vec<[f64; N]>, FormatError> {
        let accessor = self.accessor(index)?;
        let kind = accessor.component_type;
        let fraction = accessor.normalized && [UNSIGNED_BYTE, UNSIGNED_SHORT].contains(&kind);
        let wanted = if N == 1 { "SCALAR".into() } else { format!("VEC{N}") };
        if accessor.kind != wanted || !(kind == FLOAT || fraction) {
            return Err(malformed(format!(
                "{name} is {} of component type {kind}; expected {wanted} of floats",
                accessor.kind
            )));
        }
        let vector = |bytes: &[u8]| -> [f64; N] {
            let size = bytes.len() / N;
            std::array::from_fn(|k| number(&bytes[k * size..(k + 1) * size], kind))
        };
        self.values(accessor, N, vector)
    }

    /// Whole numbers.
    pub(super) fn indices(&self, index: usize) -> Result<Vec<u32>, FormatError> {
        let accessor = self.accessor(index)?;
        let kind = accessor.component_type;
        if accessor.kind != "SCALAR"
            || ![UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT].contains(&kind)
        {
            return Err(malformed(format!(
                "indices are {} of component type {kind}; expected SCALAR of unsigned numbers",
                accessor.kind
            )));
        }
        self.values(accessor, 1, whole)
    }

    /// The values of an accessor, those that it replaces among them.
    fn values<T: Clone>(
        &self,
        accessor: &Accessor,
        numbers: usize,
        value: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, FormatError> {
        let size = numbers * width(accessor.component_type)?;
        let mut values: Vec<T> = match accessor.buffer_view {
            Some(view) => {
                let steps = self.steps(view, accessor.byte_offset, size, accessor.count)?;
                steps.each(size).map(&value).collect()
            }
            // Without a view all are zero, and only what follows gives values.
            None => vec![value(&vec![0; size]); accessor.count.min(MOST)],
        };
        let Some(sparse) = &accessor.sparse else {
            return match accessor.buffer_view {
                Some(_) => Ok(values),
                None => Err(malformed("an accessor has neither a buffer view nor sparse values")),
            };
        };
        let narrow = width(sparse.indices.component_type.unwrap_or(UNSIGNED_INT))?;
        let part = |part: &SparsePart, size| {
            self.steps(part.buffer_view, part.byte_offset, size, sparse.count)
        };
        let (places, news) = (part(&sparse.indices, narrow)?, part(&sparse.values, size)?);
        for (place, new) in places.each(narrow).zip(news.each(size)) {
            let place = whole(place) as usize;
            let Some(old) = values.get_mut(place) else {
                return Err(malformed(format!("a sparse value replaces number {place}")));
            };
            *old = value(new);
        }
        Ok(values)
    }

    /// `count` entries of `size` bytes, all within their view and buffer.
    fn steps(
        &self,
        view: usize,
        offset: usize,
        size: usize,
        count: usize,
    ) -> Result<Steps<'_>, FormatError> {
        let beyond = || {
            let reason = "reach beyond the bytes of their buffer";
            malformed(format!("{count} entries of {size} bytes in buffer view {view} {reason}"))
        };
        let found = self.document.buffer_views.get(view);
        let found = found.ok_or_else(|| malformed(format!("buffer view {view} does not exist")))?;
        let buffer = self.buffers.get(found.buffer);
        let buffer =
            buffer.ok_or_else(|| malformed(format!("buffer {} does not exist", found.buffer)))?;
        let end = found.byte_offset.checked_add(found.byte_length).ok_or_else(beyond)?;
        let bytes = buffer.get(found.byte_offset..end).ok_or_else(beyond)?;
        let bytes = bytes.get(offset..).ok_or_else(beyond)?;
        let stride = found.byte_stride.unwrap_or(size);
        if stride < size || stride > 252.max(size) {
            return Err(malformed(format!("buffer view {view} has stride {stride}")));
        }
        let needed =
            count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(size));
        if needed.is_none_or(|needed| needed > bytes.len()) {
            return Err(beyond());
        }
        Ok(Steps { bytes, stride, count })
    }
}

impl<'a> Steps<'a> {
    fn each(&self, size: usize) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let (bytes, stride) = (self.bytes, self.stride);
        (0..self.count).map(move |k| &bytes[k * stride..k * stride + size])
    }
}

/// Little-endian, by its length.
fn whole(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |n, &b| n << 8 | u32::from(b))
}

fn number(bytes: &[u8], kind: u32) -> f64 {
    match kind {
        UNSIGNED_BYTE => f64::from(whole(bytes)) / 255.0,
        UNSIGNED_SHORT => f64::from(whole(bytes)) / 65535.0,
        _ => f64::from(f32::from_bits(whole(bytes))),
    }
}

/// A buffer within the JSON, or a file below the folder of the document.
fn load(uri: &str, path: &Path) -> Result<Vec<u8>, FormatError> {
    if let Some(data) = uri.strip_prefix("data:") {
        let text = data.split_once(";base64,").map(|(_, text)| text);
        return text.and_then(from_base64).ok_or_else(|| malformed("a data URI is not base64"));
    }
    let name =
        unescaped(uri).ok_or_else(|| malformed(format!("the buffer {uri:?} has no name")))?;
    let outside = || {
        malformed(format!(
            "the buffer {uri:?} lies outside the folder of the file, and is not read"
        ))
    };
    let relative = Path::new(&name);
    if uri.contains(':') || !relative.components().all(|c| matches!(c, Component::Normal(_))) {
        return Err(outside());
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = folder.join(relative);
    let missing = |e: std::io::Error| FormatError::Truncated(format!("its buffers ({name}: {e})"));
    // A link may lead out again.
    let (root, real) = (folder.canonicalize(), file.canonicalize());
    if !real.map_err(missing)?.starts_with(root.map_err(missing)?) {
        return Err(outside());
    }
    guard::read(&file).map_err(missing)
}

/// Without percent signs (RFC 3986).
fn unescaped(uri: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = uri.as_bytes();
    while let Some((&first, behind)) = rest.split_first() {
        rest = behind;
        if first != b'%' {
            bytes.push(first);
            continue;
        }
        let (digits, behind) = rest.split_at_checked(2)?;
        bytes.push(u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?);
        rest = behind;
    }
    String::from_utf8(bytes).ok().filter(|name| !name.is_empty() && !name.contains('\0'))
}
