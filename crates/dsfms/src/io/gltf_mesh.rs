//! glTF 2.0 (`.glb`, `.gltf`): all triangle primitives of the default scene, node transforms
//! applied, in metres as the standard says. A file of this program (its `asset.extras` names a
//! unit, its vertices have `_VERTEX`) gives back what was written: vertices, their order and frame,
//! faces, unit.
//!
//! An own reader of the little that a surface needs (positions, indices, one set of UV, nodes),
//! since files of others must neither run for ever nor take all memory: every number of the file is
//! checked against the bytes that are there before it is followed.

mod accessor;
mod document;

use super::raw_mesh::{FormatError, MeshUnit, RawMesh};
use crate::geometry::{Point2, Point3};
use accessor::{Arrays, MOST};
pub(super) use document::VERTEX;
use document::{Primitive, SceneNode, malformed};
use nalgebra::{Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::path::Path;

pub(super) fn read(bytes: &[u8], path: &Path) -> Result<RawMesh, FormatError> {
    let (document, chunk) = document::parse(bytes)?;
    let roots = document.roots()?;
    let arrays = Arrays::new(&document, chunk, path)?;
    let own = document.own_unit();
    let mut collector = Collector {
        mesh: RawMesh::default(),
        uv: Vec::new(),
        names: Vec::new(),
        arrays,
        own: own.is_some(),
        skipped: 0,
    };
    let mut seen = vec![false; document.nodes.len()];
    // Depth first, children in their order; no recursion, so that depth costs no stack.
    let mut open: Vec<(usize, Matrix4<f64>)> =
        roots.iter().rev().map(|&node| (node, Matrix4::identity())).collect();
    while let Some((index, parent)) = open.pop() {
        let Some(node) = document.nodes.get(index) else {
            return Err(malformed(format!("node {index} does not exist")));
        };
        if std::mem::replace(&mut seen[index], true) {
            return Err(malformed(format!(
                "node {index} is reached twice; glTF's nodes form trees, each with one parent"
            )));
        }
        let world = parent * transform(node);
        for primitive in document.primitives(node)? {
            collector.primitive(primitive, &world)?;
        }
        open.extend(node.children.iter().rev().map(|&child| (child, world)));
    }
    match own {
        Some(unit) => collector.finish_own(unit),
        None => Ok(collector.finish()),
    }
}

/// A node's own transform: a matrix, or translation, rotation and scale.
fn transform(node: &SceneNode) -> Matrix4<f64> {
    if let Some(matrix) = node.matrix {
        return Matrix4::from_column_slice(&matrix);
    }
    let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let quaternion = Quaternion::new(w, x, y, z);
    // Exporters write the identity as zeros, too.
    let rotation = match quaternion.norm() > 0.0 {
        true => UnitQuaternion::from_quaternion(quaternion),
        false => UnitQuaternion::identity(),
    };
    let shift = Translation3::from(node.translation.unwrap_or_default());
    let scale = Vector3::from(node.scale.unwrap_or([1.0; 3]));
    shift.to_homogeneous() * rotation.to_homogeneous() * Matrix4::new_nonuniform_scaling(&scale)
}

struct Collector<'a> {
    mesh: RawMesh,
    uv: Vec<[Point2; 3]>,
    /// `_VERTEX` of every vertex, in a file of our own.
    names: Vec<f64>,
    arrays: Arrays<'a>,
    /// Written by this program: coordinates are the template's, whatever the node shows viewers.
    own: bool,
    skipped: usize,
}

