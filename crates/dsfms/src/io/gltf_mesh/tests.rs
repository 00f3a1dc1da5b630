use super::super::base64::base64;
use super::super::mesh::{MeshFile, MeshFileError, parse_mesh, read_mesh};
use super::*;
use serde_json::{Value, json};

/// A tetrahedron with UV in one buffer: positions, indices, UV.
fn tetrahedron() -> Value {
    let positions: [f32; 12] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.];
    let indices: [u16; 12] = [0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3];
    let uv: [f32; 8] = [0., 0., 1., 0., 0., 1., 0.25, 0.25];
    let mut bytes: Vec<u8> = positions.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend(indices.iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend(uv.iter().flat_map(|v| v.to_le_bytes()));
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "translation": [1, 2, 3], "scale": [2, 2, 2] }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 2 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR" },
            { "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 72, "byteLength": 32 },
        ],
        "buffers": [{
            "byteLength": bytes.len(),
            "uri": format!("data:application/octet-stream;base64,{}", base64(&bytes)),
        }],
    })
}

fn parse(value: &Value) -> Result<MeshFile, MeshFileError> {
    parse_mesh(value.to_string().as_bytes(), Path::new("a.gltf"))
}

/// The complaint about a tetrahedron that was changed.
fn complaint(change: impl FnOnce(&mut Value)) -> String {
    let mut value = tetrahedron();
    change(&mut value);
    parse(&value).expect_err("accepted").to_string()
}

#[test]
fn a_whole_file_with_its_transform_and_uv() {
    let file = parse(&tetrahedron()).unwrap();
    assert_eq!(file.mesh.positions[3], Point3::new(1.0, 2.0, 5.0));
    assert_eq!(file.mesh.topology.faces[1], [0, 1, 3]);
    assert_eq!(file.uv.unwrap()[1][1], Point2::new(1.0, 1.0));
    let mut mirrored = tetrahedron();
    mirrored["nodes"][0]["scale"] = json!([-2, 2, 2]);
    assert_eq!(parse(&mirrored).unwrap().mesh.topology.faces[1], [0, 3, 1]);
    let mut matrix = tetrahedron();
    matrix["nodes"] = json!([{ "children": [1] }, { "mesh": 0, "matrix":
        [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1] }]);
    assert_eq!(parse(&matrix).unwrap().mesh.positions[1], Point3::new(5.0, 1.0, 0.0));
}

#[test]
fn sparse_values_replace_those_of_the_view() {
    let mut value = tetrahedron();
    // Vertex 0 (the place is read from the index 0) takes the position of vertex 3.
    value["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": { "bufferView": 1, "byteOffset": 2, "componentType": 5123 },
        "values": { "bufferView": 0, "byteOffset": 36 },
    });
    value["nodes"][0] = json!({ "mesh": 0 });
    let error = parse(&value).unwrap_err().to_string();
    // Places 2 and 3 are then the same point: a face without area.
    assert!(error.contains("no area"), "{error}");
}

#[test]
fn nodes_that_form_no_tree_are_refused() {
    let cycle = complaint(|v| v["nodes"][0]["children"] = json!([0]));
    assert!(cycle.contains("reached twice"), "{cycle}");
    let shared = complaint(|v| {
        v["nodes"] = (0..40).map(|k| json!({ "children": [k + 1, k + 1] })).collect();
        v["nodes"].as_array_mut().unwrap().push(json!({ "mesh": 0 }));
    });
    assert!(shared.contains("reached twice"), "{shared}");
    let missing = complaint(|v| v["nodes"][0]["children"] = json!([7]));
    assert!(missing.contains("node 7"), "{missing}");
    // A chain of any depth is a tree.
    let mut chain = tetrahedron();
    chain["nodes"] = (0..100_000).map(|k| json!({ "children": [k + 1] })).collect();
    chain["nodes"].as_array_mut().unwrap().push(json!({ "mesh": 0 }));
    assert_eq!(parse(&chain).unwrap().mesh.positions.len(), 4);
}

