use super::*;

fn file(name: &str, text: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

fn point(x: f64, y: f64, z: f64) -> MarkPlace {
    MarkPlace::Point(Point3::new(x, y, z))
}

fn mark(name: &str, place: MarkPlace) -> Mark {
    Mark { name: name.into(), place }
}

#[test]
fn pairs_come_as_points_and_vertices() {
    let (_folder, path) = file(
        "a.csv",
        "# picked by hand\nname,ct_x,ct_y,ct_z,template_vertex\nfundus,1,2,3,7\n,4.5,5,-6e1,0\n",
    );
    let found = read_pairs(&path).unwrap();
    assert_eq!((found[0].name.as_str(), found[1].name.as_str()), ("fundus", "2"));
    assert_eq!((found[0].ct, found[0].template), (point(1., 2., 3.), MarkPlace::Vertex(7)));
    assert_eq!(found[1].ct, point(4.5, 5., -60.));
    let (_folder, json) =
        file("a.json", r#"{"pairs": [{"name": "fundus", "ct": [1, 2, 3], "template": 7}]}"#);
    assert_eq!(read_pairs(&json).unwrap(), found[..1]);
    assert_eq!(MarkPlace::Vertex(1).on(&[Point3::origin(); 2], 10.0), Ok(Point3::origin()));
    assert_eq!(point(1., 0., 2.).on(&[], 10.0), Ok(Point3::new(10., 0., 20.)));
    assert!(MarkPlace::Vertex(2).on(&[Point3::origin(); 2], 1.0).unwrap_err().contains("has 2"));
}

#[test]
fn wrong_files_name_file_line_or_field() {
    let gone = read_pairs(Path::new("none/a.csv")).unwrap_err().to_string();
    assert!(gone.contains("a.csv: no such file"), "{gone}");
    let kept = |name: &str, text: &str| {
        let (_folder, path) = file(name, text);
        read_pairs(&path).unwrap_err().to_string()
    };
    for (name, text, needle) in [
        ("a.csv", "ct_x,ct_y,ct_z,template_x,template_y\n1,2,3,4,5\n", "template_vertex"),
        ("a.csv", "ct_vertex,template_vertex\n1\n", "line 2: 1 values"),
        ("a.csv", "ct_vertex,template_vertex\n1,-2\n", "line 2: \"-2\" is no vertex"),
        ("a.csv", "ct_x,ct_y,ct_z,template_vertex\n1,nan,3,4\n", "finite"),
        ("a.json", "{\"pairs\": [{\"ct\": [1, 2], \"template\": 3}]}", "pairs[0].ct"),
        ("a.json", "{\"pairs\": [{\"ct\": 1}]}", "pairs[0].template"),
        ("a.json", "{\"markups\": []}", "second file"),
        ("a.json", "[]", "field pairs"),
        ("a.fcsv", "1,2,3\n", "beside"),
    ] {
        let text = kept(name, text);
        assert!(text.contains(needle) && text.contains(name), "{needle}: {text}");
    }
}

#[test]
fn slicer_s_points_come_in_the_axes_of_the_mesh() {
    let markups = r#"{"markups": [{"type": "Fiducial", "coordinateSystem": "RAS", "controlPoints": [
        {"label": "F-1", "position": [1.0, 2.0, 3.0], "positionStatus": "defined"},
        {"label": "F-2", "position": [0, 0, 0], "positionStatus": "undefined"}]}]}"#;
    let (_folder, path) = file("ct.mrk.json", markups);
    assert_eq!(read_points(&path, Axes::Lps).unwrap(), [mark("F-1", point(-1., -2., 3.))]);
    assert_eq!(read_points(&path, Axes::Ras).unwrap(), [mark("F-1", point(1., 2., 3.))]);
    let fcsv = "# Markups fiducial file version = 4.11\n# CoordinateSystem = LPS\n\
                # columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc\n\
                vtk_1,1,2,3,0,0,0,1,1,1,0,F-1,\n";
    let (_folder, path) = file("ct.fcsv", fcsv);
    assert_eq!(read_points(&path, Axes::Lps).unwrap(), [mark("F-1", point(1., 2., 3.))]);
    let bad = fcsv.replace("LPS", "XYZ");
    let (_folder, path) = file("ct.fcsv", &bad);
    let text = read_points(&path, Axes::Lps).unwrap_err().to_string();
    assert!(text.contains("CoordinateSystem") && text.contains("XYZ"), "{text}");
}

#[test]
fn meshlab_s_points_are_read() {
    let text = r#"<!DOCTYPE PickedPoints><PickedPoints>
        <point x="1.5" y="-2" active="1" z="3e1" name="tip"/>
        <point x="0" y="0" z="0" active="0" name="off"/></PickedPoints>"#;
    let (_folder, path) = file("a.pp", text);
    assert_eq!(read_points(&path, Axes::Lps).unwrap(), [mark("tip", point(1.5, -2., 30.))]);
    let (_folder, path) = file("a.pp", "<point x=\"1\" y=\"b\" z=\"2\"/>");
    assert!(read_points(&path, Axes::Lps).unwrap_err().to_string().contains("point 0, y"));
}

#[test]
fn marks_pair_by_name_else_by_order() {
    let marks = |names: &[&str]| -> Vec<Mark> {
        names.iter().enumerate().map(|(k, n)| mark(n, MarkPlace::Vertex(k))).collect()
    };
    let paths = [Path::new("ct.csv"), Path::new("t.csv")];
    let (pairs, alone) =
        pair_up(paths, marks(&["a", "b", "c", "d"]), marks(&["d", "c", "b", "x"])).unwrap();
    assert_eq!(pairs.iter().map(|p| p.name.as_str()).collect::<Vec<_>>(), ["b", "c", "d"]);
    assert_eq!((pairs[0].ct, pairs[0].template), (MarkPlace::Vertex(1), MarkPlace::Vertex(2)));
    assert_eq!(alone, ["a", "x"]);
    let (pairs, _) = pair_up(paths, marks(&["a", "b"]), marks(&["x", "y"])).unwrap();
    assert_eq!((pairs[1].ct, pairs[1].template), (MarkPlace::Vertex(1), MarkPlace::Vertex(1)));
    let error = pair_up(paths, marks(&["a", "b"]), marks(&["x"])).unwrap_err().to_string();
    assert!(error.contains("ct.csv") && error.contains("t.csv holds 1"), "{error}");
}
