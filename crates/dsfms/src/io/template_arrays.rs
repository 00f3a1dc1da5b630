//! The NumPy files of a template.

use super::atomic::{WriteError, write_atomic};
use super::npz;
use super::template_error::{TemplateFileError, expect};
use crate::geometry::Point2;
use crate::mesh::Topology;
use crate::template::{Features, Flattening, SurfaceTexels};
use ndarray::{Array, Array2, Array3, Dimension};
use ndarray_npy::{NpzWriter, ReadableElement, WritableElement};
use std::io::{self, Cursor, Write};
use std::path::Path;

/// An npz under construction.
struct OpenArrays(NpzWriter<Cursor<Vec<u8>>>);

impl OpenArrays {
    fn write(
        path: &Path,
        fill: impl FnOnce(&mut Self) -> io::Result<()>,
    ) -> Result<(), WriteError> {
        let mut npz = Self(NpzWriter::new_compressed(Cursor::new(Vec::new())));
        fill(&mut npz).map_err(|e| WriteError::new(path, e))?;
        let bytes = npz.0.finish().map_err(|e| WriteError::new(path, io::Error::other(e)))?;
        write_atomic(path, |w: &mut dyn Write| w.write_all(bytes.get_ref()))
    }

    fn add<T: WritableElement + Clone, D: Dimension>(
        &mut self,
        name: &str,
        shape: impl ndarray::IntoDimension<Dim = D>,
        values: Vec<T>,
    ) -> io::Result<()> {
        let array =
            Array::from_shape_vec(shape.into_dimension(), values).map_err(io::Error::other)?;
        self.0.add_array(name, &array).map_err(io::Error::other)
    }
}

/// An npz being read; every failure names the file and the array.
struct ArrayReader<'a> {
    path: &'a Path,
    npz: npz::Npz,
}

impl<'a> ArrayReader<'a> {
    fn open(path: &'a Path) -> Result<Self, TemplateFileError> {
        let npz = npz::Npz::open(path).map_err(|reason| damaged(path, reason))?;
        Ok(Self { path, npz })
    }

    fn array<T: ReadableElement, D: Dimension>(
        &mut self,
        name: &str,
    ) -> Result<Array<T, D>, TemplateFileError> {
        self.npz.array(name).map_err(|reason| damaged(self.path, reason))
    }

    fn list<T: ReadableElement>(&mut self, name: &str) -> Result<Vec<T>, TemplateFileError> {
        self.npz.list(name).map_err(|reason| damaged(self.path, reason))
    }

    /// Rows of an `n × N` array.
    fn rows<T: ReadableElement + Copy + Default, const N: usize>(
        &mut self,
        name: &str,
    ) -> Result<Vec<[T; N]>, TemplateFileError> {
        let array: Array2<T> = self.array(name)?;
        if array.ncols() != N {
            let reason = format!("array '{name}' has {} columns, expected {N}", array.ncols());
            return Err(damaged(self.path, reason));
        }
        let row = |row: ndarray::ArrayView1<T>| {
            let mut out = [T::default(); N];
            out.iter_mut().zip(row).for_each(|(o, v)| *o = *v);
            out
        };
        Ok(array.outer_iter().map(row).collect())
    }
}

fn damaged(path: &Path, reason: String) -> TemplateFileError {
    TemplateFileError::Damaged { path: path.to_path_buf(), reason }
}

pub(super) fn write_seen(path: &Path, seen: &[u32]) -> Result<(), WriteError> {
    OpenArrays::write(path, |npz| npz.add("seen", seen.len(), seen.to_vec()))
}

pub(super) fn read_seen(path: &Path) -> Result<Vec<u32>, TemplateFileError> {
    ArrayReader::open(path)?.list("seen")
}

pub(super) fn write_sigma(path: &Path, sigma: &[f64]) -> Result<(), WriteError> {
    OpenArrays::write(path, |npz| npz.add("sigma", sigma.len(), sigma.to_vec()))
}

pub(super) fn read_sigma(path: &Path, vertices: usize) -> Result<Vec<f64>, TemplateFileError> {
    let sigma: Vec<f64> = ArrayReader::open(path)?.list("sigma")?;
    expect(path, "vertices", vertices, sigma.len())?;
    match sigma.iter().find(|s| s.is_nan() || **s < 0.0) {
        Some(bad) => Err(damaged(path, format!("a standard deviation is {bad}"))),
        None => Ok(sigma),
    }
}

