use super::*;
use crate::geometry::Vector3;
use crate::io::obj::{ObjExtras, write_obj};
use crate::io::ply::{PlyExtras, Precision, write_ply};
use crate::io::stl::write_stl;
use crate::template::LengthUnit;
use crate::verdict::Region;
use std::fs;

const SQUARE_PLY: &str = "ply\nformat ascii 1.0\ncomment units mm\nelement vertex 4\n\
    property float x\nproperty float y\nproperty float z\nproperty uchar visible\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0 1\n1 0 0 0\n1 1 0 1\n0 1 0 1\n4 0 1 2 3\n";

fn read_text(name: &str, text: impl AsRef<[u8]>) -> Result<MeshFile, MeshFileError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    read_mesh(&path)
}

#[test]
fn ascii_ply_with_a_quad() {
    let file = read_text("a.ply", SQUARE_PLY).unwrap();
    assert_eq!(file.mesh.topology.faces, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(file.unit, Some(MeshUnit::Millimetre));
    assert_eq!(file.attributes["visible"], [1.0, 0.0, 1.0, 1.0]);
    assert!(file.warnings[0].contains("1 polygons"), "{:?}", file.warnings);
}

#[test]
fn big_endian_ply() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty double x\n\
        property float y\nproperty short z\nelement face 1\n\
        property list uint uchar vertex_index\nend_header\n"
        .to_vec();
    for (x, y, z) in [(0.25f64, 0.5f32, 3i16), (1.0, 0.0, -2), (0.0, 1.0, 7)] {
        bytes.extend(x.to_be_bytes());
        bytes.extend(y.to_be_bytes());
        bytes.extend(z.to_be_bytes());
    }
    bytes.extend(3u32.to_be_bytes());
    bytes.extend([2u8, 1, 0]);
    let file = read_text("b.ply", &bytes).unwrap();
    assert_eq!(file.mesh.positions[0], Point3::new(0.25, 0.5, 3.0));
    assert_eq!(file.mesh.positions[1].z, -2.0);
    assert_eq!(file.mesh.topology.faces, [[2, 1, 0]]);
    assert_eq!(file.unit, None);
    bytes.truncate(bytes.len() - 2);
    let error = read_text("b.ply", &bytes).unwrap_err();
    assert!(matches!(&error, MeshFileError::Truncated { what, .. } if what == "face 0 of 1"));
}

#[test]
fn expected_errors_of_earlier_files_have_their_name() {
    // Files of earlier versions call it confidence.
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                property float z\nproperty float confidence\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n\
                0 0 0 0.5\n1 0 0 1.5\n0 1 0 2.5\n3 0 1 2\n";
    let file = read_text("a.ply", text.as_bytes()).unwrap();
    assert_eq!(file.attributes["expected_error"], [0.5, 1.5, 2.5]);
    assert!(!file.attributes.contains_key("confidence"));
}

#[test]
fn written_ply_reads_back_exactly_in_double() {
    let mesh = read_text("a.ply", SQUARE_PLY).unwrap().mesh;
    let mesh = mesh.with_positions(mesh.positions.iter().map(|p| p * 0.1).collect());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.ply");
    let (visible, expected_error) = ([true, false, true, true], [0.5, 1.0, 2.0, 0.25]);
    let extras = PlyExtras {
        precision: Precision::Double,
        comments: &["made for a test".into()],
        visible: Some(&visible),
        expected_error: Some(&expected_error),
        observed: Some(&visible),
        region: Some(&[Region::Observed, Region::Hidden, Region::Contradicted, Region::Folded]),
        color: Some(&[[9, 8, 7]; 4]),
        normals: Some(&[Vector3::z(); 4]),
    };
    write_ply(&path, &mesh.topology, &mesh.positions, LengthUnit::TemplateUnit, &extras).unwrap();
    let back = read_mesh(&path).unwrap();
    assert_eq!(back.mesh.positions, mesh.positions);
    assert_eq!(back.mesh.topology, mesh.topology);
    assert_eq!(back.unit, Some(MeshUnit::TemplateUnit));
    assert_eq!(back.attributes["expected_error"], expected_error);
    assert_eq!((back.attributes["nz"][3], back.attributes["green"][0]), (1.0, 8.0));
    assert_eq!(back.attributes["observed"], [1.0, 0.0, 1.0, 1.0]);
    let short = PlyExtras { visible: Some(&visible[..2]), ..PlyExtras::default() };
    let error = write_ply(&path, &mesh.topology, &mesh.positions, LengthUnit::Millimetre, &short);
    assert!(error.unwrap_err().to_string().contains("2 values per vertex for 4"));
}

