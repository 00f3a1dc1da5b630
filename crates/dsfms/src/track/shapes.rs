//! The shapes of all frames in one file, however many there are.

use crate::geometry::Point3;
use crate::io::InputError;
use crate::io::atomic::{WriteError, write_atomic};
use crate::io::npz::{NpyArray, Npz, NpzWriter};
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// Collects shapes on disk and writes them as a compressed npz: `vertices` (frames × vertices × 3,
/// 32-bit floats, NaN where a frame is lost), `visible` (frames × vertices, 8-bit: 1 where the
/// camera sees the vertex) and `status` (frames, 8-bit: 0 ok, 1 degraded, 2 lost).
pub struct ShapeFile {
    path: PathBuf,
    vertices: usize,
    spool: BufWriter<File>,
    visible: BufWriter<File>,
    status: Vec<u8>,
}

impl ShapeFile {
    /// A file for shapes of so many vertices; nothing appears at `path` before
    /// [`finish`](Self::finish).
    ///
    /// # Errors
    /// No temporary file can be made in the folder of `path`.
    pub fn create(path: &Path, vertices: usize) -> Result<Self, WriteError> {
        let fail = |error| WriteError::new(path, error);
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let spool = || tempfile::tempfile_in(folder).map(BufWriter::new).map_err(fail);
        let (spool, visible) = (spool()?, spool()?);
        Ok(Self { path: path.into(), vertices, spool, visible, status: Vec::new() })
    }

    /// The next frame, `None` = lost, with the vertices that are visible, none where that is not
    /// known.
    ///
    /// # Errors
    /// A full disk.
    pub fn push(
        &mut self,
        shape: Option<&[Point3]>,
        visible: &[bool],
        status: u8,
    ) -> Result<(), WriteError> {
        self.status.push(status);
        let seen = |v: usize| u8::from(visible.get(v).copied().unwrap_or(false));
        let seen: Vec<u8> = (0..self.vertices).map(seen).collect();
        self.visible.write_all(&seen).map_err(|e| WriteError::new(&self.path, e))?;
        for v in 0..self.vertices {
            let point = shape.and_then(|s| s.get(v)).map_or([f64::NAN; 3], |p| [p.x, p.y, p.z]);
            for c in point {
                let bytes = (c as f32).to_le_bytes();
                self.spool.write_all(&bytes).map_err(|e| WriteError::new(&self.path, e))?;
            }
        }
        Ok(())
    }

    /// Write the file.
    ///
    /// # Errors
    /// A full disk, a folder that is gone.
    pub fn finish(self) -> Result<(), WriteError> {
        let fail = |error| WriteError::new(&self.path, error);
        let spooled = |spool: BufWriter<File>| -> io::Result<File> {
            let mut file = spool.into_inner().map_err(io::IntoInnerError::into_error)?;
            file.rewind()?;
            Ok(file)
        };
        let mut spools = [spooled(self.spool).map_err(fail)?, spooled(self.visible).map_err(fail)?];
        let frames = self.status.len();
        let mut packed = tempfile::tempfile().map_err(fail)?;
        pack(&mut packed, &mut spools, &self.status, [frames, self.vertices]).map_err(fail)?;
        packed.rewind().map_err(fail)?;
        write_atomic(&self.path, |out| io::copy(&mut packed, out).map(|_| ()))
    }
}

/// Shapes and status of every frame that a [`ShapeFile`] wrote; the shape of a frame that has none
/// is NaN.
///
/// # Errors
/// No file, no `.npz`, arrays that are missing or of other shapes.
pub fn read_shapes(path: &Path) -> Result<(Vec<Vec<Point3>>, Vec<u8>), InputError> {
    let format = |reason: String| InputError::Format { path: path.into(), reason };
    let npz = Npz::open(path).map_err(format)?;
    let shapes: NpyArray<f32, 3> = npz.array("vertices").map_err(format)?;
    let status: Vec<u8> = npz.list("status").map_err(format)?;
    let [frames, vertices, three] = shapes.shape;
    if three != 3 || frames != status.len() {
        return Err(format("vertices is not frames x vertices x 3 of as many as status".into()));
    }
    let point = |p: &[f32; 3]| Point3::from(p.map(f64::from));
    let points: Vec<Point3> = shapes.values.as_chunks().0.iter().map(point).collect();
    let shape = |f: usize| points[f * vertices..(f + 1) * vertices].to_vec();
    Ok(((0..frames).map(shape).collect(), status))
}

fn pack(
    out: &mut File,
    [shapes, visible]: &mut [File; 2],
    status: &[u8],
    [frames, vertices]: [usize; 2],
) -> io::Result<()> {
    let mut npz = NpzWriter::new(BufWriter::new(out), true);
    npz.copy::<f32>("vertices", &[frames, vertices, 3], shapes)?;
    npz.copy::<u8>("visible", &[frames, vertices], visible)?;
    npz.copy::<u8>("status", &[frames], &mut &status[..])?;
    npz.finish()?.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn shapes_come_back_and_lost_frames_are_nan() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let mut file = ShapeFile::create(&path, 2).unwrap();
        file.push(
            Some(&[Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.5)]),
            &[false, true],
            0,
        )
        .unwrap();
        file.push(None, &[], 2).unwrap();
        assert!(!path.exists());
        file.finish().unwrap();
        let (shapes, status) = read_shapes(&path).unwrap();
        assert_eq!((shapes.len(), shapes[0].len()), (2, 2));
        assert_eq!((shapes[0][1].z, shapes[0][0].y), (6.5, 2.0));
        assert!(shapes[1].iter().all(|p| p.coords.iter().all(|v| v.is_nan())));
        assert_eq!(status, [0, 2]);
        let visible: NpyArray<u8, 2> = Npz::open(&path).unwrap().array("visible").unwrap();
        assert_eq!(visible.values, [0, 1, 0, 0]);
    }
}