pub(super) fn write_albedo(path: &Path, texels: &SurfaceTexels) -> Result<(), WriteError> {
    OpenArrays::write(path, |npz| {
        let n = texels.value.len();
        npz.add("resolution", texels.resolution.len(), texels.resolution.clone())?;
        npz.add("value", (n, 3), texels.value.iter().flatten().copied().collect())?;
        npz.add("spread", texels.spread.len(), texels.spread.clone())?;
        npz.add("views", texels.views.len(), texels.views.clone())
    })
}

pub(super) fn read_albedo(
    path: &Path,
    faces: usize,
    count: usize,
) -> Result<SurfaceTexels, TemplateFileError> {
    let mut npz = ArrayReader::open(path)?;
    let resolution: Vec<u16> = npz.list("resolution")?;
    expect(path, "faces", faces, resolution.len())?;
    if resolution.contains(&0) {
        return Err(damaged(path, "a face has resolution 0".into()));
    }
    // The sum is checked before anything of that size is made.
    let total: u64 = resolution.iter().map(|&r| r as u64 * r as u64).sum();
    expect(path, "texels by its resolutions", count, total as usize)?;
    let mut texels = SurfaceTexels::new(resolution);
    texels.value = npz.rows("value")?;
    texels.spread = npz.list("spread")?;
    texels.views = npz.list("views")?;
    expect(path, "texels", count, texels.value.len())?;
    expect(path, "spreads", count, texels.spread.len())?;
    expect(path, "view counts", count, texels.views.len())?;
    Ok(texels)
}

pub(super) fn write_flattening(path: &Path, map: &Flattening) -> Result<(), WriteError> {
    OpenArrays::write(path, |npz| {
        let corners = map.corners.iter().flatten().flat_map(|p| [p.x, p.y]).collect();
        npz.add("corners", (map.corners.len(), 3, 2), corners)?;
        npz.add("seam", (map.seam.len(), 2), map.seam.iter().flatten().copied().collect())?;
        npz.add("quasi_conformal", map.quasi_conformal.len(), map.quasi_conformal.clone())?;
        npz.add("log_area", map.log_area.len(), map.log_area.clone())
    })
}

pub(super) fn read_flattening(
    path: &Path,
    topology: &Topology,
) -> Result<Flattening, TemplateFileError> {
    let mut npz = ArrayReader::open(path)?;
    let corners: Array3<f64> = npz.array("corners")?;
    let faces = topology.faces.len();
    if corners.dim() != (faces, 3, 2) {
        let reason =
            format!("array 'corners' has shape {:?}, expected {faces} x 3 x 2", corners.dim());
        return Err(damaged(path, reason));
    }
    let corner = |f: usize, k: usize| Point2::new(corners[[f, k, 0]], corners[[f, k, 1]]);
    let map = Flattening {
        corners: (0..faces).map(|f| [0, 1, 2].map(|k| corner(f, k))).collect(),
        seam: npz.rows("seam")?,
        quasi_conformal: npz.list("quasi_conformal")?,
        log_area: npz.list("log_area")?,
    };
    expect(path, "quasi-conformal ratios", faces, map.quasi_conformal.len())?;
    expect(path, "log areas", faces, map.log_area.len())?;
    if let Some([a, b]) = map.seam.iter().find(|e| topology.edge_index(e[0], e[1]).is_none()) {
        return Err(damaged(path, format!("the seam names {a}-{b}, which is no edge of the mesh")));
    }
    Ok(map)
}

pub(super) fn write_features(path: &Path, features: &Features) -> Result<(), WriteError> {
    OpenArrays::write(path, |npz| {
        let n = features.descriptors.len();
        npz.add("descriptors", (n, 128), features.descriptors.iter().flatten().copied().collect())?;
        npz.add("faces", features.faces.len(), features.faces.clone())?;
        let flat = features.barycentrics.iter().flatten().copied().collect();
        npz.add("barycentrics", (features.barycentrics.len(), 3), flat)
    })
}

pub(super) fn read_features(
    path: &Path,
    faces: usize,
    count: usize,
) -> Result<Features, TemplateFileError> {
    let mut npz = ArrayReader::open(path)?;
    let features = Features {
        descriptors: npz.rows("descriptors")?,
        faces: npz.list("faces")?,
        barycentrics: npz.rows("barycentrics")?,
    };
    expect(path, "descriptors", count, features.descriptors.len())?;
    expect(path, "feature faces", count, features.faces.len())?;
    expect(path, "feature barycentrics", count, features.barycentrics.len())?;
    if features.barycentrics.iter().flatten().any(|b| !b.is_finite()) {
        return Err(damaged(
            path,
            "a feature lies nowhere (its barycentrics are not finite)".into(),
        ));
    }
    if let Some(bad) = features.faces.iter().find(|&&f| f as usize >= faces) {
        return Err(damaged(path, format!("a feature names face {bad} of {faces}")));
    }
    Ok(features)
}
