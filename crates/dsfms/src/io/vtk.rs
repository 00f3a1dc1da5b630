//! VTK XML PolyData (`.vtp`), as ParaView, 3D Slicer and PyVista read it, and `.pvd`, which strings
//! the files of a sequence together in time for ParaView.

use super::atomic::{WriteError, write_atomic};
use super::base64::base64;
use crate::geometry::Point3;
use crate::mesh::Topology;
use crate::template::LengthUnit;
use std::fmt::Write;
use std::io;
use std::path::Path;

/// Numbers of the vertices or faces under a name.
#[derive(Clone, Copy, Debug)]
pub struct Array<'a> {
    /// Name in the file.
    pub name: &'a str,
    /// One a vertex or face; NaN where there is none.
    pub values: &'a [f64],
}

/// What goes into a file besides the surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct VtkExtras<'a> {
    /// Arrays of the vertices.
    pub vertices: &'a [Array<'a>],
    /// Arrays of the faces.
    pub faces: &'a [Array<'a>],
    /// Time of the frame, seconds: `TimeValue`.
    pub time: Option<f64>,
    /// Header comment, after the unit.
    pub comment: &'a str,
}

/// Write a surface with the topology's vertex and face order, coordinates and arrays as 32-bit
/// floats in base64. A comment says `units mm` or `units template_units`.
///
/// # Errors
/// [`WriteError`] naming the path; also where an array has not one value a vertex or face.
pub fn write_vtp(
    path: &Path,
    topology: &Topology,
    positions: &[Point3],
    unit: LengthUnit,
    extras: &VtkExtras,
) -> Result<(), WriteError> {
    let (n, m) = (topology.vertex_count, topology.faces.len());
    let wrong = |arrays: &[Array], count: usize| arrays.iter().any(|a| a.values.len() != count);
    if positions.len() != n || wrong(extras.vertices, n) || wrong(extras.faces, m) {
        let reason =
            format!("expected {n} vertices and {m} faces, and one value of each array for each");
        return Err(WriteError::new(path, io::Error::new(io::ErrorKind::InvalidInput, reason)));
    }
    let text = document(topology, positions, unit, extras);
    write_atomic(path, |w| w.write_all(text.as_bytes()))
}

fn document(
    topology: &Topology,
    positions: &[Point3],
    unit: LengthUnit,
    extras: &VtkExtras,
) -> String {
    let (n, m) = (topology.vertex_count, topology.faces.len());
    // A comment ends at its first double hyphen.
    let comment = extras.comment.replace("--", "- -");
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<!-- units {}; {comment} -->\n\
         <VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <PolyData>\n",
        unit.label()
    );
    if let Some(time) = extras.time {
        text += "<FieldData>\n";
        array(&mut text, "Float64", "TimeValue", "NumberOfTuples=\"1\"", &time.to_le_bytes());
        text += "</FieldData>\n";
    }
    text += &format!(
        "<Piece NumberOfPoints=\"{n}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" \
         NumberOfPolys=\"{m}\">\n"
    );
    arrays(&mut text, "PointData", extras.vertices);
    arrays(&mut text, "CellData", extras.faces);
    let points: Vec<u8> = positions.iter().flat_map(|p| [p.x, p.y, p.z]).flat_map(single).collect();
    text += "<Points>\n";
    array(&mut text, "Float32", "Points", "NumberOfComponents=\"3\"", &points);
    text += "</Points>\n<Polys>\n";
    let corners: Vec<u8> =
        topology.faces.iter().flatten().flat_map(|&v| i64::from(v).to_le_bytes()).collect();
    array(&mut text, "Int64", "connectivity", "", &corners);
    let ends: Vec<u8> = (1..=m as i64).flat_map(|k| (3 * k).to_le_bytes()).collect();
    array(&mut text, "Int64", "offsets", "", &ends);
    text + "</Polys>\n</Piece>\n</PolyData>\n</VTKFile>\n"
}

fn single(v: f64) -> [u8; 4] {
    (v as f32).to_le_bytes()
}

