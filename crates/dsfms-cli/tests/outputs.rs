//! Output folders: nothing of an older run stays, nothing of the user's goes, nothing lies in the
//! input; and input that is no file is refused at once.

mod common;

use common::Case;
use common::refusal::refused as left_alone;
use std::fs;
use std::time::Duration;

const NOTHING: i32 = 1;
const USAGE: i32 = 64;

fn rigid(case: &Case, images: &str, out: &str) -> assert_cmd::Command {
    let mut command = case.reconstruct(&[images, "--camera", "camera.json"]);
    command.args(["--matches", "matches.csv", "--method", "rigid", "-o", out]);
    // A command that waits for ever must not.
    command.timeout(Duration::from_secs(60));
    command
}

fn refused(command: &mut assert_cmd::Command, code: i32, words: &[&str]) {
    let output = command.assert().code(code).get_output().clone();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!text.contains("panicked"), "{text}");
    for word in words {
        assert!(text.contains(word), "expected {word:?} in: {text}");
    }
}

#[test]
fn a_frame_that_fails_leaves_no_surface_of_an_older_run() {
    let case = Case::new();
    case.template();
    rigid(&case, "frames", "out").assert().success();
    assert!(case.path("out/frame_003.ply").is_file());
    fs::write(case.path("out/notes.txt"), "the user's").unwrap();
    fs::write(case.path("out/.partial-4294967294-abc"), "of a killed run").unwrap();
    let scattered: String = (0..20)
        .map(|i| format!("{},0.3,0.3,0.4,{},{}\n", (i * 17) % 300, (i * 67) % 160, (i * 41) % 120))
        .collect();
    fs::write(case.path("matches.csv"), format!("face,b1,b2,b3,x,y\n{scattered}")).unwrap();
    // Its head says that it is a picture.
    let whole = fs::read(case.path("frames/organ_003.png")).unwrap();
    fs::write(case.path("frames/organ_003.png"), &whole[..whole.len() / 2]).unwrap();
    refused(&mut rigid(&case, "frames", "out"), NOTHING, &["organ_003"]);
    assert!(!case.path("out/frame_003.ply").exists());
    assert!(!case.path("out/frame_003_overlay.png").exists());
    assert!(case.path("out/notes.txt").exists());
    assert!(!case.path("out/.partial-4294967294-abc").exists());
    let json = fs::read_to_string(case.path("out/frame_003.json")).unwrap();
    assert!(json.contains("failed"), "{json}");
}

#[test]
fn what_a_killed_run_left_goes_beside_single_files_too() {
    let case = Case::new();
    case.template();
    // Cases are added to a series alone.
    let synth = ["synth", "--vertices", "100", "--ext", "10", "--count", "1", "-o", "cases"];
    case.dsfms(&synth).assert().success();
    let commands: [(&str, &[&str]); 4] = [
        ("told", &["evaluate", "truth", "truth", "--json", "told/errors.json"]),
        ("drawn", &["figure", "truth", "-o", "drawn/plate.svg"]),
        ("meshes", &["export", "organ.template", "--mesh", "meshes/a.ply"]),
        ("cases/ext10/case_0000/truth", &synth),
    ];
    for (folder, arguments) in commands {
        let partial = case.path(folder).join(".partial-4294967294-abc");
        fs::create_dir_all(case.path(folder)).unwrap();
        fs::write(&partial, "of a killed run").unwrap();
        fs::write(case.path(folder).join("notes.txt"), "the user's").unwrap();
        case.dsfms(arguments).assert().success();
        assert!(!partial.exists(), "{arguments:?}");
        assert!(case.path(folder).join("notes.txt").exists());
    }
}

