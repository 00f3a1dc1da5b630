//! OFF: counts, vertices, polygons, as text.

use super::raw_mesh::{FormatError, RawMesh, fan, polygon_warning};
use crate::geometry::Point3;

/// Numbers behind the corners of a face (its colour) are left out, as are those behind a vertex in
/// `COFF` and `NOFF` files.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, FormatError> {
    let text = String::from_utf8_lossy(bytes);
    let mut mesh = RawMesh::default();
    for comment in text.lines().filter_map(|line| line.trim_start().strip_prefix('#')) {
        mesh.state_unit(comment);
    }
    let mut lines = text
        .lines()
        .map(|line| line.split('#').next().unwrap_or_default().trim())
        .filter(|line| !line.is_empty());
    let head = lines.next().unwrap_or_default();
    let rest = head.trim_start_matches(['C', 'N', 'S', 'T']);
    let Some(rest) = rest.strip_prefix("OFF") else {
        return malformed("its first line is not OFF".into());
    };
    if rest.contains("BINARY") {
        return malformed("it is a binary OFF, which is not read; export it as text".into());
    }
    // The counts may stand on the first line.
    let counts = match rest.trim() {
        "" => lines.next().unwrap_or_default(),
        counts => counts,
    };
    let counts: Vec<usize> = counts.split_whitespace().map_while(|n| n.parse().ok()).collect();
    let [vertices, faces, ..] = counts[..] else {
        return malformed("it has no counts of vertices and faces".into());
    };
    for k in 0..vertices {
        let line = line(lines.next(), "vertex", k, vertices)?;
        let numbers: Vec<f64> = line.split_whitespace().map_while(|n| n.parse().ok()).collect();
        let [x, y, z, ..] = numbers[..] else {
            return malformed(format!("vertex {k}: expected three numbers, found '{line}'"));
        };
        mesh.positions.push(Point3::new(x, y, z));
    }
    let mut polygons = 0;
    for k in 0..faces {
        let line = line(lines.next(), "face", k, faces)?;
        let mut numbers = line.split_whitespace().map_while(|n| n.parse::<u32>().ok());
        let count = numbers.next().unwrap_or_default() as usize;
        let corners: Vec<u32> = numbers.take(count).collect();
        if count < 3 || corners.len() < count {
            return malformed(format!(
                "face {k}: expected a count and its corners, found '{line}'"
            ));
        }
        polygons += usize::from(count > 3);
        mesh.faces.extend(fan(&corners).map(|f| f.map(|c| corners[c])));
    }
    if polygons > 0 {
        mesh.warnings.push(polygon_warning(polygons));
    }
    Ok(mesh)
}

fn line<'a>(
    line: Option<&'a str>,
    what: &str,
    k: usize,
    count: usize,
) -> Result<&'a str, FormatError> {
    line.ok_or_else(|| FormatError::Truncated(format!("{what} {k} of {count}")))
}

fn malformed<T>(reason: String) -> Result<T, FormatError> {
    Err(FormatError::Malformed(reason))
}

#[cfg(test)]
mod tests {
    use super::super::mesh::{MeshUnit, parse_mesh};
    use std::path::Path;

    fn read(text: &str) -> Result<super::super::mesh::MeshFile, String> {
        parse_mesh(text.as_bytes(), Path::new("a.off")).map_err(|error| error.to_string())
    }

    #[test]
    fn vertices_polygons_and_colours() {
        let text =
            "OFF\n# units cm\n4 1 0\n0 0 0 # first\n\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n";
        let file = read(text).unwrap();
        assert_eq!(file.mesh.topology.faces, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!((file.mesh.positions[2].y, file.unit), (1.0, Some(MeshUnit::Centimetre)));
        let coloured = "COFF 3 1 3\n0 0 0 9 9 9 1\n1 0 0 9 9 9 1\n0 1 0 9 9 9 1\n3 0 1 2\n";
        assert_eq!(read(coloured).unwrap().mesh.positions.len(), 3);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, word) in [
            ("PLY\n", "not OFF"),
            ("OFF\n", "no counts"),
            ("OFF\n3 1 0\n0 0 0\n", "within vertex 1 of 3"),
            ("OFF\n1 1 0\n0 zero 0\n", "vertex 0: expected three"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "face 0: expected"),
            ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "vertex 9"),
            ("OFF\n99999999999 9 0\n", "within vertex 0"),
        ] {
            let found = read(text).unwrap_err();
            assert!(found.contains(word), "{word}: {found}");
        }
    }
}
