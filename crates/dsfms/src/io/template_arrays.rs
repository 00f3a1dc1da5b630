//! The NumPy files of a template.

use super::atomic::{WriteError, write_atomic};
use super::npz::{NpyArray, NpyValue, Npz, NpzWriter};
use super::template_error::{TemplateFileError, expect};
use crate::geometry::Point2;
use crate::mesh::Topology;
use crate::template::{Features, Flattening, SurfaceTexels};
use std::io;
use std::path::Path;

/// Texture coordinates of a chart are within the unit square; what is far outside is no coordinate.
const LARGEST_UV: f64 = 1e6;

/// Write an npz whole, with what fills it.
fn write_npz(
    path: &Path,
    fill: impl FnOnce(&mut NpzWriter<Vec<u8>>) -> io::Result<()>,
) -> Result<(), WriteError> {
    let mut npz = NpzWriter::new(Vec::new(), true);
    let bytes = fill(&mut npz).and_then(|()| npz.finish()).map_err(|e| WriteError::new(path, e))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

/// An npz being read; every failure names the file and the array.
struct ArrayReader<'a> {
    path: &'a Path,
    npz: Npz,
}

impl<'a> ArrayReader<'a> {
    fn open(path: &'a Path) -> Result<Self, TemplateFileError> {
        let npz = Npz::open(path).map_err(|reason| damaged(path, reason))?;
        Ok(Self { path, npz })
    }

    fn array<T: NpyValue, const N: usize>(
        &mut self,
        name: &str,
    ) -> Result<NpyArray<T, N>, TemplateFileError> {
        self.npz.array(name).map_err(|reason| damaged(self.path, reason))
    }

    fn list<T: NpyValue>(&mut self, name: &str) -> Result<Vec<T>, TemplateFileError> {
        self.npz.list(name).map_err(|reason| damaged(self.path, reason))
    }

    fn rows<T: NpyValue, const N: usize>(
        &mut self,
        name: &str,
    ) -> Result<Vec<[T; N]>, TemplateFileError> {
        self.npz.rows(name).map_err(|reason| damaged(self.path, reason))
    }
}

fn damaged(path: &Path, reason: String) -> TemplateFileError {
    TemplateFileError::Damaged { path: path.to_path_buf(), reason }
}

pub(super) fn write_seen(path: &Path, seen: &[u32]) -> Result<(), WriteError> {
    write_npz(path, |npz| npz.add("seen", &[seen.len()], seen.iter().copied()))
}

pub(super) fn read_seen(path: &Path) -> Result<Vec<u32>, TemplateFileError> {
    ArrayReader::open(path)?.list("seen")
}

pub(super) fn write_sigma(path: &Path, sigma: &[f64]) -> Result<(), WriteError> {
    write_npz(path, |npz| npz.add("sigma", &[sigma.len()], sigma.iter().copied()))
}

pub(super) fn read_sigma(path: &Path, vertices: usize) -> Result<Vec<f64>, TemplateFileError> {
    let sigma: Vec<f64> = ArrayReader::open(path)?.list("sigma")?;
    expect(path, "vertices", vertices, sigma.len())?;
    // Infinite where nothing was measured.
    match sigma.iter().find(|s| s.is_nan() || **s < 0.0) {
        Some(bad) => Err(damaged(path, format!("a standard deviation is {bad}"))),
        None => Ok(sigma),
    }
}

