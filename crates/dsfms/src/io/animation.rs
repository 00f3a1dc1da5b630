//! The frames of a sequence as one animated `.glb`: the first shape with the template's albedo, and
//! every further one as a morph target that has its moment on the time line.
//!
//! Between two frames the viewer blends. Lengths are metres where the template's are mm, axes y up:
//! the node's transform does both.

use super::atomic::{WriteError, write_atomic};
use super::gltf_mesh::VERTEX;
use super::template_glb::{Binary, Split, container, split, texture};
use crate::geometry::{Point3, Vector3};
use crate::mesh::normals::vertex_normals;
use crate::template::{LengthUnit, Template};
use serde_json::{Value, json};
use std::io;
use std::path::Path;

/// A shape at its time.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Seconds from the start, rising from moment to moment.
    pub seconds: f64,
    /// The template's vertices in camera axes, template's unit.
    pub vertices: &'a [Point3],
}

/// Write the moments of a sequence on the template's topology, UV and albedo.
///
/// # Errors
/// [`WriteError`] naming the path; also where there is no moment, one has not the template's number
/// of vertices, or time does not rise.
pub fn write_animation(
    path: &Path,
    template: &Template,
    moments: &[Moment],
) -> Result<(), WriteError> {
    let refuse = |reason: &str| {
        Err(WriteError::new(path, io::Error::new(io::ErrorKind::InvalidInput, reason.to_string())))
    };
    let count = template.mesh.positions.len();
    if moments.is_empty() || moments.iter().any(|m| m.vertices.len() != count) {
        return refuse("expected at least one shape, each with the template's vertices");
    }
    if !moments.windows(2).all(|w| w[0].seconds < w[1].seconds) {
        return refuse("the times of an animation must rise");
    }
    let bytes = encode(template, moments).map_err(|e| WriteError::new(path, e))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

/// A shape as its file has it.
struct Shape {
    positions: Vec<f32>,
    normals: Vec<f32>,
}

impl Shape {
    fn of(template: &Template, split: &Split, vertices: &[Point3]) -> Self {
        let normals = vertex_normals(&template.mesh.topology, vertices);
        let unit = |v: u32| normals[v as usize].try_normalize(0.0).unwrap_or(Vector3::z());
        let place = |v: &u32| vertices[*v as usize].coords;
        let flat = |v: Vector3| v.map(|c| c as f32).data.0[0];
        Self {
            positions: split.vertex.iter().flat_map(|v| flat(place(v))).collect(),
            normals: split.vertex.iter().flat_map(|&v| flat(unit(v))).collect(),
        }
    }
}

fn encode(template: &Template, moments: &[Moment]) -> io::Result<Vec<u8>> {
    let split = split(template);
    let mut binary = Binary::default();
    let indices = binary.indices(&split.indices);
    let first = Shape::of(template, &split, moments[0].vertices);
    let mut attributes = json!({
        "POSITION": binary.floats("VEC3", 3, &first.positions, true),
        "NORMAL": binary.floats("VEC3", 3, &first.normals, false),
        VERTEX: binary.floats("SCALAR", 1, &split.names(), false),
    });
    if template.flattening.is_some() {
        let uv: Vec<f32> = split.uv.iter().flat_map(|p| [p.x as f32, 1.0 - p.y as f32]).collect();
        attributes["TEXCOORD_0"] = binary.floats("VEC2", 2, &uv, false).into();
    }
    let targets = targets(template, &split, &first, moments, &mut binary);
    let mut primitive = json!({"attributes": attributes, "indices": indices, "material": 0});
    let mut mesh = json!({});
    if !targets.is_empty() {
        mesh["weights"] = vec![0.0; targets.len()].into();
        primitive["targets"] = targets.into();
    }
    mesh["primitives"] = json!([primitive]);
    let animation = (moments.len() > 1).then(|| time_line(moments, &mut binary));
    let png = texture(template)?;
    let image = png.map(|png| binary.view(&png, None));
    let document = document(template, mesh, animation, image, &binary);
    Ok(container(&document, binary.bytes))
}

/// What each further moment adds to the first.
fn targets(
    template: &Template,
    split: &Split,
    first: &Shape,
    moments: &[Moment],
    binary: &mut Binary,
) -> Vec<Value> {
    let less = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f32>>();
    let target = |moment: &Moment| {
        let shape = Shape::of(template, split, moment.vertices);
        json!({
            "POSITION": binary.floats("VEC3", 3, &less(&shape.positions, &first.positions), true),
            "NORMAL": binary.floats("VEC3", 3, &less(&shape.normals, &first.normals), false),
        })
    };
    moments[1..].iter().map(target).collect()
}

/// At its own moment a target has the weight 1, at all others 0.
fn time_line(moments: &[Moment], binary: &mut Binary) -> Value {
    let targets = moments.len() - 1;
    let start = moments[0].seconds;
    let times: Vec<f32> = moments.iter().map(|m| (m.seconds - start) as f32).collect();
    let weights: Vec<f32> = (0..moments.len())
        .flat_map(|k| (1..=targets).map(move |t| f32::from(u8::from(t == k))))
        .collect();
    let input = binary.numbers("SCALAR", 1, &times, true, None);
    let output = binary.numbers("SCALAR", 1, &weights, false, None);
    json!({
        "name": "frames",
        "samplers": [{"input": input, "output": output, "interpolation": "LINEAR"}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
    })
}

fn document(
    template: &Template,
    mesh: Value,
    animation: Option<Value>,
    image: Option<usize>,
    binary: &Binary,
) -> Value {
    let mut material = json!({"name": "organ", "doubleSided": true,
        "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.6}});
    if image.is_some() {
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
    }
    let scale = if template.unit == LengthUnit::Millimetre { 0.001 } else { 1.0 };
    let mut document = json!({
        "asset": {"version": "2.0", "generator": concat!("dsfms ", env!("CARGO_PKG_VERSION")),
            "extras": {"units": template.unit.label()}},
        "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "organ", "rotation": [1.0, 0.0, 0.0, 0.0],
            "scale": [scale, scale, scale]}],
        "meshes": [mesh],
        "materials": [material],
        "buffers": [{"byteLength": binary.bytes.len()}],
        "bufferViews": binary.views, "accessors": binary.accessors,
    });
    if let Some(animation) = animation {
        document["animations"] = json!([animation]);
    }
    if let Some(view) = image {
        document["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        document["textures"] = json!([{"source": 0}]);
    }
    document
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::patch;
    use crate::template::flatten::{FlattenOptions, flatten};

    fn template() -> Template {
        let mesh = patch(60, 3).mesh;
        let flattening = flatten(&mesh, &FlattenOptions::default()).ok();
        Template {
            unit: LengthUnit::Millimetre,
            mesh,
            seen: Vec::new(),
            sigma: Vec::new(),
            flattening,
            albedo: None,
            features: None,
            views: Vec::new(),
            points: Vec::new(),
            camera: None,
            tone: Default::default(),
            light: None,
            coat: Default::default(),
            usual: None,
            surroundings: None,
        }
    }

    #[test]
    fn every_frame_comes_back_at_its_time() {
        let template = template();
        let rest = &template.mesh.positions;
        let shapes: Vec<Vec<Point3>> = (0..3)
            .map(|k| rest.iter().map(|p| p + Vector3::new(0.0, f64::from(k) * p.x, 70.0)).collect())
            .collect();
        let moments: Vec<Moment> = (0..3)
            .zip(&shapes)
            .map(|(k, vertices)| Moment { seconds: 2.0 + 0.5 * f64::from(k), vertices })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        write_animation(&path, &template, &moments).unwrap();

        let (document, buffers, _) = gltf::import(&path).unwrap();
        let mesh = document.meshes().next().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|b| Some(&buffers[b.index()].0[..]));
        let base: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let targets: Vec<Vec<[f32; 3]>> =
            reader.read_morph_targets().map(|t| t.0.unwrap().collect()).collect();
        assert_eq!((base.len(), targets.len()), (rest.len(), 2));
        // In the order in which the faces name them.
        let vertices = split(&template).vertex;
        for (k, shape) in shapes.iter().enumerate() {
            for (i, &v) in vertices.iter().enumerate() {
                for c in 0..3 {
                    let found = base[i][c] + if k > 0 { targets[k - 1][i][c] } else { 0.0 };
                    let expected = shape[v as usize][c];
                    assert!((f64::from(found) - expected).abs() < 1e-4, "frame {k}, vertex {v}");
                }
            }
        }
        let animation = document.animations().next().unwrap();
        let channel = animation.channels().next().unwrap();
        let reader = channel.reader(|b| Some(&buffers[b.index()].0[..]));
        assert_eq!(reader.read_inputs().unwrap().collect::<Vec<f32>>(), [0.0, 0.5, 1.0]);
        let Some(gltf::animation::util::ReadOutputs::MorphTargetWeights(weights)) =
            reader.read_outputs()
        else {
            panic!("no weights")
        };
        assert_eq!(weights.into_f32().collect::<Vec<f32>>(), [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn sequences_that_are_none_are_refused() {
        let template = template();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let vertices = &template.mesh.positions[..];
        let now = Moment { seconds: 1.0, vertices };
        for moments in [vec![], vec![Moment { vertices: &vertices[1..], ..now }], vec![now, now]] {
            assert!(write_animation(&path, &template, &moments).is_err());
        }
        write_animation(&path, &template, &[now]).unwrap();
        assert!(gltf::import(&path).unwrap().0.animations().next().is_none());
    }
}
