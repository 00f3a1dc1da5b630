//! Two geometries are never compared without their units.

mod common;

use common::Case;
use dsfms::io::mesh::read_mesh;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::template::LengthUnit;
use std::fs;

const USAGE: i32 = 64;

/// `small.ply`: the truth at another scale, in template units; `truth/frame_003.ply` is in mm.
fn case() -> Case {
    let case = Case::new();
    let truth = read_mesh(&case.path("truth/frame_003.ply")).unwrap().mesh;
    let small: Vec<_> = truth.positions.iter().map(|p| p * 0.02).collect();
    let (unit, extras) = (LengthUnit::TemplateUnit, PlyExtras::default());
    write_ply(&case.path("small.ply"), &truth.topology, &small, unit, &extras).unwrap();
    case
}

fn output(case: &Case, arguments: &[&str], code: i32) -> [String; 2] {
    let done = case.dsfms(arguments).assert().code(code).get_output().clone();
    [done.stdout, done.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
}

#[test]
fn template_units_are_not_millimetres() {
    let case = case();
    let arguments = ["evaluate", "small.ply", "truth/frame_003.ply", "--json", "e.json"];
    let [shown, why] = output(&case, &arguments, USAGE);
    assert!(shown.is_empty() && !case.path("e.json").exists(), "{shown}");
    for word in ["small.ply is in template_units", "frame_003.ply in mm", "--align similarity"] {
        assert!(why.contains(word), "{word:?} in {why}");
    }
    let [shown, _] = output(&case, &[&arguments[..], &["--align", "similarity"]].concat(), 0);
    assert!(shown.starts_with("unit mm; alignment similarity"), "{shown}");
    let json: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(case.path("e.json")).unwrap()).unwrap();
    let told = &json["small.ply"];
    assert_eq!(told["unit"], "mm");
    assert!(told["vertices"]["all"]["rms"].as_f64().unwrap() < 1e-3, "{told}");
    assert!((told["scale"].as_f64().unwrap() - 50.0).abs() < 1e-3);
    assert_eq!(told["not_computed"]["reprojection error"], "no --camera");
}

#[test]
fn metres_are_brought_to_the_unit_of_the_truth() {
    let case = case();
    let truth = read_mesh(&case.path("truth/frame_003.ply")).unwrap().mesh;
    let mut obj = String::from("# units m\n");
    for p in &truth.positions {
        obj += &format!("v {} {} {}\n", p.x / 1e3, p.y / 1e3, p.z / 1e3);
    }
    for [a, b, c] in truth.topology.faces.iter().map(|f| f.map(|v| v + 1)) {
        obj += &format!("f {a} {b} {c}\n");
    }
    fs::write(case.path("metres.obj"), obj).unwrap();
    let arguments = ["evaluate", "metres.obj", "truth/frame_003.ply", "--rest", "organ.ply"];
    let [shown, _] = output(&case, &arguments, 0);
    assert!(shown.starts_with("unit mm; alignment none"), "{shown}");
    let all: Vec<&str> = shown.lines().find(|l| l.contains(" all ")).unwrap().split(' ').collect();
    assert!(all.contains(&"0.000"), "{shown}");
    assert!(shown.contains(" zone "), "{shown}");
    // Its rest shape is in template units: no displacement can be had from it.
    let rest = ["evaluate", "metres.obj", "truth/frame_003.ply", "--rest", "small.ply"];
    let [_, why] = output(&case, &rest, USAGE);
    assert!(why.contains("--rest") && why.contains("template_units"), "{why}");
}

#[test]
fn what_is_not_computed_is_said_with_the_reason() {
    let case = case();
    fs::write(case.path("other.obj"), "# units mm\nv 0 0 75\nv 9 0 75\nv 0 9 75\nf 1 2 3\n")
        .unwrap();
    let [shown, _] = output(&case, &["evaluate", "other.obj", "truth/frame_003.ply"], 0);
    assert!(shown.contains("not computed: vertex, zone, edge and reprojection errors"), "{shown}");
    assert!(shown.contains("3 vertices, 1 faces; truth ") && shown.contains("surfaces only"));
    let same = ["evaluate", "truth/frame_003.ply", "truth/frame_003.ply"];
    let [shown, _] = output(&case, &same, 0);
    for missing in ["visible and hidden part", "deformed zone", "reprojection error"] {
        assert!(shown.contains(&format!("not computed: {missing}")), "{missing}: {shown}");
    }
}

#[test]
fn figures_and_structures_compare_units_too() {
    let case = case();
    case.template();
    let arguments = ["figure", "small.ply", "--truth", "truth/frame_003.ply", "-o", "figure.png"];
    let [_, why] = output(&case, &arguments, 1);
    assert!(why.contains("small.ply") && why.contains("template_units and in mm"), "{why}");
    let done = case
        .reconstruct(&["frames", "--camera", "camera.json", "--matches", "matches.csv"])
        .args(["--method", "rigid", "--structures", "small.ply", "-o", "out"])
        .assert()
        .code(USAGE);
    let why = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    assert!(why.contains("--structures small.ply and the template"), "{why}");
    assert!(!case.path("out").exists());
}
