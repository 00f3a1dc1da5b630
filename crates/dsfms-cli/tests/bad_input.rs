//! Bad input: a clear error or a named degradation, never a panic, never a half-written file.

mod common;

use common::{Case, save};
use std::fs;

const NOTHING: i32 = 1;
const DEGRADED: i32 = 2;
const USAGE: i32 = 64;

/// Assert the exit code, and that stderr holds every word and no panic.
fn refused(command: &mut assert_cmd::Command, code: i32, words: &[&str]) {
    let output = command.assert().code(code).get_output().clone();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!text.contains("panicked"), "{text}");
    for word in words {
        assert!(text.contains(word), "expected {word:?} in: {text}");
    }
}

/// A case with a template, and the arguments of a rigid reconstruction of `images`.
fn prepared() -> Case {
    let case = Case::new();
    case.template();
    case
}

fn rigid(case: &Case, images: &[&str]) -> assert_cmd::Command {
    let mut command = case.reconstruct(images);
    command.args(["--camera", "camera.json", "--matches", "matches.csv"]);
    command.args(["--method", "rigid", "-o", "out"]);
    command
}

#[test]
fn wrong_usage_is_64() {
    let case = Case::new();
    refused(&mut case.dsfms(&[]), USAGE, &["Usage"]);
    refused(&mut case.dsfms(&["reconstruct"]), USAGE, &["TEMPLATE"]);
    refused(&mut case.dsfms(&["template", "frames", "--bogus", "-o", "t"]), USAGE, &["--bogus"]);
    refused(&mut case.dsfms(&["template", "frames", "-o", "t"]), USAGE, &["--camera", "hint:"]);
    refused(&mut case.dsfms(&["template", "-o", "t"]), USAGE, &["--mesh"]);
    let both = ["template", "frames", "--mesh", "organ.ply", "--camera", "camera.json", "-o", "t"];
    refused(&mut case.dsfms(&both), USAGE, &["--poses"]);
}

/// A template from a mesh has no view in which the camera could stand.
#[test]
fn a_camera_said_to_be_at_rest_needs_a_view_that_fits() {
    let case = prepared();
    let motion = |name| {
        let mut command = rigid(&case, &["frames"]);
        command.args(["--camera-motion", name]);
        command
    };
    refused(&mut motion("at-rest"), NOTHING, &["organ_003", "0 views", "--camera-motion"]);
    motion("auto").assert().success();
    let asleep = ["'asleep'", "at-rest", "moving"];
    refused(&mut motion("asleep"), USAGE, &asleep);
}

#[test]
fn missing_or_empty_folder() {
    let case = prepared();
    refused(&mut rigid(&case, &["nowhere"]), NOTHING, &["nowhere", "no such file"]);
    fs::create_dir(case.path("empty")).unwrap();
    refused(&mut rigid(&case, &["empty"]), NOTHING, &["empty"]);
    let build = ["template", "empty", "--camera", "camera.json", "-o", "t"];
    refused(&mut case.dsfms(&build), NOTHING, &["empty"]);
    refused(&mut case.dsfms(&["inspect", "nowhere"]), NOTHING, &["nowhere"]);
}

#[test]
fn broken_images_fail_by_name_and_the_others_go_on() {
    let case = prepared();
    let good = fs::read(case.path("frames/organ_003.png")).unwrap();
    fs::write(case.path("frames/cut_004.png"), &good[..good.len() / 2]).unwrap();
    fs::write(case.path("frames/text_005.png"), "this is no image").unwrap();
    fs::write(case.path("frames/zero_006.png"), "").unwrap();
    let words = ["cut_004.png", "text_005.png", "zero_006.png"];
    refused(&mut rigid(&case, &["frames"]), DEGRADED, &words);
    assert!(case.path("out/frame_003.ply").is_file());
    for failed in ["out/frame_004", "out/frame_005", "out/frame_006"] {
        let json = fs::read_to_string(case.path(&format!("{failed}.json"))).unwrap();
        assert!(json.contains("\"failed\""), "{json}");
        assert!(!case.path(&format!("{failed}.ply")).exists());
    }
    let summary = fs::read_to_string(case.path("out/summary.csv")).unwrap();
    assert_eq!(summary.matches(",failed,").count(), 3, "{summary}");
    refused(&mut rigid(&case, &["frames/zero_006.png"]), NOTHING, &["zero_006.png"]);
}

