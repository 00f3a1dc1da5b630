//! Meshes and cameras of other programs through the binary.

mod common;

use common::Case;
use dsfms::io::mesh::{MeshUnit, read_mesh};
use std::fs;

fn said(case: &Case, arguments: &[&str], code: i32) -> String {
    let done = case.dsfms(arguments).assert().code(code).get_output().clone();
    String::from_utf8_lossy(&done.stderr).into_owned()
}

/// A mesh of the case as OBJ, its lengths times `factor`, with a unit in a comment.
fn obj(
    case: &Case,
    name: &str,
    factor: f64,
    comment: &str,
    faces: impl Fn(usize, [u32; 3]) -> [u32; 3],
) {
    let mesh = read_mesh(&case.path("organ.ply")).unwrap().mesh;
    let mut text = format!("{comment}\n");
    for p in &mesh.positions {
        text += &format!("v {} {} {}\n", p.x * factor, p.y * factor, p.z * factor);
    }
    for (k, face) in mesh.topology.faces.iter().enumerate() {
        let [a, b, c] = faces(k, *face).map(|v| v + 1);
        text += &format!("f {a} {b} {c}\n");
    }
    fs::write(case.path(name), text).unwrap();
}

#[test]
fn every_format_of_export_is_the_template_again() {
    let case = Case::new();
    case.template();
    let names = ["a.ply", "a.obj", "a.vtp", "a.glb"];
    let mut arguments = vec!["export", "organ.template"];
    names.iter().for_each(|name| arguments.extend(["--mesh", name]));
    said(&case, &arguments, 0);
    let template = read_mesh(&case.path("organ.template/template.ply")).unwrap().mesh;
    for name in names {
        let file = read_mesh(&case.path(name)).unwrap();
        assert_eq!(file.mesh.topology.faces, template.topology.faces, "{name}");
        assert_eq!(file.unit, Some(MeshUnit::Millimetre), "{name}");
        let near = file.mesh.positions.iter().zip(&template.positions);
        assert!(near.into_iter().all(|(a, b)| (a - b).norm() < 1e-5), "{name}");
        let done = case.dsfms(&["evaluate", name, "organ.ply"]).assert().success();
        let shown = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
        assert!(shown.starts_with("unit mm") && shown.contains(" all "), "{name}: {shown}");
    }
    let obj = fs::read_to_string(case.path("a.obj")).unwrap();
    assert!(obj.contains("mtllib a.mtl"), "{obj:.200}");
    assert!(fs::read_to_string(case.path("a.mtl")).unwrap().contains("map_Kd a.png"));
    assert!(case.path("a.png").is_file());
    let ply = read_mesh(&case.path("a.ply")).unwrap();
    assert!(ply.attributes.contains_key("nx") && ply.attributes.contains_key("red"));
}

#[test]
fn units_are_honoured_and_can_be_given() {
    let case = Case::new();
    obj(&case, "metres.obj", 1e-3, "# units m", |_, f| f);
    obj(&case, "plain.obj", 0.1, "# no word of lengths", |_, f| f);
    let width = |template: &str| {
        let file = read_mesh(&case.path(&format!("{template}/template.ply"))).unwrap();
        assert_eq!(file.unit, Some(MeshUnit::Millimetre));
        dsfms::eval::zone::extent(&file.mesh.positions)
    };
    let true_width =
        dsfms::eval::zone::extent(&read_mesh(&case.path("organ.ply")).unwrap().mesh.positions);
    let build = |mesh: &str, more: &[&str], out: &str| {
        said(&case, &[&["template", "--mesh", mesh, "-o", out, "--no-report"], more].concat(), 0)
    };
    let text = build("metres.obj", &[], "a");
    assert!(text.contains("is in m:") && (width("a") - true_width).abs() < 1e-6, "{text}");
    let text = build("plain.obj", &[], "b");
    assert!(text.contains("states no unit, and is taken to be in mm"), "{text}");
    build("plain.obj", &["--mesh-unit", "cm"], "c");
    assert!((width("c") - true_width).abs() < 1e-6);
    // Nothing of the size of an organ: said, with the way out.
    let text = build("plain.obj", &["--mesh-unit", "m"], "d");
    assert!(text.contains("which no organ is") && text.contains("--mesh-unit"), "{text}");
    let alone = ["template", "frames", "--camera", "camera.json", "--repair", "-o", "e"];
    assert!(said(&case, &alone, 64).contains("--repair belong to --mesh"));
}

