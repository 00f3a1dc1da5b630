//! XML `.vtp`: one piece with points and polygons. Tags are looked for in order, nothing else of
//! XML.

use super::super::base64::from_base64;
use super::super::raw_mesh::{FormatError, RawMesh};
use super::{MOST, malformed, surface};
use flate2::read::ZlibDecoder;
use std::io::Read;

/// Most bytes of one array, unpacked.
const MOST_BYTES: usize = 8 * MOST;

/// What the file says of its arrays.
struct Layout<'a> {
    big: bool,
    /// Bytes of the numbers before data.
    word: usize,
    compressed: bool,
    /// Behind the underscore of `AppendedData`, and whether it is base64.
    appended: Option<(&'a [u8], bool)>,
}

pub(in super::super) fn read(bytes: &[u8]) -> Result<RawMesh, FormatError> {
    let (text, appended) = parts(bytes);
    let Some(root) = tag(text, "VTKFile") else { return malformed("it has no VTKFile") };
    if attribute(root, "type") != Some("PolyData") {
        let kind = attribute(root, "type").unwrap_or("nothing");
        return malformed(format!("it holds {kind}; expected PolyData (a surface)"));
    }
    let compressor = attribute(root, "compressor");
    if let Some(other) = compressor.filter(|c| *c != "vtkZLibDataCompressor") {
        return malformed(format!("it is packed by {other}; write it with zlib or without"));
    }
    let layout = Layout {
        big: attribute(root, "byte_order") == Some("BigEndian"),
        word: if attribute(root, "header_type") == Some("UInt64") { 8 } else { 4 },
        compressed: compressor.is_some(),
        appended,
    };
    if text.matches("<Piece").count() > 1 {
        return malformed("it has several pieces; expected one");
    }
    let points = array(section(text, "Points")?, None)?;
    let polys = section(text, "Polys")?;
    let corners = array(polys, Some("connectivity"))?;
    let ends = array(polys, Some("offsets"))?;
    let whole = |values: Vec<f64>| values.into_iter().map(|v| v as i64).collect::<Vec<i64>>();
    let mut mesh = surface(
        &layout.numbers(points)?,
        &whole(layout.numbers(corners)?),
        &whole(layout.numbers(ends)?),
    )?;
    let comment = text.split("<!--").nth(1).and_then(|rest| rest.split("-->").next());
    comment.iter().for_each(|comment| mesh.state_unit(comment));
    Ok(mesh)
}

/// The text before appended data, and the data.
fn parts(bytes: &[u8]) -> (&str, Option<(&[u8], bool)>) {
    let name = b"<AppendedData";
    let at = bytes.windows(name.len()).position(|w| w == name);
    let (head, tail) = bytes.split_at(at.unwrap_or(bytes.len()));
    let text = match std::str::from_utf8(head) {
        Ok(text) => text,
        // What is not text has no tags that are known.
        Err(error) => std::str::from_utf8(&head[..error.valid_up_to()]).unwrap_or_default(),
    };
    let appended = tail.iter().position(|&b| b == b'>').and_then(|end| {
        let coded = String::from_utf8_lossy(&tail[..end]).contains("base64");
        let data = &tail[end + 1..];
        let start = data.iter().position(|&b| b == b'_')?;
        Some((&data[start + 1..], coded))
    });
    (text, appended)
}

/// The inside of the first tag of a name.
fn tag<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let open = format!("<{name}");
    let at = text.match_indices(&open).map(|(at, _)| at + open.len());
    let mut starts = at
        .filter_map(|at| text.get(at..))
        .filter(|rest| rest.starts_with(|c: char| c.is_whitespace() || c == '>' || c == '/'));
    starts.next()?.split('>').next()
}

fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let words =
        tag.split_once(&format!(" {name}=")).or_else(|| tag.split_once(&format!("\n{name}=")))?;
    let quote = words.1.chars().next().filter(|c| matches!(c, '"' | '\''))?;
    words.1[1..].split(quote).next()
}

fn section<'a>(text: &'a str, name: &str) -> Result<&'a str, FormatError> {
    let inside = text
        .split_once(&format!("<{name}>"))
        .and_then(|(_, rest)| rest.split_once(&format!("</{name}>")))
        .map(|(inside, _)| inside);
    inside.ok_or_else(|| FormatError::Truncated(format!("its {name}, which has no end")))
}

/// Tag and content of the first array, or of that of a name.
fn array<'a>(section: &'a str, name: Option<&str>) -> Result<(&'a str, &'a str), FormatError> {
    let arrays = section.split("<DataArray").skip(1).filter_map(|part| part.split_once('>'));
    let named = |tag: &str| name.is_none_or(|name| attribute(tag, "Name") == Some(name));
    match arrays.into_iter().find(|(tag, _)| named(tag)) {
        Some((tag, rest)) => Ok((tag, rest.split('<').next().unwrap_or_default())),
        None => malformed(format!("it has no DataArray {}", name.unwrap_or("of points"))),
    }
}