#[test]
fn obj_keeps_vertex_order_and_corner_uv() {
    let text = "# units cm\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n\
        vt 0.5 0.5\nvn 0 0 1\nf 3/4/1 1/1/1 2/2/1\nf -2/3 -1/2 -4/1\n";
    let file = read_text("a.obj", text).unwrap();
    assert_eq!(file.mesh.topology.faces, [[2, 0, 1], [2, 3, 0]]);
    assert_eq!(file.mesh.positions[3], Point3::new(0.0, 1.0, 0.0));
    let uv = file.uv.unwrap();
    assert_eq!(uv[0][0], Point2::new(0.5, 0.5));
    assert_eq!(uv[1], [Point2::new(1.0, 1.0), Point2::new(1.0, 0.0), Point2::new(0.0, 0.0)]);
    assert_eq!(file.unit, Some(MeshUnit::Centimetre));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.obj");
    let extras = ObjExtras { uv: Some(&uv), material: None };
    write_obj(&path, &file.mesh, LengthUnit::Millimetre, &extras).unwrap();
    let back = read_mesh(&path).unwrap();
    assert_eq!(back.mesh.topology, file.mesh.topology);
    assert_eq!(back.uv, Some(uv));
}

#[test]
fn stl_merges_equal_corners_in_order_of_appearance() {
    let mesh = read_text("a.ply", SQUARE_PLY).unwrap().mesh;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.stl");
    write_stl(&path, &mesh, LengthUnit::Millimetre).unwrap();
    let back = read_mesh(&path).unwrap();
    assert_eq!(back.mesh.topology, mesh.topology);
    assert_eq!(back.mesh.positions, mesh.positions);
    let bytes = fs::read(&path).unwrap();
    let error = read_text("cut.stl", &bytes[..bytes.len() - 10]).unwrap_err();
    assert!(matches!(error, MeshFileError::Truncated { .. }), "{error}");
    // It states one triangle and holds two.
    let mut fewer = bytes.clone();
    fewer[80] = 1;
    let error = read_text("a.stl", &fewer).unwrap_err().to_string();
    assert!(error.contains("states 1 triangles") && error.contains("2 are there"), "{error}");
}

#[test]
fn rows_without_content_are_not_counted() {
    let text = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\n\
        element nothing 900000000000000000\nend_header\n";
    let error = read_text("a.ply", text).unwrap_err().to_string();
    assert!(error.contains("'nothing' has no property"), "{error}");
}

#[test]
fn every_bad_file_is_named() {
    let missing = read_mesh(Path::new("no/such/organ.ply")).unwrap_err();
    assert!(missing.to_string().contains("organ.ply"), "{missing}");
    assert!(matches!(read_text("a.ply", ""), Err(MeshFileError::Empty { .. })));
    assert!(matches!(read_text("a.xyz", "1"), Err(MeshFileError::UnknownFormat { .. })));
    assert!(matches!(read_text("a.ply", "hello\n"), Err(MeshFileError::Malformed { .. })));
    assert!(matches!(read_text("a.ply", "ply\n"), Err(MeshFileError::Truncated { .. })));
    assert!(matches!(read_text("a.glb", "glTF"), Err(MeshFileError::Truncated { .. })));
    assert!(matches!(read_text("a.gltf", "{}"), Err(MeshFileError::Malformed { .. })));
    let nan = SQUARE_PLY.replace("1 1 0 1\n", "1 nan 0 1\n");
    assert!(matches!(
        read_text("a.ply", nan),
        Err(MeshFileError::NotFinite { vertex: 2, count: 1, .. })
    ));
    let none = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    assert!(matches!(
        read_text("a.obj", none),
        Err(MeshFileError::Topology { source: TopologyError::NoFaces, .. })
    ));
    let line = format!("{none}v 2 0 0\nf 1 2 3\nf 1 4 2\n");
    assert!(matches!(
        read_text("a.obj", line),
        Err(MeshFileError::ZeroArea { face: 1, count: 1, .. })
    ));
    let range = read_text("a.obj", format!("{none}f 1 2 9\n")).unwrap_err();
    assert!(range.to_string().contains("names vertex 8"), "{range}");
    let word = read_text("a.obj", "v 0 zero 0\n").unwrap_err();
    assert!(word.to_string().contains("line 1: expected a number, found 'zero'"), "{word}");
}

