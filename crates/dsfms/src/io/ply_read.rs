//! Reading PLY: ascii, binary little and big endian, any scalar types, further properties kept.

use super::raw_mesh::{FormatError, RawMesh, fan, polygon_warning};
use crate::geometry::{Point2, Point3};
use std::collections::BTreeMap;

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Clone, Copy)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

struct Property {
    name: String,
    value: Scalar,
    /// Type of the length of a list property.
    length: Option<Scalar>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct PlyHeader {
    encoding: Encoding,
    elements: Vec<Element>,
    comments: Vec<String>,
}

fn malformed<T>(reason: String) -> Result<T, FormatError> {
    Err(FormatError::Malformed(reason))
}

pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, FormatError> {
    let (header, start) = header(bytes)?;
    let mut body = PlyBody { bytes, at: start, encoding: header.encoding };
    let mut mesh = RawMesh::default();
    header.comments.iter().for_each(|comment| mesh.state_unit(comment));
    let mut faces = Faces::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => vertices(element, &mut body, &mut mesh)?,
            "face" => faces = read_faces(element, &mut body)?,
            _ => body.skip(element)?,
        }
    }
    faces.finish(&mut mesh);
    Ok(mesh)
}

fn header(bytes: &[u8]) -> Result<(PlyHeader, usize), FormatError> {
    let mut header =
        PlyHeader { encoding: Encoding::Ascii, elements: Vec::new(), comments: Vec::new() };
    let mut at = 0;
    loop {
        let Some(length) = bytes[at..].iter().position(|&b| b == b'\n') else {
            return Err(FormatError::Truncated("the PLY header (no 'end_header')".into()));
        };
        let line = String::from_utf8_lossy(&bytes[at..at + length]).trim().to_string();
        if at == 0 && line != "ply" {
            return malformed("it does not begin with the line 'ply'".into());
        }
        at += length + 1;
        if line == "end_header" {
            // Rows of nothing could be counted for ever.
            let bare = |e: &&Element| e.properties.is_empty() && e.count > 0;
            return match header.elements.iter().find(bare) {
                None => Ok((header, at)),
                Some(e) => malformed(format!("element '{}' has no property", e.name)),
            };
        }
        header_line(&mut header, &line)?;
    }
}

fn header_line(header: &mut PlyHeader, line: &str) -> Result<(), FormatError> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words.as_slice() {
        ["format", "ascii", _] => header.encoding = Encoding::Ascii,
        ["format", "binary_little_endian", _] => header.encoding = Encoding::Little,
        ["format", "binary_big_endian", _] => header.encoding = Encoding::Big,
        ["comment" | "obj_info", ..] => {
            header.comments.push(line.to_owned());
        }
        ["element", name, count] => {
            let Ok(count) = count.parse() else {
                return malformed(format!("'{line}' does not state a count"));
            };
            header.elements.push(Element { name: name.to_string(), count, properties: Vec::new() });
        }
        ["property", "list", length, value, name] => {
            push_property(header, line, name, scalar(value)?, Some(scalar(length)?))?;
        }
        ["property", value, name] => push_property(header, line, name, scalar(value)?, None)?,
        ["ply"] | [] => {}
        _ => return malformed(format!("unknown PLY header line '{line}'")),
    }
    Ok(())
}

fn push_property(
    header: &mut PlyHeader,
    line: &str,
    name: &str,
    value: Scalar,
    length: Option<Scalar>,
) -> Result<(), FormatError> {
    let Some(element) = header.elements.last_mut() else {
        return malformed(format!("'{line}' comes before any element"));
    };
    element.properties.push(Property { name: name.to_string(), value, length });
    Ok(())
}

fn scalar(name: &str) -> Result<Scalar, FormatError> {
    Ok(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return malformed(format!("unknown PLY type '{name}'")),
    })
}

/// The data after the header.
struct PlyBody<'a> {
    bytes: &'a [u8],
    at: usize,
    encoding: Encoding,
}

/// `None` = the file ended.
type Read<T> = Result<Option<T>, FormatError>;

impl PlyBody<'_> {
    fn scalar(&mut self, kind: Scalar) -> Read<f64> {
        if self.encoding == Encoding::Ascii {
            return self.word();
        }
        Ok(match kind {
            Scalar::I8 => self.take().map(|b| i8::from_le_bytes(b) as f64),
            Scalar::U8 => self.take().map(|b| u8::from_le_bytes(b) as f64),
            Scalar::I16 => self.take().map(|b| i16::from_le_bytes(b) as f64),
            Scalar::U16 => self.take().map(|b| u16::from_le_bytes(b) as f64),
            Scalar::I32 => self.take().map(|b| i32::from_le_bytes(b) as f64),
            Scalar::U32 => self.take().map(|b| u32::from_le_bytes(b) as f64),
            Scalar::F32 => self.take().map(|b| f32::from_le_bytes(b) as f64),
            Scalar::F64 => self.take().map(f64::from_le_bytes),
        })
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let mut value: [u8; N] = self.bytes.get(self.at..self.at + N)?.try_into().ok()?;
        self.at += N;
        if self.encoding == Encoding::Big {
            value.reverse();
        }
        Some(value)
    }

    fn word(&mut self) -> Read<f64> {
        let rest = &self.bytes[self.at..];
        let Some(begin) = rest.iter().position(|b| !b.is_ascii_whitespace()) else {
            return Ok(None);
        };
        let end = rest[begin..].iter().position(u8::is_ascii_whitespace);
        let end = begin + end.unwrap_or(rest.len() - begin);
        self.at += end;
        let word = String::from_utf8_lossy(&rest[begin..end]);
        match word.parse() {
            Ok(value) => Ok(Some(value)),
            Err(_) => {
                let word: String = word.chars().take(40).collect();
                malformed(format!("expected a number, found '{word}'"))
            }
        }
    }

    fn list(&mut self, length: Scalar, value: Scalar) -> Read<Vec<f64>> {
        let Some(n) = self.scalar(length)? else { return Ok(None) };
        if !(0.0..=1e6).contains(&n) {
            return malformed(format!("a list of {n} values; the file is damaged"));
        }
        (0..n as usize).map(|_| self.scalar(value)).collect()
    }

    fn skip(&mut self, element: &Element) -> Result<(), FormatError> {
        for row in 0..element.count {
            for property in &element.properties {
                let found = match property.length {
                    Some(length) => self.list(length, property.value)?.is_some(),
                    None => self.scalar(property.value)?.is_some(),
                };
                if !found {
                    return Err(ended(element, row));
                }
            }
        }
        Ok(())
    }
}