#[test]
fn results_do_not_go_into_the_input_nor_over_files_of_others() {
    let case = Case::new();
    case.template();
    for out in ["frames", "frames/out", "./frames/../frames/deep/out", "organ.template/out"] {
        refused(&mut rigid(&case, "frames", out), USAGE, &["lies in the input"]);
    }
    refused(&mut rigid(&case, "frames/organ_003.png", "frames"), USAGE, &["lies in the input"]);
    assert_eq!(fs::read_dir(case.path("frames")).unwrap().count(), 1);
    refused(&mut rigid(&case, "frames", "truth"), NOTHING, &["frame_003.ply", "-o"]);
    assert!(case.path("truth/frame_003.ply").is_file());
}

/// Commands and what they would replace in a folder that is none of theirs, with the word of the
/// refusal.
const REPLACING: [(&str, &str, &str); 12] = [
    ("demo -o out", "scene/camera.json", "scene"),
    ("demo -o out", "joint/summary.csv", "joint"),
    ("demo -o out", "report.html", "report.html"),
    ("synth --count 1 --ext 10 -o out", "ext10/case_0000/camera.json", "ext10"),
    ("synth --video --frames 2 -o out", "frames/frame_000.png", "frames"),
    ("synth --chessboard 7x5 -o out", "board_000.png", "board_000.png"),
    ("experiment ext --count 1 --restart -o out", "cases.csv", "cases.csv"),
    ("experiment ablation --count 1 -o out", "zone_noise2.pdf", "zone_noise2.pdf"),
    ("experiment table1 -o out", "table1_pull.png", "table1_pull.png"),
    ("export organ.template --pictures out", "albedo.png", "--pictures"),
    ("export organ.template --colmap out", "images.txt", "--colmap"),
    ("calibrate frames --board 7x5 --square 3 -o camera.json", "x.txt", "camera.json is there"),
];

#[test]
fn what_no_run_of_ours_left_is_never_replaced() {
    for (command, file, word) in REPLACING {
        let case = Case::new();
        case.template();
        let file = case.path("out").join(file);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, "the user's").unwrap();
        let arguments: Vec<&str> = command.split(' ').collect();
        left_alone(&case, &arguments, NOTHING, &[word]);
    }
}

#[test]
fn an_export_renews_its_pictures_and_a_calibration_its_folder_alone() {
    let case = Case::new();
    case.template();
    let export = ["export", "organ.template", "--pictures", "out"];
    case.dsfms(&export).assert().success();
    fs::write(case.path("out/notes.txt"), "the user's").unwrap();
    fs::write(case.path("out/albedo_spread.png"), "of another template").unwrap();
    case.dsfms(&export).assert().success();
    assert!(case.path("out/notes.txt").exists() && case.path("out/flattening.png").exists());
    let stale = fs::read(case.path("out/albedo_spread.png"));
    assert!(stale.is_err() || stale.unwrap().starts_with(b"\x89PNG"));
    // A folder of one command is none of another's.
    let into = ["--matches", "matches.csv", "--method", "rigid", "-o", "out"];
    let arguments =
        [&["reconstruct", "organ.template", "frames", "--camera", "camera.json"][..], &into]
            .concat();
    left_alone(&case, &arguments, NOTHING, &["`dsfms export`", "-o"]);
    fs::create_dir(case.path("new.calibration")).unwrap();
    fs::write(case.path("new.calibration/report.json"), "{}").unwrap();
    let calibrate = ["calibrate", "frames", "--board", "7x5", "--square", "3", "-o", "new.json"];
    left_alone(&case, &calibrate, NOTHING, &["report.json", "dsfms.json"]);
}

#[test]
fn a_template_folder_is_looked_at_before_the_work() {
    let case = Case::new();
    case.template();
    // The mesh does not exist: the complaint about the folder comes first.
    let build = |out: &str| case.dsfms(&["template", "--mesh", "nowhere.ply", "-o", out]);
    refused(&mut build("frames"), NOTHING, &["frames", "not a template"]);
    fs::write(case.path("organ.template/notes.txt"), "the user's").unwrap();
    refused(&mut build("organ.template"), NOTHING, &["notes.txt", "would be lost"]);
    assert!(case.path("organ.template/notes.txt").exists());
    fs::remove_file(case.path("organ.template/notes.txt")).unwrap();
    refused(&mut build("organ.template"), NOTHING, &["nowhere.ply"]);
    case.template();
}

