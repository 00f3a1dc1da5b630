//! `dsfms calibrate` through the binary, on the chessboards of `dsfms synth`.

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use dsfms::geometry::Vector3;
use dsfms::io::camera::read_camera;
use serde_json::Value;
use std::fs;
use std::path::Path;

fn dsfms(folder: &Path, arguments: &str) -> Assert {
    let mut command = Command::cargo_bin("dsfms").unwrap();
    command.current_dir(folder).args(arguments.split(' ')).assert()
}

fn said(done: &Assert) -> String {
    String::from_utf8_lossy(&done.get_output().stderr).into_owned()
}

/// Where a pose has the middle of the board, mm: a board may be read from either end.
fn middle(pose: &Value) -> Vector3 {
    let board = Vector3::new(12.0, 8.0, 0.0);
    let number = |value: &Value| value.as_f64().unwrap();
    let row = |k: usize| Vector3::from_fn(|i, _| number(&pose["R"][k][i])).dot(&board);
    Vector3::from_fn(|k, _| row(k) + number(&pose["t"][k]))
}

#[test]
fn the_camera_of_a_synthetic_chessboard_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let (at, path) = (folder.path(), |name: &str| folder.path().join(name));
    let synth = "synth --chessboard 7x5 --square 4mm --frames 12 --size 480x360 --seed 4 -o board";
    let told = dsfms(at, synth).success();
    let told = String::from_utf8_lossy(&told.get_output().stdout).into_owned();
    // Of an earlier run and of the user.
    fs::create_dir_all(path("camera.calibration/corners")).unwrap();
    let older = r#"{"images": [{"image": "old_1"}, {"image": "board_001"}]}"#;
    fs::write(path("camera.calibration/report.json"), older).unwrap();
    fs::write(path("camera.calibration/dsfms.json"), r#"{"command": "calibrate"}"#).unwrap();
    for name in ["old_1", "mine"] {
        fs::write(path(&format!("camera.calibration/corners/{name}.png")), "x").unwrap();
    }
    dsfms(at, "calibrate board --board 7x5 --square 4mm -o camera.json --quiet").success();
    let corners = |name: &str| path(&format!("camera.calibration/corners/{name}.png")).exists();
    assert!(!corners("old_1") && corners("mine") && corners("board_001"));
    let found = read_camera(&path("camera.json")).unwrap().camera;
    let truth = read_camera(&path("board/truth/camera.json")).unwrap().camera;
    assert!(told.contains(&format!("fx  {:>12.2}", truth.focal[0])), "{told}");
    for c in 0..2 {
        let focal = found.focal[c] / truth.focal[c] - 1.0;
        let centre = found.centre[c] - truth.centre[c];
        // 0.0003 and 0.26 px are measured; k1 is off by 0.0009.
        assert!(focal.abs() < 0.001, "focal {} of {}", found.focal[c], truth.focal[c]);
        assert!(centre.abs() < 1.0, "centre {} of {}", found.centre[c], truth.centre[c]);
    }
    let (found, truth) = (found.lens.coefficients(), truth.lens.coefficients());
    assert!((found[0].1 - truth[0].1).abs() < 0.004, "{found:?}, true {truth:?}");
    let report = fs::read_to_string(path("camera.calibration/report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    let poses = fs::read_to_string(path("board/truth/poses.json")).unwrap();
    let poses: Value = serde_json::from_str(&poses).unwrap();
    assert_eq!(poses.as_array().unwrap().len(), 12);
    for (found, truth) in report["images"].as_array().unwrap().iter().zip(poses.as_array().unwrap())
    {
        assert_eq!(found["image"], truth["image"]);
        let [found, truth] = [middle(&found["camera_from_board"]), middle(truth)];
        assert!((found - truth).norm() < 0.1, "{found} mm, true {truth} mm");
    }
    assert!(report["rms_px"].as_f64().unwrap() < 0.1, "{}", report["rms_px"]);
    assert!(path("camera.calibration/residuals.png").is_file());
    let wrong = said(&dsfms(at, "calibrate board --board 12x12 --square 4mm -o o.json").failure());
    assert!(wrong.contains("12") && wrong.contains("board"), "{wrong}");

    // The folder goes on where it was with the same words, and belongs to no others.
    let picture = fs::read(path("board/board_003.png")).unwrap();
    fs::remove_file(path("board/board_003.png")).unwrap();
    dsfms(at, synth).success();
    assert!(fs::read(path("board/board_003.png")).unwrap() == picture);
    let other = dsfms(at, &synth.replace("--seed 4", "--seed 5")).code(64);
    assert!(said(&other).contains("holds other pictures (see board.json"), "{}", said(&other));
}

#[test]
fn a_chessboard_that_is_none_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, words) in [
        ("--chessboard 14", "10x7"),
        ("--chessboard 2x9", "at least 3x3"),
        ("--chessboard 40x30 --size 320x180", "px wide"),
        ("--chessboard 14x10 --square 0mm", "positive length"),
        ("--chessboard 14x10 --ext 10", "--ext"),
        ("--chessboard 14x10 --video", "--video"),
        ("--chessboard 14x10 --frame-format jpeg", "--frame-format"),
        ("--square 3mm", "--chessboard"),
        ("--frames 3", "--chessboard"),
    ] {
        let done = dsfms(folder.path(), &format!("synth {arguments} -o board")).code(64);
        assert!(said(&done).contains(words), "{arguments}: {}", said(&done));
        assert!(!folder.path().join("board").exists(), "{arguments} leaves a folder");
    }
}
