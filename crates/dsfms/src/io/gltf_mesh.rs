//! glTF 2.0 (`.glb`, `.gltf`): all triangle primitives of the default scene, node transforms applied.

use super::mesh::{FormatError, MeshUnit, RawMesh};
use crate::geometry::{Point2, Point3};
use gltf::mesh::{Mode, Primitive};
use nalgebra::Matrix4;
use std::path::Path;

pub(super) fn read(bytes: &[u8], path: &Path) -> Result<RawMesh, FormatError> {
    let malformed = |e: gltf::Error| match e {
        gltf::Error::Io(_) | gltf::Error::BufferLength { .. } => {
            FormatError::Truncated(format!("its buffers ({e})"))
        }
        _ => FormatError::Malformed(e.to_string()),
    };
    check_glb_length(bytes)?;
    let gltf = gltf::Gltf::from_slice(bytes).map_err(malformed)?;
    let buffers = gltf::import_buffers(&gltf.document, path.parent(), gltf.blob.clone())
        .map_err(malformed)?;
    let mut collector = Collector { mesh: RawMesh::default(), uv: Vec::new(), buffers, skipped: 0 };
    let Some(scene) = gltf.document.default_scene().or_else(|| gltf.document.scenes().next())
    else {
        return Err(FormatError::Malformed("it has no scene".into()));
    };
    for node in scene.nodes() {
        collector.node(&node, Matrix4::identity())?;
    }
    Ok(collector.finish())
}

/// A binary container states its own length.
fn check_glb_length(bytes: &[u8]) -> Result<(), FormatError> {
    if !bytes.starts_with(b"glTF") {
        return Ok(());
    }
    let Some(length) = bytes.get(8..12) else {
        return Err(FormatError::Truncated("the 12-byte GLB header".into()));
    };
    let stated = u32::from_le_bytes([length[0], length[1], length[2], length[3]]) as usize;
    if bytes.len() < stated {
        return Err(FormatError::Truncated(format!("byte {} of {stated}", bytes.len())));
    }
    Ok(())
}

struct Collector {
    mesh: RawMesh,
    uv: Vec<[Point2; 3]>,
    buffers: Vec<gltf::buffer::Data>,
    skipped: usize,
}

impl Collector {
    fn node(&mut self, node: &gltf::Node, parent: Matrix4<f64>) -> Result<(), FormatError> {
        let local = Matrix4::from(node.transform().matrix()).map(f64::from);
        let world = parent * local;
        if let Some(mesh) = node.mesh() {
            for primitive in mesh.primitives() {
                self.primitive(&primitive, &world)?;
            }
        }
        node.children().try_for_each(|child| self.node(&child, world))
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        world: &Matrix4<f64>,
    ) -> Result<(), FormatError> {
        if primitive.mode() != Mode::Triangles {
            self.skipped += 1;
            return Ok(());
        }
        let buffers = &self.buffers;
        let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(|d| &d.0[..]));
        let Some(positions) = reader.read_positions() else {
            return Err(FormatError::Malformed("a primitive has no readable POSITION".into()));
        };
        let first = self.mesh.positions.len() as u32;
        let place = |p: [f32; 3]| world.transform_point(&Point3::from(p.map(f64::from)));
        self.mesh.positions.extend(positions.map(place));
        let count = self.mesh.positions.len() as u32 - first;
        let corners: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..count).collect(),
        };
        let texture: Option<Vec<[f32; 2]>> =
            reader.read_tex_coords(0).map(|t| t.into_f32().collect());
        // A mirroring node turns every face inside out; swap two corners to turn it back.
        let mirrored = world.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        for k in corners.chunks_exact(3) {
            let k = if mirrored { [k[0], k[2], k[1]] } else { [k[0], k[1], k[2]] };
            self.mesh.faces.push(k.map(|v| v.saturating_add(first)));
            let uv = |v: u32| texture.as_ref().and_then(|t| t.get(v as usize));
            if let [Some(a), Some(b), Some(c)] = k.map(uv) {
                self.uv.push([a, b, c].map(|t| Point2::new(t[0] as f64, 1.0 - t[1] as f64)));
            }
        }
        Ok(())
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
        self.mesh.warnings.push(
            "glTF prescribes metres, which exporters often ignore; the numbers are kept as they are, \
             check the size of the organ"
                .into(),
        );
        self.mesh
    }
}
