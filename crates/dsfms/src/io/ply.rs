//! Writing PLY: binary little endian, the unit in a header comment, optional vertex attributes.

use super::atomic::{WriteError, write_atomic};
use crate::geometry::{Point3, Vector3};
use crate::mesh::Topology;
use crate::template::LengthUnit;
use crate::verdict::Region;
use std::io::{self, Write};
use std::path::Path;

/// Number type of the coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 32 bits: what most tools expect; 4 nm at 50 mm.
    #[default]
    Single,
    /// 64 bits: nothing is lost.
    Double,
}

/// What goes into a PLY besides the surface; everything optional.
#[derive(Clone, Debug, Default)]
pub struct PlyExtras<'a> {
    /// Number type of the coordinates.
    pub precision: Precision,
    /// Further header comments, after `comment units …`.
    pub comments: &'a [String],
    /// Per vertex `visible` (uchar 0 or 1).
    pub visible: Option<&'a [bool]>,
    /// Per vertex `expected_error` (float): the expected error in length units.
    pub expected_error: Option<&'a [f64]>,
    /// Per vertex `observed` (uchar 0 or 1): something in the frame spoke of the vertex.
    pub observed: Option<&'a [bool]>,
    /// Per vertex `region` (uchar), numbered as [`Region`].
    pub region: Option<&'a [Region]>,
    /// Per vertex `nx ny nz` (float), unit length.
    pub normals: Option<&'a [Vector3]>,
    /// Per vertex `red green blue` (uchar).
    pub color: Option<&'a [[u8; 3]]>,
}

/// Write a surface with the topology's vertex and face order. The header says `comment units mm`
/// or `comment units template_units`. Written to a temporary file, then renamed.
///
/// # Errors
/// [`WriteError`] naming the path; also where an attribute has not one value per vertex.
///
/// ```
/// use dsfms::io::{mesh::read_mesh, ply::{PlyExtras, write_ply}};
/// use dsfms::{LengthUnit, synth::patch};
///
/// let mesh = patch(60, 1).mesh;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("organ.ply");
/// write_ply(&path, &mesh.topology, &mesh.positions, LengthUnit::Millimetre, &PlyExtras::default())?;
/// assert_eq!(read_mesh(&path)?.mesh.topology, mesh.topology);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
pub fn write_ply(
    path: &Path,
    topology: &Topology,
    positions: &[Point3],
    unit: LengthUnit,
    extras: &PlyExtras,
) -> Result<(), WriteError> {
    let n = topology.vertex_count;
    let lengths = [
        Some(positions.len()),
        extras.visible.map(<[_]>::len),
        extras.expected_error.map(<[_]>::len),
        extras.observed.map(<[_]>::len),
        extras.region.map(<[_]>::len),
        extras.normals.map(<[_]>::len),
        extras.color.map(<[_]>::len),
    ];
    if let Some(found) = lengths.into_iter().flatten().find(|&length| length != n) {
        let reason = format!("{found} values per vertex for {n} vertices");
        return Err(WriteError::new(path, io::Error::new(io::ErrorKind::InvalidInput, reason)));
    }
    write_atomic(path, |w| {
        header(w, topology, unit, extras)?;
        (0..n).try_for_each(|i| vertex(w, i, &positions[i], extras))?;
        for face in &topology.faces {
            w.write_all(&[3])?;
            face.iter().try_for_each(|&v| w.write_all(&(v as i32).to_le_bytes()))?;
        }
        Ok(())
    })
}

fn header(
    w: &mut dyn Write,
    topology: &Topology,
    unit: LengthUnit,
    extras: &PlyExtras,
) -> io::Result<()> {
    write!(w, "ply\nformat binary_little_endian 1.0\ncomment units {}\n", unit.label())?;
    for line in extras.comments.iter().flat_map(|c| c.lines()) {
        writeln!(w, "comment {line}")?;
    }
    let real = if extras.precision == Precision::Double { "double" } else { "float" };
    writeln!(w, "element vertex {}", topology.vertex_count)?;
    for axis in ["x", "y", "z"] {
        writeln!(w, "property {real} {axis}")?;
    }
    if extras.normals.is_some() {
        write!(w, "property float nx\nproperty float ny\nproperty float nz\n")?;
    }
    if extras.color.is_some() {
        write!(w, "property uchar red\nproperty uchar green\nproperty uchar blue\n")?;
    }
    if extras.visible.is_some() {
        writeln!(w, "property uchar visible")?;
    }
    if extras.expected_error.is_some() {
        writeln!(w, "property float expected_error")?;
    }
    if extras.observed.is_some() {
        writeln!(w, "property uchar observed")?;
    }
    if extras.region.is_some() {
        writeln!(w, "property uchar region")?;
    }
    writeln!(w, "element face {}", topology.faces.len())?;
    write!(w, "property list uchar int vertex_indices\nend_header\n")
}

fn vertex(w: &mut dyn Write, i: usize, p: &Point3, extras: &PlyExtras) -> io::Result<()> {
    for &x in p.iter() {
        match extras.precision {
            Precision::Single => w.write_all(&(x as f32).to_le_bytes())?,
            Precision::Double => w.write_all(&x.to_le_bytes())?,
        }
    }
    for &x in extras.normals.iter().flat_map(|normals| normals[i].iter()) {
        w.write_all(&(x as f32).to_le_bytes())?;
    }
    if let Some(color) = extras.color {
        w.write_all(&color[i])?;
    }
    if let Some(visible) = extras.visible {
        w.write_all(&[u8::from(visible[i])])?;
    }
    if let Some(expected_error) = extras.expected_error {
        w.write_all(&(expected_error[i] as f32).to_le_bytes())?;
    }
    if let Some(observed) = extras.observed {
        w.write_all(&[u8::from(observed[i])])?;
    }
    if let Some(region) = extras.region {
        w.write_all(&[region[i] as u8])?;
    }
    Ok(())
}
