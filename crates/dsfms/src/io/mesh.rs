//! Reading a user's surface mesh: PLY, OBJ, STL, glTF, OFF, VTK. Vertex order and connectivity are
//! kept.

use super::raw_mesh::{FormatError, RawMesh};
pub use super::raw_mesh::{MeshUnit, UnitMismatch};
use crate::geometry::{Point2, Point3};
use crate::guard;
use crate::io::{gltf_mesh, obj, off, ply_read, stl, vtk_read};
use crate::mesh::components::components;
use crate::mesh::repair::repair;
use crate::mesh::{Mesh, TopologyError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

impl MeshFile {
    /// The mesh with its lengths in `unit`; one that states no unit is taken to be in it.
    ///
    /// # Errors
    /// [`UnitMismatch`] where the scale of one of the two units is not known.
    pub fn in_unit(mut self, unit: MeshUnit) -> Result<Self, UnitMismatch> {
        let found = self.unit.unwrap_or(unit);
        let factor = found.factor_to(unit).ok_or(UnitMismatch { found, wanted: unit })?;
        if factor != 1.0 {
            self.mesh.positions.iter_mut().for_each(|p| *p *= factor);
        }
        self.unit = Some(unit);
        Ok(self)
    }
}

/// A mesh as its file has it.
#[derive(Clone, Debug)]
pub struct MeshFile {
    /// Vertices and faces in the file's order; polygons are split into fans.
    pub mesh: Mesh,
    /// UV of the corners of every face, v upwards; `None` where the file has none for some face.
    pub uv: Option<Vec<[Point2; 3]>>,
    /// Unit the file states; `None` where it says nothing. The numbers are never rescaled.
    pub unit: Option<MeshUnit>,
    /// Further scalar properties of the vertices by name (PLY only), e.g. `visible`, `red`.
    pub attributes: BTreeMap<String, Vec<f64>>,
    /// What a user should know: several components, unused vertices, split polygons.
    pub warnings: Vec<String>,
}

/// Why a mesh file cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshFileError {
    /// The file is missing or cannot be read.
    #[error("cannot read mesh {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        #[source]
        source: std::io::Error,
    },
    /// Zero bytes.
    #[error("mesh {} is empty (0 bytes); export or copy it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// An extension that no reader knows.
    #[error("mesh {} has the unknown extension '{extension}'; use .ply, .obj, .stl, .glb, .gltf, .off, .vtk or .vtp", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its extension.
        extension: String,
    },
    /// The file ends before all it announced.
    #[error("mesh {} is truncated: it ends within {what}; copy or export it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where it ended.
        what: String,
    },
    /// The file breaks its format's rules.
    #[error("mesh {} cannot be understood: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What was expected and found.
        reason: String,
    },
    /// NaN or infinite coordinates.
    #[error("mesh {}: vertex {vertex} (0-based) has a coordinate that is not a finite number ({count} such vertices); remove or repair them", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// First such vertex.
        vertex: usize,
        /// How many.
        count: usize,
    },
    /// Faces whose corners lie on one line.
    #[error("mesh {}: face {face} (0-based) has no area ({count} such faces): its corners lie on one line; remove degenerate faces first (MeshLab: 'Remove Zero Area Faces')", path.display())]
    ZeroArea {
        /// The file.
        path: PathBuf,
        /// First such face.
        face: usize,
        /// How many.
        count: usize,
    },
    /// The faces do not form a usable surface.
    #[error("mesh {}: {source}", path.display())]
    Topology {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        #[source]
        source: TopologyError,
    },
}

/// Read a surface mesh. Vertex order, face order and connectivity are the file's; nothing is
/// welded, oriented or rescaled. The format is chosen by the extension.
///
/// # Errors
/// A file that is missing, empty, of an unknown format or damaged; a surface that is not manifold
/// or has flat faces.
pub fn read_mesh(path: &Path) -> Result<MeshFile, MeshFileError> {
    parse_mesh(&bytes_of(path)?, path)
}

