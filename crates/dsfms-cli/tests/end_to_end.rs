//! template -> inspect -> reconstruct -> evaluate through the binary, on a tiny synthetic case.

mod common;

use common::Case;
use dsfms::expected_error::Model;
use std::fs;

#[test]
fn a_known_mesh_goes_all_the_way() {
    let case = Case::new();
    case.template();
    let shown = case.dsfms(&["inspect", "organ.template"]).assert().success();
    let shown = String::from_utf8_lossy(&shown.get_output().stdout).into_owned();
    for word in ["mm", "vertices", "flattening", "albedo"] {
        assert!(shown.contains(word), "{shown}");
    }
    let run = |method: &str| {
        let code = case
            .reconstruct(&["frames", "--camera", "camera.json", "--matches", "matches.csv"])
            .args(["--method", method, "-o", method])
            .assert()
            .get_output()
            .status
            .code();
        assert!(matches!(code, Some(0 | 2)), "{method}: {code:?}");
        assert!(case.path(&format!("{method}/frame_003_overlay.png")).is_file());
        let json = fs::read_to_string(case.path(&format!("{method}/frame_003.json"))).unwrap();
        assert!(json.contains("\"pose\"") && json.contains("\"stages\""), "{json}");
        let report: serde_json::Value = serde_json::from_str(&json).unwrap();
        let bound = report["expected_error"]["bound"].as_f64();
        assert_eq!(bound, (method == "dsfm").then(|| Model::MotionSeen.bound()));
        let csv = fs::read_to_string(case.path(&format!("{method}/summary.csv"))).unwrap();
        assert_eq!(csv.lines().count(), 2, "{csv}");
        error_of(&case, method)
    };
    let [rigid, motion] = ["rigid", "dsfm"].map(run);
    assert!(rigid < 3.0, "rigid pose: {rigid} mm rms");
    assert!(motion < rigid + 0.1, "eq. 3: {motion} mm rms, rigid pose {rigid}");
}

/// Vertex error, mm rms, by the evaluate command.
fn error_of(case: &Case, method: &str) -> f64 {
    let json = format!("{method}.json");
    case.dsfms(&["evaluate", method, "truth", "--rest", "organ.ply", "--json", &json])
        .args(["--camera", "camera.json"])
        .assert()
        .success();
    let text = fs::read_to_string(case.path(&json)).unwrap();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let errors = &value["frame_003.ply"]["vertices"];
    assert!(errors["visible_zone"]["rms"].is_number(), "{text}");
    errors["all"]["rms"].as_f64().unwrap()
}

#[test]
fn the_mesh_comes_back_with_its_order_and_unit() {
    let case = Case::new();
    case.template();
    case.reconstruct(&["frames/organ_003.png", "--camera", "camera.json"])
        .args(["--matches", "matches.csv", "--method", "rigid", "-o", "out"])
        .assert()
        .success();
    let read = |name: &str| dsfms::io::mesh::read_mesh(&case.path(name)).unwrap();
    let (rest, found) = (read("organ.ply"), read("out/frame_003.ply"));
    assert_eq!(rest.mesh.topology.faces, found.mesh.topology.faces);
    assert!(found.attributes.contains_key("visible"));
    assert!(fs::read(case.path("out/frame_003.ply")).unwrap().starts_with(b"ply"));
    assert_eq!(found.unit, Some(dsfms::io::mesh::MeshUnit::Millimetre));
}

#[test]
fn help_and_version_are_successes() {
    let case = Case::new();
    for arguments in [&["--help"][..], &["--version"], &["template", "--help"], &["help", "demo"]] {
        case.dsfms(arguments).assert().code(0);
    }
    let help = case.dsfms(&["reconstruct", "--help"]).assert().success();
    let help = String::from_utf8_lossy(&help.get_output().stdout).into_owned();
    assert!(help.contains("white = instrument") && help.contains("Examples:"), "{help}");
}

#[test]
fn alone_it_shows_help_and_the_version_names_the_commit() {
    let case = Case::new();
    let alone = case.dsfms(&[]).assert().code(64);
    let help = String::from_utf8_lossy(&alone.get_output().stderr).into_owned();
    assert!(help.contains("Usage:") && help.contains("reconstruct"), "{help}");
    let version = case.dsfms(&["--version"]).assert().success();
    let version = String::from_utf8_lossy(&version.get_output().stdout).into_owned();
    assert!(version.starts_with("dsfms 0."), "{version}");
    let inside = std::process::Command::new("git").args(["rev-parse", "HEAD"]).output();
    if let Some(commit) = inside.ok().filter(|done| done.status.success()) {
        let commit = String::from_utf8_lossy(&commit.stdout)[..12].to_owned();
        assert!(version.contains(&format!("({commit})")), "{version}");
    }
}

#[test]
fn completions_and_manual_pages() {
    let case = Case::new();
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let done = case.dsfms(&["completions", shell]).assert().success();
        let text = String::from_utf8_lossy(&done.get_output().stdout).into_owned();
        assert!(text.contains("reconstruct") && text.contains("instrument-masks"), "{shell}");
    }
    case.dsfms(&["man", "man1"]).assert().success();
    let page = |name: &str| fs::read_to_string(case.path(&format!("man1/{name}"))).unwrap();
    assert!(page("dsfms.1").contains("reconstruct"));
    assert!(page("dsfms-template.1").contains("organ\\-masks"));
    assert!(page("dsfms-experiment-ext.1").contains("dsfms"));
}

#[test]
fn progress_for_programs_is_a_line_of_json_each() {
    let case = Case::new();
    case.template();
    let done = case
        .reconstruct(&["frames", "--camera", "camera.json", "--matches", "matches.csv"])
        .args(["--method", "rigid", "--progress", "json", "-o", "out"])
        .assert()
        .success();
    let text = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
    let lines: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    let last = lines.iter().rfind(|line| line["stage"] == "frames").unwrap();
    assert_eq!((last["done"].as_u64(), last["ended"].as_bool()), (Some(1), Some(true)), "{text}");
    assert!(lines.iter().any(|line| line["message"] == "1 frame(s) ok, 0 degraded, 0 failed"));
}