#[test]
fn a_frame_or_camera_of_another_size() {
    let case = prepared();
    save(&case.path("frames/small_007.png"), [80, 60], |_| [120; 3]);
    refused(&mut rigid(&case, &["frames"]), DEGRADED, &["small_007", "80", "160"]);
    let build = ["template", "frames", "--camera", "camera.json", "-o", "t"];
    refused(&mut case.dsfms(&build), NOTHING, &["small_007", "80"]);
    let camera = fs::read_to_string(case.path("camera.json")).unwrap().replace("160", "320");
    fs::write(case.path("camera.json"), camera).unwrap();
    refused(&mut rigid(&case, &["frames/organ_003.png"]), NOTHING, &["320", "160", "organ_003"]);
}

#[test]
fn a_camera_that_is_none() {
    let case = prepared();
    let complete = r#"{"fx": 200, "fy": 200, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120}"#;
    for (bad, word) in [
        (complete.replace("\"fx\": 200", "\"fx\": NaN"), "NaN"),
        (complete.replace("\"fx\": 200, ", ""), "fx"),
        (complete.replace("\"fy\": 200", "\"fy\": -1"), "fy"),
        ("{".into(), "camera.json"),
    ] {
        fs::write(case.path("camera.json"), &bad).unwrap();
        refused(&mut rigid(&case, &["frames"]), NOTHING, &["camera.json", word]);
    }
    fs::write(case.path("camera.json"), complete).unwrap();
    rigid(&case, &["frames"]).assert().success();
}

#[test]
fn matches_that_do_not_fit() {
    let case = prepared();
    let good = fs::read_to_string(case.path("matches.csv")).unwrap();
    let header = good.lines().next().unwrap().to_string();
    let row = "0,0.2,0.3,0.5,80,60";
    for (bad, word) in [
        (format!("{header}\n999999,0.2,0.3,0.5,80,60\n"), "999999"),
        (format!("{header}\n0,0.2,nan,0.5,80,60\n"), "b2"),
        (format!("triangle,u,v,w,x,y\n{row}\n"), "face"),
        (format!("{header}\n"), "matches.csv"),
        (format!("{header}\n{row}\n{row}\n"), "at least"),
    ] {
        fs::write(case.path("matches.csv"), &bad).unwrap();
        refused(&mut rigid(&case, &["frames"]), NOTHING, &[word]);
    }
    fs::remove_file(case.path("matches.csv")).unwrap();
    refused(&mut rigid(&case, &["frames"]), NOTHING, &["--matches", "matches.csv"]);
}

#[test]
fn meshes_that_are_no_surface() {
    let case = Case::new();
    let vertices = "v 0 0 0\nv 10 0 0\nv 0 10 0\nv 0 0 10\nv 10 10 10\n";
    for (faces, word) in [
        ("f 1 2 3\nf 2 1 4\nf 1 2 5\n", "manifold"),
        ("f 1 2 3\nf 2 3 1\n", "same three corners"),
        ("f 1 2 3\nf 2 2 4\n", "twice"),
        ("f 1 2 9\n", "vertex 8"),
        ("", "face"),
    ] {
        fs::write(case.path("bad.obj"), format!("{vertices}{faces}")).unwrap();
        let build = ["template", "--mesh", "bad.obj", "-o", "t"];
        refused(&mut case.dsfms(&build), NOTHING, &["bad.obj", word]);
    }
    assert!(!case.path("t").exists());
}

