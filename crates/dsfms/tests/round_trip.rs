//! Every format gives back what was written: vertices, their order, faces, unit, texture
//! coordinates.

use dsfms::Mesh;
use dsfms::geometry::{Point2, Point3};
use dsfms::io::mesh::{MeshFile, MeshUnit, read_mesh};
use dsfms::io::obj::{ObjExtras, write_obj};
use dsfms::io::ply::{PlyExtras, Precision, write_ply};
use dsfms::io::stl::write_stl;
use dsfms::io::template::write_viewer;
use dsfms::io::vtk::{VtkExtras, write_vtp};
use dsfms::pipeline::{Silent, TemplateOptions, template_from_mesh};
use dsfms::synth::{Random, patch};
use dsfms::template::{LengthUnit, SurfaceTexels, Template};
use std::path::Path;

/// A patch whose vertices come in a random order, with one that no face has, in 32-bit numbers.
fn surface(seed: u64) -> Mesh {
    let mesh = patch(120, seed).mesh;
    let n = mesh.positions.len();
    let mut random = Random::new(seed, 3);
    let mut order: Vec<usize> = (0..n).collect();
    for k in (1..n).rev() {
        order.swap(k, random.below(k + 1));
    }
    let single = |p: &Point3| Point3::from(p.coords.map(|x| f64::from(x as f32)));
    let mut positions = vec![Point3::origin(); n + 1];
    for (old, &new) in order.iter().enumerate() {
        positions[new] = single(&mesh.positions[old]);
    }
    positions[n] = Point3::new(1.0, 2.0, 3.0);
    let faces = mesh.topology.faces.iter().map(|f| f.map(|v| order[v as usize] as u32)).collect();
    Mesh::new(positions, faces).unwrap()
}

fn template(seed: u64, unit: LengthUnit) -> Template {
    let mesh = surface(seed);
    let values = vec![[0.4, 0.3, 0.2]; mesh.positions.len()];
    let resolution = vec![4; mesh.topology.faces.len()];
    let albedo = SurfaceTexels::from_vertex_values(&mesh, &values, resolution).unwrap();
    template_from_mesh(mesh, unit, Some(albedo), &TemplateOptions::default(), &Silent)
}

fn write(path: &Path, t: &Template) {
    let (mesh, unit) = (&t.mesh, t.unit);
    let uv = t.flattening.as_ref().map(|f| f.corners.as_slice());
    let single = PlyExtras::default();
    let double = PlyExtras { precision: Precision::Double, ..Default::default() };
    match path.file_name().unwrap().to_str().unwrap() {
        "a.ply" => write_ply(path, &mesh.topology, &mesh.positions, unit, &single).unwrap(),
        "double.ply" => write_ply(path, &mesh.topology, &mesh.positions, unit, &double).unwrap(),
        "a.obj" => write_obj(path, mesh, unit, &ObjExtras { uv, material: None }).unwrap(),
        "plain.obj" => write_obj(path, mesh, unit, &ObjExtras::default()).unwrap(),
        "a.vtp" => {
            let extras = VtkExtras::default();
            write_vtp(path, &mesh.topology, &mesh.positions, unit, &extras).unwrap();
        }
        "a.glb" => write_viewer(path, t).unwrap(),
        "a.stl" => write_stl(path, mesh, unit).unwrap(),
        other => panic!("{other}"),
    }
}

#[test]
fn vertices_order_faces_and_unit_come_back() {
    let folder = tempfile::tempdir().unwrap();
    for (seed, unit) in [(1, LengthUnit::Millimetre), (2, LengthUnit::TemplateUnit)] {
        let template = template(seed, unit);
        for name in ["a.ply", "double.ply", "a.obj", "plain.obj", "a.vtp", "a.glb"] {
            let path = folder.path().join(name);
            write(&path, &template);
            let MeshFile { mesh, uv, unit: found, .. } = read_mesh(&path).unwrap();
            // An OBJ holds the shortest text of a 32-bit number.
            let single = |mesh: &Mesh| -> Vec<[f32; 3]> {
                mesh.positions.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect()
            };
            assert_eq!(single(&mesh), single(&template.mesh), "{name}");
            assert_eq!(mesh.topology.faces, template.mesh.topology.faces, "{name}");
            assert_eq!(found, Some(MeshUnit::from(unit)), "{name}");
            if ["a.obj", "a.glb"].contains(&name) {
                let near = |(a, b): (&Point2, &Point2)| (a - b).norm() < 1e-6;
                let wanted = &template.flattening.as_ref().unwrap().corners;
                let uv = uv.unwrap();
                assert!(uv.iter().flatten().zip(wanted.iter().flatten()).all(near), "{name}");
            }
        }
    }
}

/// STL has no vertices, only corners of faces: their places and the order of the faces come back.
#[test]
fn an_stl_gives_back_its_faces_and_unit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.stl");
    let template = template(5, LengthUnit::TemplateUnit);
    write(&path, &template);
    let file = read_mesh(&path).unwrap();
    let corners = |mesh: &Mesh, f: usize| mesh.corners(f).map(|p| *p);
    for f in 0..template.mesh.topology.faces.len() {
        assert_eq!(corners(&file.mesh, f), corners(&template.mesh, f));
    }
    assert_eq!(file.unit, Some(MeshUnit::TemplateUnit));
}

/// Texture coordinate `i` is that of vertex `i`, and there are no more than the seams need: what
/// keeps the order of vertices in programs that number them by pairs.
#[test]
fn an_obj_has_every_texture_coordinate_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    let template = template(3, LengthUnit::Millimetre);
    write(&path, &template);
    let text = std::fs::read_to_string(&path).unwrap();
    let count = |start: &str| text.lines().filter(|l| l.starts_with(start)).count();
    let corners = 3 * template.mesh.topology.faces.len();
    assert_eq!(count("v "), template.mesh.positions.len());
    assert!(count("vt ") >= count("v ") && count("vt ") < corners / 2, "{}", count("vt "));
    let own = |line: &str| {
        let pair = line.split(' ').nth(1).unwrap();
        pair.split_once('/').is_some_and(|(v, t)| v == t)
    };
    let faces = text.lines().filter(|l| l.starts_with("f "));
    assert!(faces.filter(|line| own(line)).count() > corners / 6);
}
