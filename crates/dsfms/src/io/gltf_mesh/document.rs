//! The JSON of a glTF file, and the container of a `.glb`.

use super::super::raw_mesh::{FormatError, MeshUnit};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Attribute of our own files: the template's vertex.
pub(in crate::io) const VERTEX: &str = "_VERTEX";

/// Most bytes of JSON: numbers belong in buffers.
const MOST_JSON: usize = 64 << 20;

/// A finding about the file.
pub(super) fn malformed(reason: impl Into<String>) -> FormatError {
    FormatError::Malformed(reason.into())
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
#[derive(Default)]
pub(super) struct Document {
    asset: Option<Asset>,
    extensions_required: Vec<String>,
    scene: Option<usize>,
    scenes: Vec<SceneNodes>,
    pub(super) nodes: Vec<SceneNode>,
    meshes: Vec<Primitives>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Asset {
    version: String,
    /// Anything at all in files of others.
    #[serde(default)]
    extras: serde_json::Value,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct SceneNodes {
    nodes: Vec<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct SceneNode {
    pub(super) children: Vec<usize>,
    mesh: Option<usize>,
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct Primitives {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) mode: Option<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<Sparse>,
}

/// Values that replace some of an accessor's.
#[derive(Deserialize)]
pub(super) struct Sparse {
    pub(super) count: usize,
    pub(super) indices: SparsePart,
    pub(super) values: SparsePart,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparsePart {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) component_type: Option<u32>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: usize,
}

/// The document, and the binary chunk of a `.glb`.
pub(super) fn parse(bytes: &[u8]) -> Result<(Document, Option<&[u8]>), FormatError> {
    let (json, chunk) = match bytes.starts_with(b"glTF") {
        true => chunks(bytes)?,
        false => (bytes, None),
    };
    if json.len() > MOST_JSON {
        return Err(malformed(format!("its JSON is {} bytes long, which none is", json.len())));
    }
    let document: Document =
        serde_json::from_slice(json).map_err(|e| malformed(format!("its JSON: {e}")))?;
    match &document.asset {
        Some(asset) if asset.version.starts_with("2.") => {}
        Some(asset) => return Err(malformed(format!("it is glTF {}, not 2", asset.version))),
        None => return Err(malformed("it has no asset version: no glTF 2 file")),
    }
    // What only says how a surface looks does not matter here.
    let looks = |name: &&String| name.starts_with("KHR_materials_") || name.contains("_texture_");
    match document.extensions_required.iter().find(|name| !looks(name)) {
        None => Ok((document, chunk)),
        Some(name) => Err(malformed(format!(
            "it needs the extension {name}, which is not read; export it without compression"
        ))),
    }
}

/// The JSON and binary chunks of a `.glb`, which states its own length.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), FormatError> {
    let word = |at: usize| {
        let word = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes([word[0], word[1], word[2], word[3]]) as usize)
    };
    let Some((version, stated)) = word(4).zip(word(8)) else {
        return Err(FormatError::Truncated("the 12-byte GLB header".into()));
    };
    if version != 2 {
        return Err(malformed(format!("it is a GLB of version {version}, not 2")));
    }
    let cut = || FormatError::Truncated(format!("byte {} of {stated}", bytes.len()));
    if bytes.len() < stated {
        return Err(cut());
    }
    let chunk = |at: usize| -> Result<Option<(&[u8], usize)>, FormatError> {
        let Some((length, kind)) = word(at).zip(word(at + 4)) else { return Ok(None) };
        let content = bytes.get(at + 8..).and_then(|rest| rest.get(..length));
        content.map(|content| Some((content, kind))).ok_or_else(cut)
    };
    const JSON: usize = 0x4E4F_534A;
    const BINARY: usize = 0x004E_4942;
    match chunk(12)? {
        Some((json, JSON)) => {
            let second = chunk(20 + json.len())?;
            Ok((json, second.filter(|c| c.1 == BINARY).map(|c| c.0)))
        }
        _ => Err(malformed("its first chunk is not JSON")),
    }
}

impl Document {
    /// Unit of the coordinates in a file that this program wrote.
    pub(super) fn own_unit(&self) -> Option<MeshUnit> {
        let unit = match self.asset.as_ref()?.extras.get("units")?.as_str()? {
            "mm" => MeshUnit::Millimetre,
            "template_units" => MeshUnit::TemplateUnit,
            _ => return None,
        };
        let mut primitives = self.meshes.iter().flat_map(|mesh| &mesh.primitives);
        primitives.all(|p| p.attributes.contains_key(VERTEX)).then_some(unit)
    }

    /// Nodes at the top of the default scene, or of the first.
    pub(super) fn roots(&self) -> Result<&[usize], FormatError> {
        let scene = self.scenes.get(self.scene.unwrap_or(0));
        scene.map(|s| s.nodes.as_slice()).ok_or_else(|| malformed("it has no scene"))
    }

    /// What a node shows.
    pub(super) fn primitives(&self, node: &SceneNode) -> Result<&[Primitive], FormatError> {
        let Some(mesh) = node.mesh else { return Ok(&[]) };
        let found = self.meshes.get(mesh).map(|m| m.primitives.as_slice());
        found.ok_or_else(|| malformed(format!("mesh {mesh} does not exist")))
    }
}
