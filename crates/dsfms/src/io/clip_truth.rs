//! The truth of a whole clip in one NumPy `.npz`: `vertices` (frames × vertices × 3, camera axes),
//! `displacement` (frames × vertices), `visible` and `zone` (frames × vertices, bool).

use super::InputError;
use super::atomic::{WriteError, write_atomic};
use super::npz::{NpyArray, Npz, NpzWriter};
use crate::geometry::Point3;
use std::io;
use std::path::Path;

/// One row of every list per frame, 32-bit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClipTruth {
    /// Vertices in camera axes, length units of the mesh.
    pub vertices: Vec<Vec<[f32; 3]>>,
    /// Distance from the place at rest, length units.
    pub displacement: Vec<Vec<f32>>,
    /// Seen by the camera.
    pub visible: Vec<Vec<bool>>,
    /// Of the deformed zone.
    pub zone: Vec<Vec<bool>>,
}

impl ClipTruth {
    /// The next frame.
    pub fn push(
        &mut self,
        vertices: &[Point3],
        displacement: &[f64],
        visible: &[bool],
        zone: &[bool],
    ) {
        let single = |p: &Point3| [p.x as f32, p.y as f32, p.z as f32];
        self.vertices.push(vertices.iter().map(single).collect());
        self.displacement.push(displacement.iter().map(|&d| d as f32).collect());
        self.visible.push(visible.to_vec());
        self.zone.push(zone.to_vec());
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.vertices.len()
    }
}

/// Write a truth as [`read_clip_truth`] reads it.
///
/// # Errors
/// Frames of different vertex counts; a folder that cannot be written.
pub fn write_clip_truth(path: &Path, truth: &ClipTruth) -> Result<(), WriteError> {
    let bytes = pack(truth).map_err(|error| WriteError::new(path, error))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

fn pack(truth: &ClipTruth) -> io::Result<Vec<u8>> {
    let shape = [truth.frames(), truth.vertices.first().map_or(0, Vec::len)];
    let flat = truth.vertices.iter().flatten().flatten().copied();
    let mut npz = NpzWriter::new(Vec::new(), true);
    npz.add("vertices", &[shape[0], shape[1], 3], flat)?;
    npz.add("displacement", &shape, truth.displacement.concat())?;
    npz.add("visible", &shape, truth.visible.concat())?;
    npz.add("zone", &shape, truth.zone.concat())?;
    npz.finish()
}

/// Read a truth.
///
/// # Errors
/// No file, no `.npz`, an array that is missing, of another shape than `vertices` says, or not
/// finite.
pub fn read_clip_truth(path: &Path) -> Result<ClipTruth, InputError> {
    let wrong = |reason: String| InputError::format(path, reason);
    let npz = Npz::open(path).map_err(wrong)?;
    let vertices: NpyArray<f32, 3> = npz.array("vertices").map_err(wrong)?;
    let displacement: NpyArray<f32, 2> = npz.array("displacement").map_err(wrong)?;
    let visible: NpyArray<bool, 2> = npz.array("visible").map_err(wrong)?;
    let zone: NpyArray<bool, 2> = npz.array("zone").map_err(wrong)?;
    let [_, n, three] = vertices.shape;
    let shapes = [displacement.shape, visible.shape, zone.shape];
    if three != 3 || shapes.iter().any(|s| *s != vertices.shape[..2]) {
        let reason = "vertices (frames x vertices x 3), displacement, visible and zone (frames x \
                      vertices) differ in shape";
        return Err(InputError::Format { path: path.into(), reason: reason.into() });
    }
    for (name, values) in [("vertices", &vertices.values), ("displacement", &displacement.values)] {
        if values.iter().any(|v| !v.is_finite()) {
            return Err(wrong(format!("array '{name}' holds a number that is not finite")));
        }
    }
    Ok(ClipTruth {
        vertices: rows(vertices.values.as_chunks().0, vertices.shape[0], n),
        displacement: rows(&displacement.values, vertices.shape[0], n),
        visible: rows(&visible.values, vertices.shape[0], n),
        zone: rows(&zone.values, vertices.shape[0], n),
    })
}

/// Values in rows of `n`, of which there may be none.
fn rows<T: Clone>(values: &[T], count: usize, n: usize) -> Vec<Vec<T>> {
    (0..count).map(|row| values[row * n..(row + 1) * n].to_vec()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_truth_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.npz");
        let mut truth = ClipTruth::default();
        let points = [Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.5)];
        truth.push(&points, &[0.0, 0.5], &[true, false], &[false, true]);
        truth.push(&points, &[1.0, 2.5], &[false; 2], &[true; 2]);
        write_clip_truth(&path, &truth).unwrap();
        assert_eq!(read_clip_truth(&path).unwrap(), truth);
        let mut lost = truth.clone();
        lost.vertices[1][0][2] = f32::NAN;
        write_clip_truth(&path, &lost).unwrap();
        let error = read_clip_truth(&path).unwrap_err().to_string();
        assert!(error.contains("'vertices'") && error.contains("not finite"), "{error}");
        truth.zone[1].pop();
        assert!(write_clip_truth(&path, &truth).is_err());
        std::fs::write(&path, "x").unwrap();
        assert!(read_clip_truth(&path).unwrap_err().to_string().contains("npz"));
    }
}