#[test]
fn faults_are_mended_when_asked() {
    let case = Case::new();
    obj(
        &case,
        "turned.obj",
        1.0,
        "# units mm",
        |k, [a, b, c]| if k == 5 { [a, c, b] } else { [a, b, c] },
    );
    let mut text = fs::read_to_string(case.path("turned.obj")).unwrap();
    let again = text.lines().last().unwrap().to_string();
    text += &format!("{again}\n");
    fs::write(case.path("turned.obj"), text).unwrap();
    let build = ["template", "--mesh", "turned.obj", "-o", "t", "--no-report"];
    let refused = said(&case, &build, 1);
    assert!(refused.contains("turned.obj") && refused.contains("--repair"), "{refused}");
    let told = said(&case, &[&build[..], &["--repair"]].concat(), 0);
    for word in ["repaired: 1 faces had the three corners", "repaired: 1 faces ran against"] {
        assert!(told.contains(word), "{word}: {told}");
    }
    let found = read_mesh(&case.path("t/template.ply")).unwrap().mesh;
    let organ = read_mesh(&case.path("organ.ply")).unwrap().mesh;
    assert_eq!(found.topology.faces, organ.topology.faces);
}

#[test]
fn one_posed_frame_dresses_a_mesh() {
    let case = Case::new();
    let pose =
        r#"[{"image": "organ_003.png", "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [1, -0.5, 75]}]"#;
    fs::write(case.path("poses.json"), pose).unwrap();
    let arguments = ["template", "frames", "--camera", "camera.json", "--mesh", "organ.ply"];
    let more = ["--poses", "poses.json", "-o", "one", "--no-report"];
    let text = said(&case, &[&arguments[..], &more].concat(), 0);
    assert!(text.contains("one frame has a pose"), "{text}");
    let shown = case.dsfms(&["inspect", "one"]).assert().success();
    let shown = String::from_utf8_lossy(&shown.get_output().stdout).into_owned();
    assert!(shown.contains("albedo") && !shown.contains(" 0.0 % observed"), "{shown}");
    // The names of the image files, for programs that look for them.
    said(&case, &["export", "one", "--colmap", "sparse", "--images", "frames"], 0);
    let images = fs::read_to_string(case.path("sparse/images.txt")).unwrap();
    assert!(images.contains(" organ_003.png"), "{images}");
    let other = ["export", "one", "--colmap", "sparse2", "--images", "truth"];
    said(&case, &other, 1);
}

#[test]
fn matches_alone_give_the_surface_that_images_give() {
    let case = Case::new();
    said(&case, &["template", "--mesh", "organ.ply", "-o", "bare", "--no-report"], 0);
    fs::create_dir(case.path("tracks")).unwrap();
    fs::copy(case.path("matches.csv"), case.path("tracks/organ_003.csv")).unwrap();
    let run = |images: &[&str], matches: &str, out: &str| {
        let start = [&["reconstruct", "bare"], images, &["--matches", matches]].concat();
        let end = ["--camera", "camera.json", "--method", "dsfm", "-o", out];
        said(&case, &[&start[..], &end].concat(), 0);
        read_mesh(&case.path(&format!("{out}/frame_003.ply"))).unwrap().mesh.positions
    };
    let seen = run(&["frames"], "matches.csv", "seen");
    assert_eq!(run(&[], "tracks", "blind"), seen);
    assert!(case.path("blind/frame_003_overlay.png").is_file());
    // What would look at images says so.
    let blind =
        ["reconstruct", "bare", "--matches", "tracks", "--camera", "camera.json", "-o", "no"];
    let text = said(&case, &[&blind[..], &["--method", "joint"]].concat(), 64);
    assert!(text.contains("--method joint looks at images"), "{text}");
    let text = said(&case, &[&blind[..], &["--organ-masks", "frames"]].concat(), 64);
    assert!(text.contains("masks belong to images"), "{text}");
    let empty =
        ["reconstruct", "bare", "--matches", "truth", "--camera", "camera.json", "-o", "no"];
    let text = said(&case, &empty, 1);
    assert!(text.contains("truth") && text.contains("one CSV a frame"), "{text}");
    assert!(!case.path("no").exists());
}
