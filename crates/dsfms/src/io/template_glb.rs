//! The template as one `.glb` for viewers: surface, normals, UV, baked albedo.
//!
//! glTF has one UV per vertex, so vertices are repeated along the seam: `_VERTEX` names the
//! template's vertex of each. glTF lengths are metres: the node scales mm to m.

use super::atomic::{WriteError, write_atomic};
use super::gltf_mesh::VERTEX;
use crate::geometry::Point2;
use crate::mesh::normals::vertex_normals;
use crate::template::bake::bake;
use crate::template::{LengthUnit, Template};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// Side of the baked texture, px.
const TEXTURE: usize = 1024;
/// Growth of the charts, px.
const MARGIN: usize = 4;

const FLOAT: u32 = 5126;
const UNSIGNED: u32 = 5125;

/// The binary chunk with its views and accessors.
#[derive(Default)]
pub(super) struct Binary {
    pub(super) bytes: Vec<u8>,
    pub(super) views: Vec<Value>,
    pub(super) accessors: Vec<Value>,
}

impl Binary {
    pub(super) fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view =
            json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(view);
        self.views.len() - 1
    }

    pub(super) fn floats(
        &mut self,
        kind: &str,
        width: usize,
        values: &[f32],
        bounds: bool,
    ) -> usize {
        self.numbers(kind, width, values, bounds, Some(34962))
    }

    /// Floats with the target of their view, which what is no vertex attribute has not.
    pub(super) fn numbers(
        &mut self,
        kind: &str,
        width: usize,
        values: &[f32],
        bounds: bool,
        target: Option<u32>,
    ) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, target);
        let mut accessor = json!({"bufferView": view, "componentType": FLOAT,
            "count": values.len() / width, "type": kind});
        if bounds {
            let fold = |f: fn(f32, f32) -> f32, start: f32| -> Vec<f32> {
                (0..width)
                    .map(|c| values.iter().skip(c).step_by(width).copied().fold(start, f))
                    .collect()
            };
            accessor["min"] = fold(f32::min, f32::INFINITY).into();
            accessor["max"] = fold(f32::max, f32::NEG_INFINITY).into();
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    pub(super) fn indices(&mut self, values: &[u32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let view = self.view(&bytes, Some(34963));
        self.accessors.push(json!({"bufferView": view, "componentType": UNSIGNED,
            "count": values.len(), "type": "SCALAR"}));
        self.accessors.len() - 1
    }
}

/// Vertices as glTF wants them.
pub(super) struct Split {
    /// Template vertex of each.
    pub(super) vertex: Vec<u32>,
    pub(super) uv: Vec<Point2>,
    /// A face corner that uses it: face and place; `None` where no face does.
    corner: Vec<Option<(usize, usize)>>,
    pub(super) indices: Vec<u32>,
}

impl Split {
    /// The numbers of `_VERTEX`: exact up to 2²⁴ vertices.
    pub(super) fn names(&self) -> Vec<f32> {
        self.vertex.iter().map(|&v| v as f32).collect()
    }
}

pub(super) fn split(template: &Template) -> Split {
    let mut known = BTreeMap::new();
    let mut out =
        Split { vertex: Vec::new(), uv: Vec::new(), corner: Vec::new(), indices: Vec::new() };
    for (f, face) in template.mesh.topology.faces.iter().enumerate() {
        for (k, &v) in face.iter().enumerate() {
            let uv = template.flattening.as_ref().map_or(Point2::origin(), |m| m.corners[f][k]);
            let index = *known.entry((v, uv.x.to_bits(), uv.y.to_bits())).or_insert_with(|| {
                out.vertex.push(v);
                out.uv.push(uv);
                out.corner.push(Some((f, k)));
                out.vertex.len() as u32 - 1
            });
            out.indices.push(index);
        }
    }
    // Vertices of no face stay, so that the file gives back every one.
    let used = &template.mesh.topology.vertex_faces;
    for unused in (0..used.len()).filter(|&v| used[v].is_empty()) {
        out.vertex.push(unused as u32);
        out.uv.push(Point2::origin());
        out.corner.push(None);
    }
    out
}

pub(super) fn write(path: &Path, template: &Template) -> Result<(), WriteError> {
    let bytes = encode(template).map_err(|e| WriteError::new(path, e))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

fn encode(template: &Template) -> io::Result<Vec<u8>> {
    let split = split(template);
    let mut binary = Binary::default();
    let indices = binary.indices(&split.indices);
    let mut attributes = attributes(template, &split, &mut binary);
    let mut material = json!({"name": "organ", "doubleSided": true,
        "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.6}});
    let texture = texture(template)?;
    if let Some(png) = &texture {
        binary.view(png, None);
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
    } else if template.albedo.is_some() {
        attributes["COLOR_0"] = attributes["_ALBEDO_RGB"].clone();
    }
    let scale = if template.unit == LengthUnit::Millimetre { 0.001 } else { 1.0 };
    let mut document = json!({
        "asset": {"version": "2.0", "generator": concat!("dsfms ", env!("CARGO_PKG_VERSION")),
            "extras": {"units": template.unit.label(),
                "frames": template.views.iter().map(|v| v.name.clone()).collect::<Vec<_>>()}},
        "scene": 0, "scenes": [{"nodes": [0]}],
        // The template frame is a camera's (y down, z forward); viewers have y up, z backward.
        "nodes": [{"mesh": 0, "name": "template", "rotation": [1.0, 0.0, 0.0, 0.0],
            "scale": [scale, scale, scale]}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "materials": [material],
        "buffers": [{"byteLength": binary.bytes.len()}],
        "bufferViews": binary.views, "accessors": binary.accessors,
    });
    if texture.is_some() {
        let view = document["bufferViews"].as_array().map_or(0, Vec::len) - 1;
        document["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        document["textures"] = json!([{"source": 0}]);
    }
    Ok(container(&document, binary.bytes))
}

fn attributes(template: &Template, split: &Split, binary: &mut Binary) -> Value {
    let mesh = &template.mesh;
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let of = |f: &dyn Fn(usize) -> [f32; 3]| -> Vec<f32> {
        split.vertex.iter().flat_map(|&v| f(v as usize)).collect()
    };
    let positions = of(&|v| [0, 1, 2].map(|c| mesh.positions[v][c] as f32));
    let unit = |v: usize| normals[v].try_normalize(0.0).unwrap_or(crate::geometry::Vector3::z());
    let normals = of(&|v| unit(v).map(|x| x as f32).into());
    let mut attributes = json!({
        "POSITION": binary.floats("VEC3", 3, &positions, true),
        "NORMAL": binary.floats("VEC3", 3, &normals, false),
        VERTEX: binary.floats("SCALAR", 1, &split.names(), false),
    });
    if template.flattening.is_some() {
        let uv: Vec<f32> = split.uv.iter().flat_map(|p| [p.x as f32, 1.0 - p.y as f32]).collect();
        attributes["TEXCOORD_0"] = binary.floats("VEC2", 2, &uv, false).into();
    }
    if let Some(albedo) = &template.albedo {
        let at = |corner: &Option<(usize, usize)>| {
            // Just inside the corner, so that the corner's own texel answers.
            let mut b = [0.001; 3];
            let Some((f, k)) = *corner else { return [0.0; 3] };
            b[k] = 0.998;
            albedo.at(f, b)
        };
        let rgb: Vec<[f32; 3]> = split.corner.iter().map(at).collect();
        let grey: Vec<f32> = rgb.iter().map(|c| c.iter().sum::<f32>() / 3.0).collect();
        attributes["_ALBEDO"] = binary.floats("SCALAR", 1, &grey, false).into();
        let flat: Vec<f32> = rgb.into_iter().flatten().collect();
        attributes["_ALBEDO_RGB"] = binary.floats("VEC3", 3, &flat, false).into();
    }
    attributes
}

/// Colour of every vertex for programs that know no texture: the albedo where its faces meet it, as
/// 8-bit sRGB; `None` without albedo. Black where no face has the vertex.
pub fn vertex_colours(template: &Template) -> Option<Vec<[u8; 3]>> {
    let albedo = template.albedo.as_ref()?;
    let mut sums = vec![([0.0f32; 3], 0.0f32); template.mesh.positions.len()];
    for (f, face) in template.mesh.topology.faces.iter().enumerate() {
        for (k, &v) in face.iter().enumerate() {
            let mut b = [0.02; 3];
            b[k] = 0.96;
            let (sum, count) = &mut sums[v as usize];
            sum.iter_mut().zip(albedo.at(f, b)).for_each(|(s, c)| *s += c);
            *count += 1.0;
        }
    }
    Some(sums.into_iter().map(|(sum, n)| sum.map(|s| srgb(s / n.max(1.0)))).collect())
}

/// The albedo as an sRGB PNG laid out by the flattening.
///
/// # Errors
/// A flattening that cannot be baked; `None` without albedo or flattening.
pub fn texture(template: &Template) -> io::Result<Option<Vec<u8>>> {
    let (Some(albedo), Some(map)) = (&template.albedo, &template.flattening) else {
        return Ok(None);
    };
    let baked = bake(albedo, map, TEXTURE, MARGIN).map_err(io::Error::other)?;
    let bytes: Vec<u8> = baked.image.data.iter().flatten().map(|&v| srgb(v)).collect();
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(&bytes, TEXTURE as u32, TEXTURE as u32, ExtendedColorType::Rgb8)
        .map_err(io::Error::other)?;
    Ok(Some(png))
}

/// Linear light to an 8-bit sRGB value.
fn srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

/// GLB: a 12-byte header, the JSON chunk padded with spaces, the binary chunk.
pub(super) fn container(document: &Value, binary: Vec<u8>) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + binary.len();
    let mut out = Vec::with_capacity(total);
    out.extend(b"glTF");
    for word in [2, total as u32, text.len() as u32] {
        out.extend(word.to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(text);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(binary);
    out
}
