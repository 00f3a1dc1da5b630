//! `--formats` through the binary, read back: the animation by the crate `gltf`, and everything by
//! independent Python libraries where they are installed (`pip install vtk pygltflib`; with
//! `DSFMS_PYTHON` the interpreter that has them).

mod common;

use common::Case;
use dsfms::io::mesh::{MeshUnit, read_mesh};
use std::process::Command;

/// Two frames by rigid pose in every format; `out`.
fn case() -> Case {
    let case = Case::new();
    case.template();
    std::fs::copy(case.path("frames/organ_003.png"), case.path("frames/organ_004.png")).unwrap();
    let arguments = ["frames", "--camera", "camera.json", "--matches", "matches.csv"];
    let code = case
        .reconstruct(&arguments)
        .args(["--method", "dsfm", "--formats", "vtp,obj,stl,glb", "--no-report", "-o", "out"])
        .assert();
    assert!(matches!(code.get_output().status.code(), Some(0 | 2)));
    case
}

#[test]
fn every_format_holds_the_frames() {
    let case = case();
    let ply = read_mesh(&case.path("out/frame_003.ply")).unwrap().mesh;
    let near = |a: &dsfms::geometry::Point3, b: &dsfms::geometry::Point3| (a - b).norm() < 1e-4;
    let obj = read_mesh(&case.path("out/frame_003.obj")).unwrap().mesh;
    assert_eq!(obj.topology.faces, ply.topology.faces);
    assert!(obj.positions.iter().zip(&ply.positions).all(|(a, b)| near(a, b)));
    let stl = read_mesh(&case.path("out/frame_003.stl")).unwrap().mesh;
    assert_eq!(stl.topology.faces.len(), ply.topology.faces.len());
    let vtp = std::fs::read_to_string(case.path("out/frame_003.vtp")).unwrap();
    for name in ["strain", "visible", "expected_error", "observed", "region", "TimeValue"] {
        assert!(vtp.contains(&format!("Name=\"{name}\"")), "{name}");
    }
    let list = std::fs::read_to_string(case.path("out/frames.pvd")).unwrap();
    assert!(list.contains("timestep=\"1\" part=\"0\" file=\"frame_004.vtp\""), "{list}");
    // The first frame, whatever viewers are told of metres and of up.
    let glb = read_mesh(&case.path("out/frames.glb")).unwrap();
    assert_eq!(glb.mesh.topology.faces, ply.topology.faces);
    assert_eq!((glb.mesh.positions, glb.unit), (ply.positions, Some(MeshUnit::Millimetre)));
    let vtp = read_mesh(&case.path("out/frame_003.vtp")).unwrap();
    assert_eq!(vtp.mesh.topology.faces, ply.topology.faces);
    let material = std::fs::read_to_string(case.path("out/frames.mtl")).unwrap();
    assert!(material.contains("map_Kd frames.png") && case.path("out/frames.png").is_file());
}

const SCRIPT: &str = r#"
import sys, numpy, vtk, pygltflib
from vtk.util.numpy_support import vtk_to_numpy
out, shapes = sys.argv[1], []
for k, name in enumerate(["frame_003", "frame_004"]):
    reader = vtk.vtkXMLPolyDataReader(); reader.SetFileName(f"{out}/{name}.vtp"); reader.Update()
    mesh = reader.GetOutput()
    ply = vtk.vtkPLYReader(); ply.SetFileName(f"{out}/{name}.ply"); ply.Update()
    ply = ply.GetOutput()
    a, b = (vtk_to_numpy(m.GetPoints().GetData()) for m in (mesh, ply))
    assert a.shape == b.shape and abs(a - b).max() < 1e-4, name
    faces = [vtk_to_numpy(m.GetPolys().GetConnectivityArray()) for m in (mesh, ply)]
    assert (faces[0] == faces[1]).all(), name
    data = mesh.GetPointData()
    arrays = {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)) for i in range(data.GetNumberOfArrays())}
    assert set(arrays) == {"strain", "visible", "expected_error", "observed", "region"}, arrays.keys()
    assert all(len(v) == len(a) for v in arrays.values())
    assert (arrays["expected_error"] > 0).all() and set(arrays["visible"]) <= {0.0, 1.0}
    assert abs(arrays["strain"]).max() < 0.5
    assert mesh.GetCellData().GetArray("strain").GetNumberOfTuples() == mesh.GetNumberOfPolys()
    assert mesh.GetFieldData().GetArray("TimeValue").GetValue(0) == k
    shapes.append(a)
glb = pygltflib.GLTF2().load(f"{out}/frames.glb")
blob = glb.binary_blob()
def read(index):
    accessor = glb.accessors[index]; view = glb.bufferViews[accessor.bufferView]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor.type]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    kind = {5126: "<f4", 5125: "<u4"}[accessor.componentType]
    return numpy.frombuffer(blob, kind, accessor.count * width, start).reshape(-1, width)
primitive = glb.meshes[0].primitives[0]
base = read(primitive.attributes.POSITION)
assert len(primitive.targets) == 1
moved = base + read(primitive.targets[0]["POSITION"] if isinstance(primitive.targets[0], dict) else primitive.targets[0].POSITION)
# Vertices are repeated along the seam: every vertex of a frame is there, and nothing else.
for found, shape in ((base, shapes[0]), (moved, shapes[1])):
    assert max(numpy.linalg.norm(shape - p, axis=1).min() for p in found) < 1e-3
    assert max(numpy.linalg.norm(found - p, axis=1).min() for p in shape) < 1e-3
sampler = glb.animations[0].samplers[0]
assert read(sampler.input).ravel().tolist() == [0.0, 1.0]
assert read(sampler.output).ravel().tolist() == [0.0, 1.0]
print("read back")
"#;

#[test]
fn independent_libraries_read_the_same() {
    let python = std::env::var("DSFMS_PYTHON").unwrap_or("python3".into());
    let has = Command::new(&python).args(["-c", "import numpy, vtk, pygltflib"]).output();
    if !has.is_ok_and(|o| o.status.success()) {
        println!("skipped: {python} has no numpy, vtk and pygltflib (pip install vtk pygltflib)");
        return;
    }
    let case = case();
    let found = Command::new(&python).args(["-c", SCRIPT]).arg(case.path("out")).output().unwrap();
    let (out, err) =
        (String::from_utf8_lossy(&found.stdout), String::from_utf8_lossy(&found.stderr));
    assert!(found.status.success() && out.contains("read back"), "{out}{err}");
}
