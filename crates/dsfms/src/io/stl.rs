//! STL: a soup of triangles whose equal corners are merged exactly, in order of first appearance.

use super::atomic::{WriteError, write_atomic};
use super::raw_mesh::{FormatError, MeshUnit, RawMesh};
use crate::geometry::{Point3, normal};
use crate::mesh::Mesh;
use crate::template::LengthUnit;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

/// Binary STL: 80 bytes of comment, the number of triangles, 50 bytes for each.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, FormatError> {
    if !is_ascii(bytes) {
        check_length(bytes)?;
    }
    let mut source = Cursor::new(bytes);
    let triangles = stl_io::create_stl_reader(&mut source)
        .map_err(|e| FormatError::Malformed(e.to_string()))?;
    let mut mesh = RawMesh::default();
    let mut known = BTreeMap::new();
    for triangle in triangles {
        let triangle = triangle.map_err(|e| FormatError::Malformed(e.to_string()))?;
        let corners = triangle.vertices.map(|v| {
            let [x, y, z] = v.0;
            // −0 and 0 are one place.
            *known.entry([x, y, z].map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                mesh.positions.push(Point3::new(x as f64, y as f64, z as f64));
                mesh.positions.len() as u32 - 1
            })
        });
        mesh.faces.push(corners);
    }
    let head = bytes.get(..HEADER - 4).unwrap_or_default();
    let text = String::from_utf8_lossy(head);
    mesh.unit = MeshUnit::from_comment(text.trim_end_matches('\0'));
    Ok(mesh)
}

fn is_ascii(bytes: &[u8]) -> bool {
    // Binary files may begin with "solid" too; only text goes on with "facet" or ends at once.
    let head = &bytes[..bytes.len().min(1024)];
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

/// Write a binary STL (single precision; STL knows no shared vertices, so their order is lost), with
/// `dsfms units …` in its header.
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