impl Layout<'_> {
    fn numbers(&self, (tag, text): (&str, &str)) -> Result<Vec<f64>, FormatError> {
        let kind = attribute(tag, "type").unwrap_or_default();
        match attribute(tag, "format").unwrap_or("ascii") {
            "ascii" => text
                .split_whitespace()
                .map(|word| {
                    word.parse().or_else(|_| malformed(format!("'{word:.40}' is no number")))
                })
                .collect(),
            "binary" => self.decoded(&self.coded(text.trim())?, kind),
            "appended" => {
                let offset = attribute(tag, "offset").and_then(|o| o.trim().parse::<usize>().ok());
                let found = self
                    .appended
                    .zip(offset)
                    .and_then(|((bytes, coded), at)| Some((bytes.get(at..)?, coded)));
                let Some((data, coded)) = found else {
                    return Err(FormatError::Truncated("its appended data".into()));
                };
                if !coded {
                    return self.decoded(data, kind);
                }
                let digit = |b: &&u8| b.is_ascii_alphanumeric() || matches!(b, b'+' | b'/' | b'=');
                let end = data.iter().take_while(digit).count();
                self.decoded(&self.coded(&String::from_utf8_lossy(&data[..end]))?, kind)
            }
            other => malformed(format!("an array is written as {other}, which is not read")),
        }
    }

    /// Base64, whose header and data may be coded one after the other.
    fn coded(&self, text: &str) -> Result<Vec<u8>, FormatError> {
        let bad = || FormatError::Malformed("an array is not base64".into());
        let mut bytes = Vec::new();
        let mut rest = text;
        // Padding ends a coded part; what stands behind it is another one.
        while !rest.is_empty() {
            let end = rest.find('=').map_or(rest.len(), |at| {
                at + rest[at..].bytes().take_while(|&b| b == b'=').count()
            });
            bytes.extend(from_base64(&rest[..end]).ok_or_else(bad)?);
            rest = rest[end..].trim_start();
        }
        Ok(bytes)
    }

    /// A number of the header.
    fn header(&self, bytes: &[u8], k: usize) -> Result<usize, FormatError> {
        let word = bytes.get(k * self.word..(k + 1) * self.word);
        let word = word.ok_or_else(|| FormatError::Truncated("the header of an array".into()))?;
        let add = |n: u64, b: &u8| n << 8 | u64::from(*b);
        let value = match self.big {
            true => word.iter().fold(0, add),
            false => word.iter().rev().fold(0, add),
        };
        match usize::try_from(value) {
            Ok(n) if n <= MOST_BYTES => Ok(n),
            _ => malformed(format!("an array of {value} bytes")),
        }
    }

    /// The data behind its header: its length, or blocks that are packed.
    fn decoded(&self, bytes: &[u8], kind: &str) -> Result<Vec<f64>, FormatError> {
        let cut = || FormatError::Truncated("an array".into());
        if !self.compressed {
            let length = self.header(bytes, 0)?;
            let data = bytes.get(self.word..).and_then(|d| d.get(..length)).ok_or_else(cut)?;
            return self.values(data, kind);
        }
        let blocks = self.header(bytes, 0)?;
        let mut at = blocks.saturating_add(3).saturating_mul(self.word);
        if at > bytes.len() {
            return Err(cut());
        }
        let mut data = Vec::new();
        for k in 0..blocks {
            let length = self.header(bytes, 3 + k)?;
            let block = bytes.get(at..).and_then(|rest| rest.get(..length)).ok_or_else(cut)?;
            let room = (MOST_BYTES - data.len()) as u64 + 1;
            let read = ZlibDecoder::new(block).take(room).read_to_end(&mut data);
            read.map_err(|error| FormatError::Malformed(format!("a packed array: {error}")))?;
            if data.len() > MOST_BYTES {
                return malformed("an array is larger than can be");
            }
            at += length;
        }
        self.values(&data, kind)
    }

    fn values(&self, data: &[u8], kind: &str) -> Result<Vec<f64>, FormatError> {
        fn each<const N: usize>(data: &[u8], big: bool, value: fn([u8; N]) -> f64) -> Vec<f64> {
            let turned = |mut bytes: [u8; N]| {
                if big {
                    bytes.reverse();
                }
                value(bytes)
            };
            data.as_chunks::<N>().0.iter().map(|&bytes| turned(bytes)).collect()
        }
        Ok(match kind {
            "Float32" => each(data, self.big, |b| f64::from(f32::from_le_bytes(b))),
            "Float64" => each(data, self.big, f64::from_le_bytes),
            "Int32" => each(data, self.big, |b| f64::from(i32::from_le_bytes(b))),
            "UInt32" => each(data, self.big, |b| f64::from(u32::from_le_bytes(b))),
            "Int64" => each(data, self.big, |b| i64::from_le_bytes(b) as f64),
            "UInt64" => each(data, self.big, |b| u64::from_le_bytes(b) as f64),
            other => return malformed(format!("an array of type {other}, which is not read")),
        })
    }
}
