//! Reading VTK PolyData: legacy `.vtk` (text and binary, versions 2 to 5) and XML `.vtp` (inline
//! text and base64; appended base64 and raw; plain and zlib-compressed). Points and polygons are
//! read, and a unit in a comment or title.

mod legacy;
mod xml;

use super::raw_mesh::{FormatError, RawMesh, fan, polygon_warning};
use crate::geometry::Point3;
pub(super) use legacy::read as read_legacy;
pub(super) use xml::read as read_xml;

/// Most numbers of one array.
const MOST: usize = 50_000_000;

fn malformed<T>(reason: impl Into<String>) -> Result<T, FormatError> {
    Err(FormatError::Malformed(reason.into()))
}

/// Points and polygons as a mesh; `ends`: where in `corners` each polygon ends.
fn surface(points: &[f64], corners: &[i64], ends: &[i64]) -> Result<RawMesh, FormatError> {
    let (points, rest) = points.as_chunks::<3>();
    if !rest.is_empty() {
        return malformed("its points are not three numbers each");
    }
    let mut mesh = RawMesh {
        positions: points.iter().map(|&p| Point3::from(p)).collect(),
        ..RawMesh::default()
    };
    let mut corner = Vec::with_capacity(corners.len());
    for &c in corners {
        match u32::try_from(c) {
            Ok(c) => corner.push(c),
            Err(_) => return malformed(format!("a polygon names vertex {c}")),
        }
    }
    let (mut start, mut polygons) = (0, 0);
    for &end in ends {
        let polygon = usize::try_from(end).ok().and_then(|end| corner.get(start..end));
        let Some(polygon) = polygon else {
            return malformed(format!("a polygon ends at corner {end} of {}", corner.len()));
        };
        if polygon.len() < 3 {
            return malformed(format!("a polygon has {} corners", polygon.len()));
        }
        polygons += usize::from(polygon.len() > 3);
        mesh.faces.extend(fan(polygon).map(|f| f.map(|k| polygon[k])));
        start += polygon.len();
    }
    if polygons > 0 {
        mesh.warnings.push(polygon_warning(polygons));
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests;
