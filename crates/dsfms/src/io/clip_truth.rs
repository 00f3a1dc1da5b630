//! The truth of a whole clip in one NumPy `.npz`: `vertices` (frames × vertices × 3, camera axes),
//! `displacement` (frames × vertices), `visible` and `zone` (frames × vertices, bool).

use super::InputError;
use super::atomic::{WriteError, write_atomic};
use super::npz::Npz;
use crate::geometry::Point3;
use ndarray::{Array2, Array3};
use ndarray_npy::{NpzWriter, WriteNpzError};
use std::io::Cursor;
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
    let bytes = pack(truth)
        .map_err(|error| WriteError::new(path, std::io::Error::other(error.to_string())))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

fn pack(truth: &ClipTruth) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let shape = [truth.frames(), truth.vertices.first().map_or(0, Vec::len)];
    let flat = truth.vertices.iter().flatten().flatten().copied().collect();
    let vertices = Array3::from_shape_vec((shape[0], shape[1], 3), flat)?;
    let displacement = Array2::from_shape_vec(shape, truth.displacement.concat())?;
    let visible = Array2::from_shape_vec(shape, truth.visible.concat())?;
    let zone = Array2::from_shape_vec(shape, truth.zone.concat())?;
    let mut buffer = Cursor::new(Vec::new());
    let mut npz = NpzWriter::new_compressed(&mut buffer);
    let mut add = || -> Result<(), WriteNpzError> {
        npz.add_array("vertices", &vertices)?;
        npz.add_array("displacement", &displacement)?;
        npz.add_array("visible", &visible)?;
        npz.add_array("zone", &zone)
    };
    add()?;
    npz.finish()?;
    Ok(buffer.into_inner())
}

/// Read a truth.
///
/// # Errors
/// No file, no `.npz`, an array that is missing or of another shape than `vertices` says.
pub fn read_clip_truth(path: &Path) -> Result<ClipTruth, InputError> {
    let wrong = |reason: String| InputError::format(path, reason);
    let mut npz = Npz::open(path).map_err(wrong)?;
    let vertices: Array3<f32> = npz.array("vertices").map_err(wrong)?;
    let displacement: Array2<f32> = npz.array("displacement").map_err(wrong)?;
    let visible: Array2<bool> = npz.array("visible").map_err(wrong)?;
    let zone: Array2<bool> = npz.array("zone").map_err(wrong)?;
    let expected = &vertices.shape()[..2];
    let shapes = [displacement.shape(), visible.shape(), zone.shape()];
    if vertices.shape()[2] != 3 || shapes.iter().any(|s| *s != expected) {
        let reason = "vertices (frames x vertices x 3), displacement, visible and zone (frames x \
                      vertices) differ in shape";
        return Err(InputError::Format { path: path.into(), reason: reason.into() });
    }
    let frame = |f: ndarray::ArrayView2<f32>| f.outer_iter().map(|p| [p[0], p[1], p[2]]).collect();
    Ok(ClipTruth {
        vertices: vertices.outer_iter().map(frame).collect(),
        displacement: displacement.outer_iter().map(|f| f.to_vec()).collect(),
        visible: visible.outer_iter().map(|f| f.to_vec()).collect(),
        zone: zone.outer_iter().map(|f| f.to_vec()).collect(),
    })
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
        truth.zone[1].pop();
        assert!(write_clip_truth(&path, &truth).is_err());
        std::fs::write(&path, "x").unwrap();
        assert!(read_clip_truth(&path).unwrap_err().to_string().contains("npz"));
    }
}