pub(super) fn write_albedo(path: &Path, texels: &SurfaceTexels) -> Result<(), WriteError> {
    write_npz(path, |npz| {
        let n = texels.value.len();
        npz.add("resolution", &[texels.resolution.len()], texels.resolution.iter().copied())?;
        npz.add("value", &[n, 3], texels.value.iter().flatten().copied())?;
        npz.add("spread", &[texels.spread.len()], texels.spread.iter().copied())?;
        npz.add("views", &[texels.views.len()], texels.views.iter().copied())
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
    let total: u64 = resolution.iter().map(|&r| r as u64 * r as u64).sum();
    expect(path, "texels by its resolutions", count, total as usize)?;
    // Before anything of that size is made, whatever manifest and resolutions say: the values are
    // there.
    let value: Vec<[f32; 3]> = npz.rows("value")?;
    expect(path, "texels", count, value.len())?;
    let mut texels = SurfaceTexels::new(resolution);
    texels.value = value;
    texels.spread = npz.list("spread")?;
    texels.views = npz.list("views")?;
    expect(path, "spreads", count, texels.spread.len())?;
    expect(path, "view counts", count, texels.views.len())?;
    if let Some(bad) = texels.value.iter().flatten().find(|v| !v.is_finite() || **v < 0.0) {
        return Err(damaged(path, format!("an albedo is {bad}, expected 0 or more")));
    }
    // NaN: no view saw the texel.
    match texels.spread.iter().find(|s| s.is_infinite() || **s < 0.0) {
        Some(bad) => Err(damaged(path, format!("a standard deviation is {bad}"))),
        None => Ok(texels),
    }
}

pub(super) fn write_flattening(path: &Path, map: &Flattening) -> Result<(), WriteError> {
    write_npz(path, |npz| {
        let corners = map.corners.iter().flatten().flat_map(|p| [p.x, p.y]);
        npz.add("corners", &[map.corners.len(), 3, 2], corners)?;
        npz.add("seam", &[map.seam.len(), 2], map.seam.iter().flatten().copied())?;
        npz.add(
            "quasi_conformal",
            &[map.quasi_conformal.len()],
            map.quasi_conformal.iter().copied(),
        )?;
        npz.add("log_area", &[map.log_area.len()], map.log_area.iter().copied())
    })
}

pub(super) fn read_flattening(
    path: &Path,
    topology: &Topology,
) -> Result<Flattening, TemplateFileError> {
    let mut npz = ArrayReader::open(path)?;
    let corners: NpyArray<f64, 3> = npz.array("corners")?;
    let faces = topology.faces.len();
    if corners.shape != [faces, 3, 2] {
        let reason =
            format!("array 'corners' has shape {:?}, expected {faces} x 3 x 2", corners.shape);
        return Err(damaged(path, reason));
    }
    let corner = |f: usize, k: usize| {
        let at = 6 * f + 2 * k;
        Point2::new(corners.values[at], corners.values[at + 1])
    };
    let map = Flattening {
        corners: (0..faces).map(|f| [0, 1, 2].map(|k| corner(f, k))).collect(),
        seam: npz.rows("seam")?,
        quasi_conformal: npz.list("quasi_conformal")?,
        log_area: npz.list("log_area")?,
    };
    expect(path, "quasi-conformal ratios", faces, map.quasi_conformal.len())?;
    expect(path, "log areas", faces, map.log_area.len())?;
    if corners.values.iter().any(|x| !x.is_finite() || x.abs() > LARGEST_UV) {
        let reason =
            format!("a corner is not finite, or further than {LARGEST_UV} from the origin");
        return Err(damaged(path, reason));
    }
    if let Some([a, b]) = map.seam.iter().find(|e| topology.edge_index(e[0], e[1]).is_none()) {
        return Err(damaged(path, format!("the seam names {a}-{b}, which is no edge of the mesh")));
    }
    Ok(map)
}

pub(super) fn write_features(path: &Path, features: &Features) -> Result<(), WriteError> {
    write_npz(path, |npz| {
        let n = features.descriptors.len();
        npz.add("descriptors", &[n, 128], features.descriptors.iter().flatten().copied())?;
        npz.add("faces", &[features.faces.len()], features.faces.iter().copied())?;
        let flat = features.barycentrics.iter().flatten().copied();
        npz.add("barycentrics", &[features.barycentrics.len(), 3], flat)
    })
}

pub(super) fn read_features(path: &Path, faces: usize) -> Result<Features, TemplateFileError> {
    let mut npz = ArrayReader::open(path)?;
    let features = Features {
        descriptors: npz.rows("descriptors")?,
        faces: npz.list("faces")?,
        barycentrics: npz.rows("barycentrics")?,
    };
    let count = features.descriptors.len();
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
