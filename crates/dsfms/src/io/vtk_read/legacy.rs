//! Legacy `.vtk`: a title, then keywords with arrays, as text or as big-endian numbers.

use super::super::raw_mesh::{FormatError, RawMesh};
use super::{MOST, malformed, surface};

/// The bytes that are left.
struct LegacyReader<'a> {
    bytes: &'a [u8],
    binary: bool,
}

pub(in super::super) fn read(bytes: &[u8]) -> Result<RawMesh, FormatError> {
    let mut reader = LegacyReader { bytes, binary: false };
    let version = reader.line();
    if !version.starts_with("# vtk DataFile") {
        return malformed("its first line is not '# vtk DataFile Version …'");
    }
    let title = reader.line();
    reader.binary = match reader.line().trim().to_ascii_uppercase().as_str() {
        "ASCII" => false,
        "BINARY" => true,
        other => return malformed(format!("expected ASCII or BINARY, found '{other}'")),
    };
    let (mut points, mut polygons) = (None, None);
    while let Some(line) = reader.keyword() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["DATASET", "POLYDATA"] => {}
            ["DATASET", kind] => {
                return malformed(format!("it holds a {kind}; expected POLYDATA (a surface)"));
            }
            ["POINTS", count, kind] => {
                let count = number(count)?.saturating_mul(3);
                points = Some(reader.floats(count, kind)?);
            }
            ["POLYGONS", count, size] => {
                polygons = Some(reader.polygons(number(count)?, number(size)?)?);
            }
            ["TRIANGLE_STRIPS", ..] => {
                return malformed("it holds triangle strips; export it as triangles");
            }
            // What follows the surface says how it looks; lines and vertices before it are passed
            // over.
            ["POINT_DATA" | "CELL_DATA", ..] => break,
            _ => {}
        }
    }
    let Some(points) = points else { return malformed("it has no POINTS") };
    let Some((corners, ends)) = polygons else { return malformed("it has no POLYGONS") };
    let mut mesh = surface(&points, &corners, &ends)?;
    mesh.state_unit(&title);
    Ok(mesh)
}

fn number(word: &str) -> Result<usize, FormatError> {
    match word.parse() {
        Ok(n) if n <= MOST => Ok(n),
        _ => malformed(format!("expected a count of at most {MOST}, found '{word}'")),
    }
}

impl LegacyReader<'_> {
    fn line(&mut self) -> String {
        let end = self.bytes.iter().position(|&b| b == b'\n').unwrap_or(self.bytes.len());
        let line = String::from_utf8_lossy(&self.bytes[..end]).trim_end().to_string();
        self.bytes = self.bytes.get(end + 1..).unwrap_or_default();
        line
    }

    /// The next line that begins with a keyword in capitals.
    fn keyword(&mut self) -> Option<String> {
        while !self.bytes.is_empty() {
            let line = self.line();
            let word = line.split_whitespace().next().unwrap_or_default();
            let capital = |b: u8| b.is_ascii_uppercase() || b == b'_';
            if word.len() > 3 && word.bytes().all(capital) {
                return Some(line);
            }
        }
        None
    }

    fn floats(&mut self, count: usize, kind: &str) -> Result<Vec<f64>, FormatError> {
        match kind {
            _ if !self.binary => self.words(count),
            "float" => self.numbers(count, |b| f64::from(f32::from_be_bytes(b))),
            "double" => self.numbers(count, f64::from_be_bytes),
            other => malformed(format!("its points are of type {other}; expected float or double")),
        }
    }

    fn integers(&mut self, count: usize, kind: &str) -> Result<Vec<i64>, FormatError> {
        match kind {
            _ if !self.binary => self.words(count),
            "int" => self.numbers(count, |b| i64::from(i32::from_be_bytes(b))),
            "vtktypeint64" | "long" => self.numbers(count, i64::from_be_bytes),
            other => malformed(format!("its corners are of type {other}; expected int or int64")),
        }
    }

    /// Numbers of `N` bytes each, and the line end behind them.
    fn numbers<const N: usize, T>(
        &mut self,
        count: usize,
        value: impl Fn([u8; N]) -> T,
    ) -> Result<Vec<T>, FormatError> {
        let size = count.saturating_mul(N);
        let Some((own, rest)) = self.bytes.split_at_checked(size) else {
            return Err(FormatError::Truncated(format!("an array of {count} numbers")));
        };
        self.bytes = rest.strip_prefix(b"\n").unwrap_or(rest);
        Ok(own.as_chunks::<N>().0.iter().map(|&bytes| value(bytes)).collect())
    }

    /// Numbers in words, over as many lines as they take.
    fn words<T: std::str::FromStr>(&mut self, count: usize) -> Result<Vec<T>, FormatError> {
        let mut values = Vec::new();
        while values.len() < count {
            let start = self.bytes.iter().position(|b| !b.is_ascii_whitespace());
            self.bytes = start.map_or(&[][..], |start| &self.bytes[start..]);
            if self.bytes.is_empty() {
                let at = values.len();
                return Err(FormatError::Truncated(format!("number {at} of {count} of an array")));
            }
            let end = self.bytes.iter().position(u8::is_ascii_whitespace);
            let (word, rest) = self.bytes.split_at(end.unwrap_or(self.bytes.len()));
            self.bytes = rest;
            let word = String::from_utf8_lossy(word);
            match word.parse() {
                Ok(value) => values.push(value),
                Err(_) => return malformed(format!("expected a number, found '{word:.40}'")),
            }
        }
        Ok(values)
    }

    /// Corners and ends of the polygons: each a count and its corners, or, from version 5 on, two
    /// arrays.
    fn polygons(&mut self, count: usize, size: usize) -> Result<(Vec<i64>, Vec<i64>), FormatError> {
        let before = self.bytes;
        let line = self.line();
        if let ["OFFSETS", kind] = line.split_whitespace().collect::<Vec<_>>()[..] {
            let ends = self.integers(count, kind)?;
            let line = self.keyword().unwrap_or_default();
            let ["CONNECTIVITY", kind] = line.split_whitespace().collect::<Vec<_>>()[..] else {
                return malformed(format!("expected CONNECTIVITY, found '{line:.40}'"));
            };
            let corners = self.integers(size, kind)?;
            return Ok((corners, ends.into_iter().skip(1).collect()));
        }
        self.bytes = before;
        let list = self.integers(size, "int")?;
        let (mut corners, mut ends, mut rest) = (Vec::new(), Vec::new(), list.as_slice());
        while let Some((&n, behind)) = rest.split_first() {
            let polygon = usize::try_from(n).ok().and_then(|n| behind.split_at_checked(n));
            let Some((polygon, behind)) = polygon else {
                return malformed(format!("a polygon of {n} corners reaches beyond its list"));
            };
            corners.extend(polygon);
            ends.push(corners.len() as i64);
            rest = behind;
        }
        match ends.len() == count {
            true => Ok((corners, ends)),
            false => malformed(format!("it states {count} polygons, but {} are there", ends.len())),
        }
    }
}
