//! STL: a soup of triangles whose equal corners are merged exactly, in order of first appearance.

use super::atomic::{WriteError, write_atomic};
use super::raw_mesh::{FormatError, RawMesh};
use crate::geometry::{Point3, normal};
use crate::mesh::Mesh;
use crate::template::LengthUnit;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::Path;

/// Binary STL: 80 bytes of comment, the number of triangles, 50 bytes for each.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, FormatError> {
    let text = is_ascii(bytes);
    let corners = if text { ascii_corners(bytes)? } else { binary_corners(bytes)? };
    let mut mesh = RawMesh::default();
    let mut known = BTreeMap::new();
    let vertices = corners.into_iter().map(|corner| {
        // −0 and 0 are one place.
        *known.entry(corner.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
            mesh.positions.push(Point3::from(corner.map(f64::from)));
            mesh.positions.len() as u32 - 1
        })
    });
    mesh.faces = vertices.collect::<Vec<u32>>().as_chunks().0.to_vec();
    let head = bytes.get(..HEADER - 4).unwrap_or_default();
    let head = if text { head.split(|&b| b == b'\n').next().unwrap_or_default() } else { head };
    mesh.state_unit(String::from_utf8_lossy(head).trim_end_matches('\0'));
    Ok(mesh)
}

/// Corners of the facets of every solid, three a facet.
fn ascii_corners(bytes: &[u8]) -> Result<Vec<[f32; 3]>, FormatError> {
    let text = String::from_utf8_lossy(bytes);
    let (mut corners, mut in_loop, mut ended) = (Vec::new(), 0, false);
    for (k, line) in text.lines().enumerate() {
        let wrong = |what: String| FormatError::Malformed(format!("line {}: {what}", k + 1));
        let mut words = line.split_whitespace();
        match words.next().unwrap_or_default().to_ascii_lowercase().as_str() {
            "solid" => ended = false,
            "endsolid" => ended = true,
            "outer" => in_loop = 0,
            "endloop" | "endfacet" if in_loop != 3 => {
                return Err(wrong(format!("a facet has {in_loop} corners, expected 3")));
            }
            "" | "facet" | "endloop" | "endfacet" => {}
            "vertex" => {
                let numbers: Vec<f32> = words.map_while(|word| word.parse().ok()).collect();
                let corner =
                    numbers.try_into().map_err(|_| wrong("expected three numbers".into()))?;
                corners.push(corner);
                in_loop += 1;
            }
            word => return Err(wrong(format!("'{word}' is no word of an STL file"))),
        }
    }
    match ended {
        true => Ok(corners),
        false => Err(FormatError::Truncated("the line 'endsolid'".into())),
    }
}

/// Corners of the triangles, three each.
fn binary_corners(bytes: &[u8]) -> Result<Vec<[f32; 3]>, FormatError> {
    check_length(bytes)?;
    let number = |b: &[u8; 4]| f32::from_le_bytes(*b);
    let triangles = bytes[HEADER..].as_chunks::<TRIANGLE>().0.iter();
    // Twelve numbers, of which the first three are the normal.
    let corners = triangles.flat_map(|t| {
        let numbers: Vec<f32> = t[..48].as_chunks().0.iter().map(number).collect();
        numbers[3..].as_chunks().0.to_vec()
    });
    Ok(corners.collect())
}

fn is_ascii(bytes: &[u8]) -> bool {
    // Binary files may begin with "solid" too; only text goes on with "facet" or ends at once.
    let head = bytes[..bytes.len().min(1024)].to_ascii_lowercase();
    head.trim_ascii_start().starts_with(b"solid")
        && head.iter().all(|&b| b < 128 && b != 0)
        && head.windows(5).any(|w| w == b"facet" || w == b"endso")
}

fn check_length(bytes: &[u8]) -> Result<(), FormatError> {
    let Some(count) = bytes.get(80..HEADER) else {
        return Err(FormatError::Truncated("the 84-byte header of a binary STL".into()));
    };
    let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize;
    let found = (bytes.len() - HEADER) / TRIANGLE;
    match found.cmp(&count) {
        Ordering::Less => Err(FormatError::Truncated(format!("triangle {found} of {count}"))),
        Ordering::Greater => Err(FormatError::Malformed(format!(
            "its header states {count} triangles, but {found} are there; export it again"
        ))),
        Ordering::Equal => Ok(()),
    }
}

/// Write a binary STL (single precision; STL knows no shared vertices, so their order is lost),
/// with `dsfms units …` in its header.
///
/// # Errors
/// A file that cannot be written.
pub fn write_stl(path: &Path, mesh: &Mesh, unit: LengthUnit) -> Result<(), WriteError> {
    write_atomic(path, |w| {
        // Not "solid", which would be text; the unit where a reader of ours looks for it.
        let mut head = [0; HEADER - 4];
        let text = format!("dsfms units {}", unit.label());
        head[..text.len()].copy_from_slice(text.as_bytes());
        w.write_all(&head)?;
        w.write_all(&(mesh.topology.faces.len() as u32).to_le_bytes())?;
        for f in 0..mesh.topology.faces.len() {
            let corners = mesh.corners(f);
            let n = normal(corners[0], corners[1], corners[2]).unwrap_or_default();
            let floats = n.iter().copied().chain(corners.iter().flat_map(|p| p.iter().copied()));
            for x in floats.collect::<Vec<f64>>() {
                w.write_all(&(x as f32).to_le_bytes())?;
            }
            w.write_all(&[0; 2])?;
        }
        Ok(())
    })
}