#[test]
fn oddities_are_remarked_upon() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nv 5 0 0\nv 5 1 0\nv 9 9 9\n\
        f 1 2 3\nf 4 5 6\n";
    let warnings = read_text("a.obj", text).unwrap().warnings.join("\n");
    assert!(warnings.contains("1 vertices belong to no face"), "{warnings}");
    assert!(warnings.contains("2 separate components"), "{warnings}");
    assert!(warnings.contains("1 vertices repeat"), "{warnings}");
}

#[test]
fn lengths_are_brought_to_another_unit_where_both_scales_are_known() {
    let file = |unit| MeshFile { unit, ..read_text("a.ply", SQUARE_PLY).unwrap() };
    let width = |file: MeshFile| file.mesh.positions[1].x;
    let mm = MeshUnit::Millimetre;
    assert_eq!(width(file(Some(MeshUnit::Metre)).in_unit(mm).unwrap()), 1000.0);
    assert_eq!(width(file(Some(mm)).in_unit(MeshUnit::Centimetre).unwrap()), 0.1);
    assert_eq!(width(file(None).in_unit(mm).unwrap()), 1.0);
    assert_eq!(file(None).in_unit(mm).unwrap().unit, Some(mm));
    let refused = file(Some(MeshUnit::TemplateUnit)).in_unit(mm).unwrap_err();
    assert!(refused.to_string().contains("template_units and in mm"), "{refused}");
    assert!(file(Some(mm)).in_unit(MeshUnit::TemplateUnit).is_err());
}

const SOLID: &str = "solid\nfacet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 0 1 0\n \
                     endloop\nendfacet\nendsolid\n";

#[test]
fn text_of_several_solids_is_one_mesh() {
    let second =
        SOLID.replace("vertex 0 1 0", "vertex 1 1 0").replace("vertex 0 0 0", "VERTEX 0 1 0");
    let file = read_text("a.stl", SOLID.to_owned() + &second).unwrap();
    assert_eq!((file.mesh.positions.len(), file.mesh.topology.faces.len()), (4, 2));
    for text in [SOLID.to_uppercase(), format!("\u{feff}{SOLID}"), format!("  {SOLID}")] {
        assert_eq!(read_text("a.stl", text).unwrap().mesh.topology.faces, [[0, 1, 2]]);
    }
    let error = |text: String| read_text("a.stl", text).unwrap_err().to_string();
    assert!(error(SOLID.replace("1 0 0", "1 zero 0")).contains("line 5: expected three numbers"));
    assert!(error(SOLID.replace("  vertex 0 1 0\n", "")).contains("2 corners"));
    assert!(error(SOLID.replace("endsolid\n", "")).contains("endsolid"));
}

#[test]
fn a_mark_before_the_text_is_no_vertex() {
    let file = read_text("a.obj", "\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert_eq!((file.mesh.positions.len(), file.mesh.topology.faces.len()), (3, 1));
    assert!(read_text("a.ply", format!("\u{feff}{SQUARE_PLY}")).is_ok());
}

#[test]
fn a_unit_that_is_not_known_draws_a_warning() {
    let file = read_text("a.ply", SQUARE_PLY.replace("units mm", "units inch")).unwrap();
    assert_eq!(file.unit, None);
    assert!(file.warnings.iter().any(|w| w.contains("'inch'")), "{:?}", file.warnings);
}