#[test]
fn numbers_and_names_that_are_wrong_are_refused_at_once() {
    let case = Case::new();
    case.template();
    let mut threads = rigid(&case, "frames", "out");
    threads.args(["--threads", "65535"]);
    refused(&mut threads, USAGE, &["65535"]);
    let camera = fs::read_to_string(case.path("camera.json")).unwrap();
    let misspelt = camera.replacen('{', "{\"distorsion\": {\"k1\": -0.3},", 1);
    fs::write(case.path("camera.json"), misspelt).unwrap();
    refused(&mut rigid(&case, "frames", "out"), NOTHING, &["distorsion", "distortion"]);
    let mut raw =
        case.dsfms(&["track", "organ.template", "-", "--size", "65535x65535", "-o", "out"]);
    refused(raw.timeout(Duration::from_secs(60)), USAGE, &["64 million"]);
}

#[test]
fn text_that_is_far_too_long_is_refused_before_it_is_parsed() {
    let case = Case::new();
    case.template();
    fs::write(case.path("long.toml"), "# \n".repeat(600_000)).unwrap();
    let mut options = rigid(&case, "frames", "out");
    options.args(["--options", "long.toml"]);
    refused(&mut options, NOTHING, &["long.toml", "1 MiB"]);
    fs::write(case.path("long.json"), format!("[{}0]", "0,".repeat(17 << 20))).unwrap();
    let mut camera = case.reconstruct(&["frames", "--camera", "long.json", "-o", "out"]);
    refused(&mut camera, NOTHING, &["long.json", "MiB"]);
}

#[cfg(unix)]
#[test]
fn written_files_can_be_read_by_others() {
    use std::os::unix::fs::PermissionsExt;
    let case = Case::new();
    let out = case.path("cases");
    let words = ["synth", "--ext", "10", "--count", "1", "--vertices", "100", "-o"];
    case.dsfms(&[&words[..], &[out.to_str().unwrap()]].concat()).assert().success();
    let folder = out.join("ext10/case_0000");
    for name in ["camera.json", "matches.csv", "rest.obj"] {
        let mode = fs::metadata(folder.join(name)).unwrap().permissions().mode();
        assert_eq!(mode & 0o444, 0o444, "{name}: {mode:o}");
    }
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_no_input() {
    let case = Case::new();
    case.template();
    refused(&mut rigid(&case, "/dev/zero", "out"), NOTHING, &["not a regular file"]);
    let pipe = case.path("pipe.png");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if !made.is_ok_and(|status| status.success()) {
        return;
    }
    refused(&mut rigid(&case, "pipe.png", "out"), NOTHING, &["pipe.png", "not a regular file"]);
    std::os::unix::fs::symlink("pipe.png", case.path("pipe.json")).unwrap();
    let mut camera = case.reconstruct(&["frames", "--camera", "pipe.json", "-o", "out"]);
    refused(camera.timeout(Duration::from_secs(60)), NOTHING, &["not a regular file"]);
    let mut options = rigid(&case, "frames", "out");
    options.args(["--options", "pipe.json"]).timeout(Duration::from_secs(60));
    refused(&mut options, NOTHING, &["not a regular file"]);
    fs::create_dir_all(case.path("series")).unwrap();
    fs::write(case.path("series/dsfms.json"), r#"{"command": "experiment"}"#).unwrap();
    let series = ["experiment", "ext", "--ext", "0", "--count", "1", "-o", "series"];
    let mut options = case.dsfms(&[&series[..], &["--options", "pipe.json"]].concat());
    refused(options.timeout(Duration::from_secs(60)), NOTHING, &["not a regular file"]);
    std::os::unix::fs::symlink("../pipe.png", case.path("series/cases.csv")).unwrap();
    let mut results = case.dsfms(&series);
    refused(results.timeout(Duration::from_secs(60)), NOTHING, &["not a regular file"]);
}
