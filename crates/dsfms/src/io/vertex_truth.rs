//! What is known of every vertex of a true mesh: `visible` (bool) and `displacement` (length
//! units) in a NumPy `.npz`.

use super::InputError;
use super::atomic::{WriteError, write_atomic};
use super::npz::{Npz, NpzWriter};
use std::path::{Path, PathBuf};

/// One entry per vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VertexTruth {
    /// Seen by the camera.
    pub visible: Vec<bool>,
    /// Distance from the place at rest, length units of the mesh.
    pub displacement: Vec<f64>,
}

/// `<stem>_vertices.npz` beside a mesh file.
pub fn vertex_truth_path(mesh: &Path) -> PathBuf {
    let stem = mesh.file_stem().unwrap_or_default().to_string_lossy();
    mesh.with_file_name(format!("{stem}_vertices.npz"))
}

/// Read `visible` and `displacement`.
///
/// # Errors
/// A file that is missing, damaged, or without these arrays, or a displacement that is not finite.
pub fn read_vertex_truth(path: &Path) -> Result<VertexTruth, InputError> {
    let wrong = |reason: String| InputError::format(path, reason);
    let npz = Npz::open(path).map_err(wrong)?;
    let displacement: Vec<f32> = npz.list("displacement").map_err(wrong)?;
    if displacement.iter().any(|d| !d.is_finite()) {
        return Err(wrong("array 'displacement' holds a number that is not finite".into()));
    }
    Ok(VertexTruth {
        visible: npz.list("visible").map_err(wrong)?,
        displacement: displacement.into_iter().map(f64::from).collect(),
    })
}

/// Write `visible` and `displacement` as [`read_vertex_truth`] reads them.
///
/// # Errors
/// A file that cannot be written.
pub fn write_vertex_truth(path: &Path, truth: &VertexTruth) -> Result<(), WriteError> {
    let pack = || {
        let mut npz = NpzWriter::new(Vec::new(), false);
        npz.add("visible", &[truth.visible.len()], truth.visible.iter().copied())?;
        npz.add(
            "displacement",
            &[truth.displacement.len()],
            truth.displacement.iter().map(|&d| d as f32),
        )?;
        npz.finish()
    };
    let bytes = pack().map_err(|error| WriteError::new(path, error))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_what_numpy_writes_and_names_what_is_missing() {
        let folder = tempfile::tempdir().unwrap();
        let path = vertex_truth_path(&folder.path().join("frame_001.ply"));
        assert!(path.ends_with("frame_001_vertices.npz"));
        let write = |with_displacement: bool| {
            let mut npz = NpzWriter::new(Vec::new(), false);
            npz.add("visible", &[2], [true, false]).unwrap();
            if with_displacement {
                npz.add("displacement", &[2], [0.5f32, 2.0]).unwrap();
            }
            std::fs::write(&path, npz.finish().unwrap()).unwrap();
        };
        write(true);
        let truth = read_vertex_truth(&path).unwrap();
        assert_eq!((truth.visible, truth.displacement), (vec![true, false], vec![0.5, 2.0]));
        write(false);
        assert!(read_vertex_truth(&path).unwrap_err().to_string().contains("displacement"));
        let lost = VertexTruth { visible: vec![true], displacement: vec![f64::NAN] };
        write_vertex_truth(&path, &lost).unwrap();
        assert!(read_vertex_truth(&path).unwrap_err().to_string().contains("not finite"));
    }

    #[test]
    fn written_truth_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frame_000_vertices.npz");
        let truth =
            VertexTruth { visible: vec![true, false, true], displacement: vec![0.0, 1.5, 2.25] };
        write_vertex_truth(&path, &truth).unwrap();
        assert_eq!(read_vertex_truth(&path).unwrap(), truth);
    }
}