impl Collector<'_> {
    fn primitive(
        &mut self,
        primitive: &Primitive,
        world: &Matrix4<f64>,
    ) -> Result<(), FormatError> {
        const TRIANGLES: u32 = 4;
        if primitive.mode.unwrap_or(TRIANGLES) != TRIANGLES {
            self.skipped += 1;
            return Ok(());
        }
        let Some(&accessor) = primitive.attributes.get("POSITION") else {
            return Err(malformed("a primitive has no POSITION"));
        };
        let first = self.mesh.positions.len();
        // Asked before anything is read: a small file may name the same numbers many times.
        let count = self.arrays.count(accessor)?;
        let corners = match primitive.indices {
            Some(indices) => self.arrays.count(indices)?,
            None => count,
        };
        if first + count > MOST || self.mesh.faces.len() + corners / 3 > MOST {
            return Err(malformed(format!("it holds more than {MOST} vertices or faces")));
        }
        let positions = self.arrays.floats::<3>(accessor, "POSITION")?;
        let world = if self.own { &Matrix4::identity() } else { world };
        if let Some(&names) = primitive.attributes.get(VERTEX).filter(|_| self.own) {
            let names = self.arrays.floats::<1>(names, VERTEX)?;
            self.names.extend(names.into_iter().map(|[name]| name));
        }
        let place = |p: [f64; 3]| world.transform_point(&Point3::from(p));
        self.mesh.positions.extend(positions.into_iter().map(place));
        let corners: Vec<u32> = match primitive.indices {
            Some(indices) => self.arrays.indices(indices)?,
            None => (0..count as u32).collect(),
        };
        if let Some(wrong) = corners.iter().find(|&&v| v as usize >= count) {
            return Err(malformed(format!("a face names vertex {wrong} of {count}")));
        }
        let texture = primitive.attributes.get("TEXCOORD_0");
        let texture = texture.map(|&t| self.arrays.floats::<2>(t, "TEXCOORD_0")).transpose()?;
        // A mirroring node turns every face inside out; swap two corners to turn it back.
        let mirrored = world.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        for k in corners.as_chunks::<3>().0 {
            let k = if mirrored { [k[0], k[2], k[1]] } else { *k };
            self.mesh.faces.push(k.map(|v| v + first as u32));
            let uv = |v: u32| texture.as_ref().and_then(|t| t.get(v as usize));
            if let [Some(a), Some(b), Some(c)] = k.map(uv) {
                self.uv.push([a, b, c].map(|t| Point2::new(t[0], 1.0 - t[1])));
            }
        }
        Ok(())
    }

    /// The mesh that this program wrote: vertices are repeated along seams, and say which they are.
    fn finish_own(mut self, unit: MeshUnit) -> Result<RawMesh, FormatError> {
        let whole = |name: &f64| *name >= 0.0 && name.fract() == 0.0 && *name < MOST as f64;
        if self.names.len() != self.mesh.positions.len() || !self.names.iter().all(whole) {
            return Err(malformed(format!("{VERTEX} does not name the vertex of every POSITION")));
        }
        let names: Vec<u32> = self.names.iter().map(|&name| name as u32).collect();
        let count = names.iter().max().map_or(0, |&last| last as usize + 1);
        let mut places: Vec<Option<Point3>> = vec![None; count];
        for (&name, position) in names.iter().zip(&self.mesh.positions) {
            places[name as usize].get_or_insert(*position);
        }
        let places: Option<Vec<Point3>> = places.into_iter().collect();
        self.mesh.positions =
            places.ok_or_else(|| malformed(format!("{VERTEX} leaves out a vertex")))?;
        for face in &mut self.mesh.faces {
            *face = face.map(|v| names[v as usize]);
        }
        let faces = self.mesh.faces.len();
        self.mesh.uv = Some(self.uv).filter(|uv| !uv.is_empty() && uv.len() == faces);
        self.mesh.unit = Some(unit);
        Ok(self.mesh)
    }

    fn finish(mut self) -> RawMesh {
        if self.skipped > 0 {
            self.mesh.warnings.push(format!(
                "{} primitives are not plain triangles (points, lines, strips) and were left out",
                self.skipped
            ));
        }
        self.mesh.uv =
            Some(self.uv).filter(|uv| !uv.is_empty() && uv.len() == self.mesh.faces.len());
        self.mesh.unit = Some(MeshUnit::Metre);
        self.mesh
    }
}

#[cfg(test)]
mod tests;
