//! The organ that the cases of a series are made on.

use super::ExperimentError;
use crate::io::mesh::{MeshFile, MeshUnit, parse_mesh, read_mesh};
use crate::mesh::Mesh;
use crate::mesh::components::largest_component;
use crate::mesh::orientation::oriented_outward;
use crate::synth::{Case, Cell, Patch, Protocol, part, patch};
use std::path::Path;

/// The organ that the cases of a series are made on.
#[derive(Clone, Debug)]
pub enum SeriesOrgan {
    /// A bulging patch of 50 × 40 mm, another one for every case.
    Patch,
    /// A part of a surface, another one for every case.
    Surface {
        /// Name.
        name: String,
        /// The whole surface, outward normals.
        mesh: Mesh,
    },
}

/// Closed surfaces of real organs; source and licence in `data/organs/README.md`.
const EMBEDDED: [(&str, &[u8]); 2] = [
    ("uterus", include_bytes!("../../data/organs/uterus.ply")),
    ("liver", include_bytes!("../../data/organs/liver.ply")),
];

impl SeriesOrgan {
    /// `patch`, `uterus`, `liver`, or a mesh file (PLY, OBJ, STL, glTF; any unit; the largest piece
    /// of the surface is taken).
    ///
    /// # Errors
    /// A file that cannot be read, or faces that cannot be oriented consistently.
    pub fn named(name: &str) -> Result<Self, ExperimentError> {
        if name == "patch" {
            return Ok(Self::Patch);
        }
        let bad = |problem: String| ExperimentError::Organ { name: name.into(), problem };
        let path = Path::new(name);
        let file = match EMBEDDED.iter().find(|organ| organ.0 == name) {
            Some((_, bytes)) => parse_mesh(bytes, &path.with_extension("ply")),
            None if !path.exists() => {
                return Err(bad("expected patch, uterus, liver or a mesh file that exists".into()));
            }
            None => read_mesh(path),
        };
        let file = file.map_err(|error| bad(error.to_string()))?;
        let MeshFile { mesh, .. } =
            file.in_unit(MeshUnit::Millimetre).map_err(|error| bad(error.to_string()))?;
        let (mesh, _) = largest_component(&mesh);
        let (mesh, _) = oriented_outward(&mesh).map_err(|error| bad(error.to_string()))?;
        Ok(Self::Surface { name: name.to_owned(), mesh })
    }

    /// Its name, as [`SeriesOrgan::named`] takes it.
    pub fn name(&self) -> &str {
        match self {
            Self::Patch => "patch",
            Self::Surface { name, .. } => name,
        }
    }

    /// Rest shape and albedo of a seed.
    ///
    /// # Errors
    /// No part of the surface can be used.
    pub fn part(&self, vertices: usize, seed: u64) -> Result<Patch, ExperimentError> {
        match self {
            Self::Patch => Ok(patch(vertices, seed)),
            Self::Surface { name, mesh } => {
                part(mesh, vertices, seed).ok_or_else(|| ExperimentError::Organ {
                    name: name.clone(),
                    problem:
                        "no part of the surface is a disc that faces one direction; it may be \
                              torn, or rough at the scale of a third of its size"
                            .into(),
                })
            }
        }
    }

    /// Case `index` of a cell.
    ///
    /// # Errors
    /// As [`SeriesOrgan::part`].
    pub fn case(
        &self,
        protocol: &Protocol,
        cell: Cell,
        index: usize,
    ) -> Result<Case, ExperimentError> {
        let organ = self.part(protocol.vertices, protocol.case_seed(index))?;
        Ok(protocol.case_on(organ, cell, index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_organs_give_parts() {
        for (name, _) in EMBEDDED {
            let organ = SeriesOrgan::named(name).unwrap();
            assert_eq!(organ.name(), name);
            let case = organ
                .case(
                    &Protocol { vertices: 150, ..Default::default() },
                    Cell { extension: 10.0, noise: 1.0 },
                    0,
                )
                .unwrap();
            let seen = case.visible.iter().filter(|v| **v).count();
            assert!(seen * 10 > case.visible.len() * 7, "{name}: {seen} seen");
        }
    }

    #[test]
    fn an_unknown_organ_says_what_is_known() {
        let error = SeriesOrgan::named("spleeen").unwrap_err().to_string();
        assert!(error.contains("spleeen") && error.contains("uterus"), "{error}");
    }
}