fn arrays(text: &mut String, place: &str, list: &[Array]) {
    let first = list.first().map_or(String::new(), |a| format!(" Scalars=\"{}\"", a.name));
    let _ = writeln!(text, "<{place}{first}>");
    for a in list {
        let bytes: Vec<u8> = a.values.iter().flat_map(|&v| single(v)).collect();
        array(text, "Float32", a.name, "", &bytes);
    }
    let _ = writeln!(text, "</{place}>");
}

/// The length of the data and the data, encoded as one.
fn array(text: &mut String, kind: &str, name: &str, more: &str, data: &[u8]) {
    let mut bytes = (data.len() as u64).to_le_bytes().to_vec();
    bytes.extend(data);
    let _ = writeln!(
        text,
        "<DataArray type=\"{kind}\" Name=\"{name}\" {more} format=\"binary\">{}</DataArray>",
        base64(&bytes)
    );
}

/// Write a `.pvd`: the time of every file of a sequence, and its name beside this file.
///
/// # Errors
/// [`WriteError`] naming the path.
pub fn write_pvd(path: &Path, frames: &[(f64, String)]) -> Result<(), WriteError> {
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n\
         <Collection>\n",
    );
    for (time, file) in frames {
        let file = file.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
        let _ = writeln!(text, "<DataSet timestep=\"{time}\" part=\"0\" file=\"{file}\"/>");
    }
    text += "</Collection>\n</VTKFile>\n";
    write_atomic(path, |w| w.write_all(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(text: &str, name: &str) -> Vec<u8> {
        let tag = format!("Name=\"{name}\"");
        let after = &text[text.find(&tag).unwrap()..];
        let coded = &after[after.find('>').unwrap() + 1..after.find("</").unwrap()];
        let digit = |c: u8| {
            let all = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
            all.iter().position(|&a| a == c).unwrap_or(0) as u32
        };
        let chunks = coded.as_bytes().chunks(4);
        let words = chunks.map(|c| c.iter().fold(0, |w, &c| w << 6 | digit(c)));
        let bytes: Vec<u8> = words.flat_map(|w| w.to_be_bytes()[1..].to_vec()).collect();
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        bytes[8..8 + length].to_vec()
    }

    #[test]
    fn what_is_written_can_be_decoded() {
        let topology = Topology::new(3, vec![[2, 0, 1]]).unwrap();
        let points = [Point3::new(1.0, 2.0, 3.5), Point3::origin(), Point3::new(0.0, -1.0, 0.0)];
        let values = [0.25, f64::NAN, 8.0];
        let extras = VtkExtras {
            vertices: &[Array { name: "expected_error", values: &values }],
            faces: &[Array { name: "strain", values: &[-0.5] }],
            time: Some(0.04),
            comment: "a -- b",
        };
        let text = document(&topology, &points, LengthUnit::Millimetre, &extras);
        let floats = |name: &str| -> Vec<f32> {
            let bytes = decoded(&text, name);
            bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
        };
        assert_eq!(floats("Points"), [1.0, 2.0, 3.5, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0]);
        let found = floats("expected_error");
        assert!(found[0] == 0.25 && found[1].is_nan() && found[2] == 8.0);
        assert_eq!(floats("strain"), [-0.5]);
        let integers = |name: &str| -> Vec<i64> {
            let bytes = decoded(&text, name);
            bytes.as_chunks::<8>().0.iter().map(|b| i64::from_le_bytes(*b)).collect()
        };
        assert_eq!((integers("connectivity"), integers("offsets")), (vec![2, 0, 1], vec![3]));
        assert_eq!(decoded(&text, "TimeValue"), 0.04f64.to_le_bytes());
        assert!(text.contains("<!-- units mm; a - - b -->"));
    }

    #[test]
    fn an_array_of_another_length_is_refused() {
        let topology = Topology::new(3, vec![[0, 1, 2]]).unwrap();
        let extras =
            VtkExtras { vertices: &[Array { name: "x", values: &[1.0] }], ..Default::default() };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtp");
        let points = [Point3::origin(); 3];
        let error = write_vtp(&path, &topology, &points, LengthUnit::Millimetre, &extras);
        assert!(error.unwrap_err().to_string().contains("3 vertices"));
        assert!(!path.exists());
    }
}
