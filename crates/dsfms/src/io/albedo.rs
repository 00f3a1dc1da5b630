//! A known albedo: an sRGB picture in the mesh's UV, or a CSV with one value per vertex.

use super::images::decode_bytes;
use crate::guard;
use crate::image::{ColorImage, ToneCurve};
use std::path::{Path, PathBuf};

/// Why an albedo file cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AlbedoFileError {
    /// Missing, unreadable or damaged.
    #[error("cannot read albedo {}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        reason: String,
    },
    /// A line that is not one or three numbers in `[0, 1]`.
    #[error("albedo {} line {line}: expected one (grey) or three (r,g,b) linear values in [0, 1], found '{text}'", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// 1-based line.
        line: usize,
        /// Its text.
        text: String,
    },
    /// Not one line per vertex.
    #[error("albedo {} has {found} values, the mesh has {expected} vertices; expected one line per vertex in the mesh's order", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Vertices of the mesh.
        expected: usize,
        /// Lines found.
        found: usize,
    },
}

/// Read an 8-bit albedo picture as linear RGB (the file is taken to be sRGB-encoded).
///
/// # Errors
/// A file that is missing or no picture.
pub fn read_albedo_image(path: &Path) -> Result<ColorImage, AlbedoFileError> {
    let wrong = |reason| AlbedoFileError::Unreadable { path: path.into(), reason };
    let bytes = guard::read(path).map_err(|e| wrong(e.to_string()))?;
    let picture = decode_bytes(&bytes).map_err(wrong)?.to_rgb8();
    let table = ToneCurve::Srgb.table();
    let size = [picture.width() as usize, picture.height() as usize];
    let data = picture.pixels().map(|p| p.0.map(|v| table[v as usize])).collect();
    Ok(ColorImage { size, data })
}

/// Read one linear value (`grey`, or `r,g,b`) per vertex, in `[0, 1]`, in the mesh's order. A first
/// line that is no number is a header; empty lines and lines with `#` are skipped.
///
/// # Errors
/// A file that is missing, a line that is no value in `[0, 1]`, or another number of values.
pub fn read_albedo_csv(path: &Path, vertices: usize) -> Result<Vec<[f32; 3]>, AlbedoFileError> {
    let text = guard::read_text(path)
        .map_err(|e| AlbedoFileError::Unreadable { path: path.into(), reason: e.to_string() })?;
    let mut values = Vec::new();
    let mut first = true;
    for (k, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let header = std::mem::take(&mut first) && line.starts_with(|c: char| c.is_alphabetic());
        match parse(line) {
            Some(value) => values.push(value),
            None if header => {}
            None => {
                let (path, text) = (path.into(), line.chars().take(60).collect());
                return Err(AlbedoFileError::Line { path, line: k + 1, text });
            }
        }
    }
    if values.len() != vertices {
        let (path, found) = (path.into(), values.len());
        return Err(AlbedoFileError::Count { path, expected: vertices, found });
    }
    Ok(values)
}

fn parse(line: &str) -> Option<[f32; 3]> {
    let numbers: Option<Vec<f32>> = line
        .split([',', ';', ' ', '\t'])
        .filter(|w| !w.is_empty())
        .map(|w| w.parse().ok().filter(|v| (0.0..=1.0).contains(v)))
        .collect();
    match numbers?.as_slice() {
        [grey] => Some([*grey; 3]),
        [r, g, b] => Some([*r, *g, *b]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_by_hand() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("albedo.csv");
        std::fs::write(&path, "albedo\n0.5\n\n0.1, 0.2, 0.3\n").unwrap();
        assert_eq!(read_albedo_csv(&path, 2).unwrap(), [[0.5; 3], [0.1, 0.2, 0.3]]);
        let count = read_albedo_csv(&path, 3).unwrap_err();
        assert!(matches!(count, AlbedoFileError::Count { expected: 3, found: 2, .. }));
        for bad in ["nan", "1.5", "0.1,0.2", "x"] {
            std::fs::write(&path, format!("0.5\n{bad}\n")).unwrap();
            let error = read_albedo_csv(&path, 2).unwrap_err();
            assert!(matches!(error, AlbedoFileError::Line { line: 2, .. }), "{error}");
        }
        assert!(read_albedo_image(&folder.path().join("no.png")).is_err());
    }
}