/// Read a surface mesh and mend what can be mended in one way only ([`repair`]); its warnings say
/// what was done.
///
/// # Errors
/// As [`read_mesh`], for what cannot be mended.
pub fn read_repaired(path: &Path) -> Result<MeshFile, MeshFileError> {
    let bytes = bytes_of(path)?;
    check(repaired(parse_raw(&bytes, path)?), path)
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, MeshFileError> {
    let bytes =
        guard::read(path).map_err(|source| MeshFileError::Io { path: path.into(), source })?;
    // The mark that some editors put before text.
    Ok(bytes.strip_prefix(b"\xef\xbb\xbf").map(<[u8]>::to_vec).unwrap_or(bytes))
}

fn repaired(raw: RawMesh) -> RawMesh {
    let found = repair(&raw.positions, &raw.faces);
    let of_face = |&(f, turned): &(u32, bool)| {
        let [a, b, c] = raw.uv.as_ref()?[f as usize];
        Some(if turned { [a, c, b] } else { [a, b, c] })
    };
    let uv =
        found.face_of.iter().map(of_face).collect::<Option<Vec<_>>>().filter(|uv| !uv.is_empty());
    let of_vertex = |values: Vec<f64>| -> Vec<f64> {
        found.vertex_of.iter().filter_map(|&v| values.get(v as usize).copied()).collect()
    };
    RawMesh {
        uv,
        unit: raw.unit,
        attributes: raw.attributes.into_iter().map(|(name, v)| (name, of_vertex(v))).collect(),
        warnings: raw
            .warnings
            .into_iter()
            .chain(found.report.iter().map(|done| format!("repaired: {done}")))
            .collect(),
        positions: found.positions,
        faces: found.faces,
    }
}

/// A surface mesh from the content of a file; `path` tells the format and names it in errors.
///
/// # Errors
/// As [`read_mesh`].
pub fn parse_mesh(bytes: &[u8], path: &Path) -> Result<MeshFile, MeshFileError> {
    check(parse_raw(bytes, path)?, path)
}

fn parse_raw(bytes: &[u8], path: &Path) -> Result<RawMesh, MeshFileError> {
    let owned = || path.to_path_buf();
    if bytes.is_empty() {
        return Err(MeshFileError::Empty { path: owned() });
    }
    let extension =
        path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let raw = match extension.as_str() {
        "ply" => ply_read::read(bytes),
        "obj" => obj::read(bytes),
        "stl" => guard::caught(|| stl::read(bytes))
            .unwrap_or_else(|reason| Err(FormatError::Malformed(reason))),
        "off" => off::read(bytes),
        "vtk" => vtk_read::read_legacy(bytes),
        "vtp" => vtk_read::read_xml(bytes),
        "glb" | "gltf" => gltf_mesh::read(bytes, path),
        _ => return Err(MeshFileError::UnknownFormat { path: owned(), extension }),
    };
    raw.map_err(|error| match error {
        FormatError::Truncated(what) => MeshFileError::Truncated { path: owned(), what },
        FormatError::Malformed(reason) => MeshFileError::Malformed { path: owned(), reason },
    })
}

fn check(raw: RawMesh, path: &Path) -> Result<MeshFile, MeshFileError> {
    let owned = || path.to_path_buf();
    let wrong = |p: &&Point3| !p.iter().all(|x| x.is_finite());
    if let Some(vertex) = raw.positions.iter().position(|p| wrong(&p)) {
        let count = raw.positions.iter().filter(wrong).count();
        return Err(MeshFileError::NotFinite { path: owned(), vertex, count });
    }
    let mesh = Mesh::new(raw.positions, raw.faces)
        .map_err(|source| MeshFileError::Topology { path: owned(), source })?;
    let flat: Vec<usize> =
        (0..mesh.topology.faces.len()).filter(|&f| mesh.is_degenerate(f)).collect();
    if let Some(&face) = flat.first() {
        return Err(MeshFileError::ZeroArea { path: owned(), face, count: flat.len() });
    }
    let mut warnings = raw.warnings;
    warnings.extend(remarks(&mesh));
    Ok(MeshFile { mesh, uv: raw.uv, unit: raw.unit, attributes: raw.attributes, warnings })
}

/// What is allowed but seldom meant.
fn remarks(mesh: &Mesh) -> Vec<String> {
    let mut warnings = Vec::new();
    let unused = mesh.topology.vertex_faces.iter().filter(|f| f.is_empty()).count();
    if unused > 0 {
        warnings.push(format!("{unused} vertices belong to no face; they stay where they are"));
    }
    let parts = components(&mesh.topology).count;
    if parts > 1 {
        warnings.push(format!(
            "the surface has {parts} separate components; one is usual for an organ"
        ));
    }
    let mut keys: Vec<[u64; 3]> =
        mesh.positions.iter().map(|p| [p.x, p.y, p.z].map(|x| (x + 0.0).to_bits())).collect();
    keys.sort_unstable();
    let repeated = keys.windows(2).filter(|w| w[0] == w[1]).count();
    if repeated > 0 {
        warnings.push(format!(
            "{repeated} vertices repeat the position of another one: the surface may be torn along a \
             seam there; a repair merges them if it should be whole"
        ));
    }
    warnings
}

#[cfg(test)]
mod tests;
