use super::super::mesh::{MeshFile, MeshUnit, parse_mesh};
use flate2::{Compression, write::ZlibEncoder};
use std::io::Write;
use std::path::Path;

fn read(bytes: &[u8], name: &str) -> Result<MeshFile, String> {
    parse_mesh(bytes, Path::new(name)).map_err(|error| error.to_string())
}

const POINTS: [f32; 12] = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.5];

fn check(file: MeshFile) {
    assert_eq!(file.mesh.topology.faces, [[0, 1, 2], [0, 2, 3]]);
    let found: Vec<f64> = file.mesh.positions.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    assert_eq!(found, POINTS.map(f64::from));
}

#[test]
fn legacy_files_as_text_and_binary() {
    let text = "# vtk DataFile Version 3.0\nliver, units mm\nASCII\nDATASET POLYDATA\n\
        POINTS 4 float\n0 0 0 1 0 0\n1 1 0 0 1 0.5\n\nPOLYGONS 1 5\n4 0 1 2 3\nCELL_DATA 1\n";
    let file = read(text.as_bytes(), "a.vtk").unwrap();
    assert_eq!(file.unit, Some(MeshUnit::Millimetre));
    check(file);
    let mut old =
        b"# vtk DataFile Version 3.0\nvtk output\nBINARY\nDATASET POLYDATA\nPOINTS 4 float\n"
            .to_vec();
    old.extend(POINTS.iter().flat_map(|v| v.to_be_bytes()));
    let mut new = old.clone();
    old.extend(b"\nMETADATA\nINFORMATION 0\n\nPOLYGONS 2 8\n");
    old.extend([3i32, 0, 1, 2, 3, 0, 2, 3].iter().flat_map(|v| v.to_be_bytes()));
    old.extend(b"\n");
    check(read(&old, "a.vtk").unwrap());
    new.extend(b"\nPOLYGONS 3 6\nOFFSETS vtktypeint64\n");
    new.extend([0i64, 3, 6].iter().flat_map(|v| v.to_be_bytes()));
    new.extend(b"\nCONNECTIVITY vtktypeint64\n");
    new.extend([0i64, 1, 2, 0, 2, 3].iter().flat_map(|v| v.to_be_bytes()));
    new.extend(b"\n");
    check(read(&new, "a.vtk").unwrap());
    for cut in [20, 60, 100, 140, old.len() - 4] {
        assert!(read(&old[..cut], "a.vtk").is_err(), "{cut}");
    }
}

/// A `.vtp` whose three arrays are written by `tag` (format and what goes with it) and content.
fn vtp(root: &str, arrays: [(String, String); 3], appended: &[u8]) -> Vec<u8> {
    let [points, corners, ends] = arrays;
    let array = |kind: &str, name: &str, (tag, content): (String, String)| {
        format!("<DataArray type=\"{kind}\" Name=\"{name}\" {tag}>\n {content}\n</DataArray>\n")
    };
    let mut file = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" {root}>\n<PolyData>\n\
         <Piece NumberOfPoints=\"4\" NumberOfPolys=\"2\">\n<PointData Scalars=\"x\">\n</PointData>\n\
         <Points>\n{}</Points>\n<Polys>\n{}{}</Polys>\n</Piece>\n</PolyData>\n",
        array("Float32", "Points", points),
        array("Int64", "connectivity", corners),
        array("Int64", "offsets", ends),
    )
    .into_bytes();
    file.extend(appended);
    file.extend(b"</VTKFile>\n");
    file
}

/// The three arrays as bytes.
fn data() -> [Vec<u8>; 3] {
    let whole = |list: &[i64]| list.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let points = POINTS.iter().flat_map(|v| v.to_le_bytes()).collect();
    [points, whole(&[0, 1, 2, 0, 2, 3]), whole(&[3, 6])]
}

#[test]
fn xml_files_as_text_base64_appended_and_packed() {
    use super::super::base64::base64;
    let ascii = || "format=\"ascii\"".to_string();
    let text = [
        (ascii(), POINTS.map(|v| v.to_string()).join(" ")),
        (ascii(), "0 1 2 0 2 3".into()),
        (ascii(), "3 6".into()),
    ];
    check(read(&vtp("byte_order=\"LittleEndian\"", text, b""), "a.vtp").unwrap());

    let root = "byte_order=\"LittleEndian\" header_type=\"UInt32\"";
    let headed = |d: &Vec<u8>| [&(d.len() as u32).to_le_bytes()[..], d].concat();
    let inline = data().map(|d| ("format=\"binary\"".to_string(), base64(&headed(&d))));
    check(read(&vtp(root, inline, b""), "a.vtp").unwrap());

    // Raw appended data.
    let mut raw = b"<AppendedData encoding=\"raw\">\n_".to_vec();
    let start = raw.len();
    let arrays = data().map(|d| {
        let tag = format!("format=\"appended\" offset=\"{}\"", raw.len() - start);
        raw.extend(headed(&d));
        (tag, String::new())
    });
    raw.extend(b"\n</AppendedData>\n");
    let file = vtp(root, arrays, &raw);
    check(read(&file, "a.vtp").unwrap());
    assert!(read(&file[..file.len() - 60], "a.vtp").unwrap_err().contains("truncated"));

    // Packed and in base64, header and data coded one after the other: what ParaView writes.
    let packed = |d: &[u8]| {
        let mut zip = ZlibEncoder::new(Vec::new(), Compression::default());
        zip.write_all(d).unwrap();
        let zip = zip.finish().unwrap();
        let header = [1, d.len() as u32, 0, zip.len() as u32];
        let header: Vec<u8> = header.iter().flat_map(|v| v.to_le_bytes()).collect();
        format!("{}{}", base64(&header), base64(&zip))
    };
    let mut text = String::new();
    let arrays = data().map(|d| {
        let tag = format!("format=\"appended\" offset=\"{}\"", text.len());
        text += &packed(&d);
        (tag, String::new())
    });
    let appended = format!("<AppendedData encoding=\"base64\">\n_{text}\n</AppendedData>\n");
    let root = format!("{root} compressor=\"vtkZLibDataCompressor\"");
    check(read(&vtp(&root, arrays, appended.as_bytes()), "a.vtp").unwrap());
}

#[test]
fn what_is_not_read_is_named() {
    let legacy = |rest: &str| format!("# vtk DataFile Version 3.0\nt\nASCII\n{rest}");
    for (text, word) in [
        ("solid".to_string(), "vtk DataFile"),
        (legacy("DATASET UNSTRUCTURED_GRID\n"), "POLYDATA"),
        (legacy("DATASET POLYDATA\nPOINTS 99999999999 float\n"), "at most"),
        (legacy("DATASET POLYDATA\nPOINTS 1 float\n0 0 x\n"), "'x'"),
        (legacy("DATASET POLYDATA\nPOINTS 1 float\n0 0 0\n"), "no POLYGONS"),
        (legacy("DATASET POLYDATA\nPOINTS 1 float\n0 0 0\nPOLYGONS 1 4\n9 0 0 0\n"), "9 corners"),
    ] {
        let found = read(text.as_bytes(), "a.vtk").unwrap_err();
        assert!(found.contains(word), "{word}: {found}");
    }
    let grid = "<VTKFile type=\"ImageData\">";
    assert!(read(grid.as_bytes(), "a.vtp").unwrap_err().contains("ImageData"));
    let lz4 = "<VTKFile type=\"PolyData\" compressor=\"vtkLZ4DataCompressor\">";
    assert!(read(lz4.as_bytes(), "a.vtp").unwrap_err().contains("LZ4"));
}