#[test]
fn an_albedo_of_another_mesh() {
    let case = Case::new();
    let build = ["template", "--mesh", "organ.ply", "--albedo", "albedo.csv", "-o", "t"];
    fs::write(case.path("albedo.csv"), "0.5\n0.4\n").unwrap();
    refused(&mut case.dsfms(&build), NOTHING, &["albedo.csv", "2 albedo values"]);
    fs::write(case.path("albedo.csv"), "0.5\nred\n").unwrap();
    refused(&mut case.dsfms(&build), NOTHING, &["albedo.csv", "red"]);
}

#[test]
fn a_black_frame_and_one_without_the_organ() {
    let case = prepared();
    save(&case.path("black_000.png"), [160, 120], |_| [0; 3]);
    refused(&mut rigid(&case, &["black_000.png"]), NOTHING, &["black"]);
    // Matches that no pose of the organ explains: the frame shows something else.
    let scattered: String = (0..20)
        .map(|i| format!("{},0.3,0.3,0.4,{},{}\n", (i * 17) % 300, (i * 67) % 160, (i * 41) % 120))
        .collect();
    fs::write(case.path("matches.csv"), format!("face,b1,b2,b3,x,y\n{scattered}")).unwrap();
    let mut command = rigid(&case, &["frames/organ_003.png"]);
    let code = command.assert().get_output().status.code();
    let json = fs::read_to_string(case.path("out/frame_003.json")).unwrap();
    assert!(matches!(code, Some(NOTHING | DEGRADED)), "{json}");
    assert!(!json.contains("\"status\": \"ok\""), "{json}");
}

#[test]
fn an_output_folder_that_cannot_be_written() {
    let case = prepared();
    fs::write(case.path("out"), "a file where the folder should be").unwrap();
    refused(&mut rigid(&case, &["frames"]), NOTHING, &["out", "cannot be written"]);
    let build = ["template", "--mesh", "organ.ply", "-o", "out/t"];
    refused(&mut case.dsfms(&build), NOTHING, &["out"]);
}

#[test]
fn a_template_that_is_none() {
    let case = prepared();
    fs::write(case.path("organ.template/template.toml"), "unit = 3").unwrap();
    refused(&mut rigid(&case, &["frames"]), NOTHING, &["template.toml"]);
    // A folder of something else is never replaced.
    let build = ["template", "--mesh", "organ.ply", "-o", "frames"];
    refused(&mut case.dsfms(&build), NOTHING, &["frames"]);
    assert!(case.path("frames/organ_003.png").is_file());
}

#[test]
fn a_mask_that_looks_inverted_draws_a_warning() {
    let case = prepared();
    fs::create_dir(case.path("organ_masks")).unwrap();
    save(&case.path("organ_masks/organ_003.png"), [160, 120], |_| [255; 3]);
    let output = rigid(&case, &["frames"]).args(["--organ-masks", "organ_masks"]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("inverted"), "{text}");
}

#[test]
fn no_temporary_files_stay_and_an_interrupted_run_leaves_none_under_a_final_name() {
    let case = prepared();
    rigid(&case, &["frames"]).assert().success();
    let names: Vec<String> = fs::read_dir(case.path("out"))
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    assert!(names.iter().all(|n| !n.starts_with('.')), "{names:?}");
    interrupted(&case);
}

/// Kill runs at growing delays: whatever stands under a final name is whole.
fn interrupted(case: &Case) {
    let binary = assert_cmd::cargo::cargo_bin("dsfms");
    for delay_ms in [5, 20, 40, 80, 160] {
        let _ = fs::remove_dir_all(case.path("cut"));
        let mut child = std::process::Command::new(&binary)
            .current_dir(case.folder.path())
            .args(["reconstruct", "organ.template", "frames", "--camera", "camera.json"])
            .args(["--matches", "matches.csv", "--method", "rigid", "-o", "cut", "--quiet"])
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(delay_ms));
        let _ = child.kill();
        child.wait().unwrap();
        if case.path("cut/frame_003.ply").is_file() {
            dsfms::io::mesh::read_mesh(&case.path("cut/frame_003.ply")).unwrap();
        }
        if let Ok(text) = fs::read_to_string(case.path("cut/frame_003.json")) {
            serde_json::from_str::<serde_json::Value>(&text).unwrap();
        }
    }
}