#[test]
fn numbers_beyond_their_bytes_are_refused() {
    for (change, word) in [
        (json!({ "count": 13 }), "reach beyond"),
        (json!({ "count": usize::MAX }), "more than"),
        (json!({ "byteOffset": 6 }), "reach beyond"),
        (json!({ "byteOffset": usize::MAX }), "reach beyond"),
        (json!({ "bufferView": 9 }), "buffer view 9"),
        (json!({ "componentType": 5126 }), "unsigned"),
        (json!({ "type": "VEC3" }), "SCALAR"),
    ] {
        let text = complaint(|v| {
            let accessor = v["accessors"][1].as_object_mut().unwrap();
            accessor.extend(change.as_object().unwrap().clone());
        });
        assert!(text.contains(word), "{change}: {text}");
    }
    let none = complaint(|v| v["meshes"][0]["primitives"][0]["indices"] = json!(9));
    assert!(none.contains("accessor 9"), "{none}");
    let view = complaint(|v| v["bufferViews"][1]["byteLength"] = json!(usize::MAX));
    assert!(view.contains("reach beyond"), "{view}");
    let corner = complaint(|v| v["accessors"][0]["count"] = json!(3));
    assert!(corner.contains("vertex 3 of 3"), "{corner}");
    let buffer = complaint(|v| v["buffers"][0]["byteLength"] = json!(9000));
    assert!(buffer.contains("of 9000 bytes"), "{buffer}");
}

/// A file of a few bytes that states the same numbers very often.
#[test]
fn small_files_stay_small_in_memory() {
    let bomb = complaint(|v| {
        v["accessors"][0] = json!({ "componentType": 5126, "count": 1_000_000, "type": "VEC3",
            "sparse": { "count": 0, "indices": { "bufferView": 1, "componentType": 5123 },
                "values": { "bufferView": 0 } } });
        v["scenes"][0]["nodes"] = (0..1000).collect();
        v["nodes"] = (0..1000).map(|_| json!({ "mesh": 0 })).collect();
    });
    assert!(bomb.contains("more than 5000000"), "{bomb}");
}

#[test]
fn buffers_of_other_folders_and_devices_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("secret.bin"), [0; 200]).unwrap();
    std::fs::create_dir(folder.path().join("mesh")).unwrap();
    let path = folder.path().join("mesh/a.gltf");
    let with = |uri: &str| {
        let mut value = tetrahedron();
        value["buffers"][0]["uri"] = json!(uri);
        std::fs::write(&path, value.to_string()).unwrap();
        read_mesh(&path).map(|_| ()).unwrap_err().to_string()
    };
    let absolute = folder.path().join("secret.bin");
    for uri in ["../secret.bin", "%2e%2e/secret.bin", absolute.to_str().unwrap(), "/dev/zero"] {
        let text = with(uri);
        assert!(text.contains("outside the folder"), "{uri}: {text}");
    }
    assert!(with("file:///etc/passwd").contains("outside the folder"));
    assert!(with("none.bin").contains("none.bin"));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("../secret.bin", folder.path().join("mesh/link.bin")).unwrap();
        assert!(with("link.bin").contains("outside the folder"));
        std::os::unix::fs::symlink("/dev/zero", folder.path().join("mesh/zero.bin")).unwrap();
        assert!(with("zero.bin").contains("outside the folder"));
    }
    // Beside the document it is read, by its escaped name too.
    let data = tetrahedron()["buffers"][0]["uri"].as_str().unwrap().to_owned();
    let bytes = super::super::base64::from_base64(data.split_once(',').unwrap().1).unwrap();
    std::fs::write(folder.path().join("mesh/own buffer.bin"), bytes).unwrap();
    let mut value = tetrahedron();
    value["buffers"][0]["uri"] = json!("own%20buffer.bin");
    std::fs::write(&path, value.to_string()).unwrap();
    assert_eq!(read_mesh(&path).unwrap().mesh.positions.len(), 4);
}

#[test]
fn what_cannot_be_read_is_named() {
    let draco = complaint(|v| v["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]));
    assert!(draco.contains("KHR_draco_mesh_compression"), "{draco}");
    let old = complaint(|v| v["asset"]["version"] = json!("1.0"));
    assert!(old.contains("glTF 1.0"), "{old}");
}