fn ended(element: &Element, row: usize) -> FormatError {
    FormatError::Truncated(format!("{} {row} of {}", element.name, element.count))
}

fn vertices(element: &Element, body: &mut PlyBody, mesh: &mut RawMesh) -> Result<(), FormatError> {
    let mut columns: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for row in 0..element.count {
        for property in &element.properties {
            if let Some(length) = property.length {
                body.list(length, property.value)?.ok_or_else(|| ended(element, row))?;
                continue;
            }
            let value = body.scalar(property.value)?.ok_or_else(|| ended(element, row))?;
            match columns.get_mut(&property.name) {
                Some(column) => column.push(value),
                None => _ = columns.insert(property.name.clone(), vec![value]),
            }
        }
    }
    let axes = ["x", "y", "z"].map(|axis| columns.remove(axis));
    let [Some(x), Some(y), Some(z)] = axes else {
        if element.count == 0 {
            return Ok(());
        }
        return malformed("its vertices lack x, y or z".into());
    };
    // What files of earlier versions call it.
    if let Some(errors) = columns.remove("confidence") {
        columns.entry("expected_error".into()).or_insert(errors);
    }
    mesh.positions = (0..element.count).map(|i| Point3::new(x[i], y[i], z[i])).collect();
    mesh.attributes = columns;
    Ok(())
}

#[derive(Default)]
struct Faces {
    corners: Vec<[u32; 3]>,
    /// Wedge UV of each triangle, where its face had them.
    uv: Vec<Option<[Point2; 3]>>,
    polygons: usize,
}

fn read_faces(element: &Element, body: &mut PlyBody) -> Result<Faces, FormatError> {
    let mut faces = Faces::default();
    for row in 0..element.count {
        let (mut corners, mut wedge) = (None, Vec::new());
        for property in &element.properties {
            let Some(length) = property.length else {
                body.scalar(property.value)?.ok_or_else(|| ended(element, row))?;
                continue;
            };
            let list = body.list(length, property.value)?.ok_or_else(|| ended(element, row))?;
            match property.name.as_str() {
                "vertex_indices" | "vertex_index" => corners = Some(list),
                "texcoord" => wedge = list,
                _ => {}
            }
        }
        let Some(corners) = corners else {
            return malformed("its faces lack the list 'vertex_indices'".into());
        };
        faces.push(row, &corners, &wedge)?;
    }
    Ok(faces)
}

impl Faces {
    fn push(&mut self, row: usize, corners: &[f64], wedge: &[f64]) -> Result<(), FormatError> {
        if corners.len() < 3 {
            return malformed(format!("face {row} has {} corners, expected 3", corners.len()));
        }
        if let Some(bad) = corners.iter().find(|c| !(c.fract() == 0.0 && **c >= 0.0 && **c < 4e9)) {
            return malformed(format!("face {row} names vertex {bad}"));
        }
        let corners: Vec<u32> = corners.iter().map(|&c| c as u32).collect();
        self.polygons += usize::from(corners.len() > 3);
        for triangle in fan(&corners) {
            self.corners.push(triangle.map(|k| corners[k]));
            let uv = |k: usize| Point2::new(wedge[2 * k], wedge[2 * k + 1]);
            self.uv.push((wedge.len() == 2 * corners.len()).then(|| triangle.map(uv)));
        }
        Ok(())
    }

    fn finish(self, mesh: &mut RawMesh) {
        if self.polygons > 0 {
            mesh.warnings.push(polygon_warning(self.polygons));
        }
        mesh.uv = self.uv.into_iter().collect::<Option<Vec<_>>>().filter(|uv| !uv.is_empty());
        mesh.faces = self.corners;
        if mesh.uv.is_some() {
            return;
        }
        for [u, v] in [["texture_u", "texture_v"], ["s", "t"], ["u", "v"]] {
            if let (Some(u), Some(v)) = (mesh.attributes.get(u), mesh.attributes.get(v)) {
                let corner = |i: u32| Some(Point2::new(*u.get(i as usize)?, *v.get(i as usize)?));
                let faces = mesh.faces.iter().map(|f| {
                    let [a, b, c] = f.map(corner);
                    Some([a?, b?, c?])
                });
                mesh.uv = faces.collect();
                return;
            }
        }
    }
}
