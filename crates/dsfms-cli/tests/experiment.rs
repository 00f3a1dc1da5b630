//! synth and experiment through the binary: tiny runs, going on after a kill, wrong arguments.

use assert_cmd::Command;
use std::fs;
use std::path::Path;

fn dsfms(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::cargo_bin("dsfms").unwrap();
    command.current_dir(folder).args(arguments.split(' '));
    command
}

/// Error over all vertices of the frame of a synthetic case, through template, reconstruct and
/// evaluate.
fn rms_mm(case: &Path, template: &str, method: &str) -> f64 {
    let template = format!("template --mesh rest.obj {template} -q -o organ.template");
    dsfms(case, &template).assert().success();
    let reconstruct = format!(
        "reconstruct organ.template frame_000.png --camera camera.json --matches matches.csv \
         --method {method} -q -o out"
    );
    dsfms(case, &reconstruct).assert().success();
    dsfms(case, "evaluate out truth --camera camera.json --json errors.json").assert().success();
    let errors = fs::read_to_string(case.join("errors.json")).unwrap();
    let errors: serde_json::Value = serde_json::from_str(&errors).unwrap();
    errors["frame_000.ply"]["vertices"]["all"]["rms"].as_f64().unwrap()
}

#[test]
fn a_synthetic_case_goes_through_the_other_commands() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let synth = "synth --organ uterus --vertices 100 --ext 10 --count 1 --seed 3 -q -o cases";
    dsfms(at, synth).assert().success();
    let case = at.join("cases/ext10/case_0000");
    let known = fs::read_to_string(case.join("case.json")).unwrap();
    let known: serde_json::Value = serde_json::from_str(&known).unwrap();
    let largest = known["largest_extension_percent"].as_f64().unwrap();
    assert!((largest - 10.0).abs() < 1e-3, "{known}");
    let all = rms_mm(&case, "--albedo albedo.png", "dsfm");
    assert!(all < 2.0, "{all} mm");
}

/// A ring light: rendered, written to the camera file, read from it, in the shading of the joint
/// solve.
#[test]
fn a_ring_light_goes_from_synth_to_reconstruct() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let synth =
        "synth --organ uterus --light ring --vertices 100 --ext 10 --count 1 --seed 3 -q -o cases";
    dsfms(at, synth).assert().success();
    let case = at.join("cases/ext10/case_0000");
    let camera = fs::read_to_string(case.join("camera.json")).unwrap();
    let camera: serde_json::Value = serde_json::from_str(&camera).unwrap();
    assert_eq!(
        (&camera["light"]["kind"], &camera["light"]["radius"]),
        (&"ring".into(), &4.0.into())
    );
    let all = rms_mm(&case, "--albedo albedo.png", "joint");
    assert!(all < 2.0, "{all} mm");
}

#[test]
fn an_experiment_goes_on_after_a_kill_and_keeps_its_tables() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let run = "experiment ext --vertices 100 --ext 0,10 --count 2 --methods rigid,dsfm -q -o out";
    dsfms(at, run).assert().success();
    let read = |name: &str| fs::read_to_string(at.join("out").join(name)).unwrap();
    let whole = (read("table.md"), read("table.csv"), read("zone.svg"));
    assert!(whole.0.contains("| 10 % |") && whole.1.lines().count() == 5, "{}", whole.1);
    assert!(whole.2.contains(">dsfm</text>"));
    // A kill leaves fewer cases and a last line that is cut short.
    let cases = read("cases.csv");
    let kept = cases.lines().take(5).map(str::len).sum::<usize>() + 5 + 20;
    fs::write(at.join("out/cases.csv"), &cases[..kept]).unwrap();
    let again = format!("--threads 1 {run}");
    dsfms(at, &again).assert().success();
    assert_eq!((read("table.md"), read("table.csv"), read("zone.svg")), whole);

    let other = run.replace("--count 2", "--count 3");
    let refused = dsfms(at, &other).assert().failure();
    let message = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(message.contains("another count") && message.contains("--restart"), "{message}");
    // Nothing of the older run stays, and all of the user's.
    for name in ["zone_noise2.svg", "ablation.md"] {
        fs::write(at.join("out").join(name), "of an older run").unwrap();
    }
    fs::write(at.join("out/zone_of_mine.svg"), "the user's").unwrap();
    dsfms(at, &format!("{other} --restart")).assert().success();
    let there = |name: &str| at.join("out").join(name).exists();
    assert!(!there("zone_noise2.svg") && !there("ablation.md") && there("zone.svg"));
    assert!(there("zone_of_mine.svg"));
}

#[test]
fn wrong_arguments_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, code, words) in [
        ("experiment ext --methods rigid,rigid -o out", 64, "twice"),
        ("experiment ext --methods rigid,magic -o out", 64, "magic"),
        ("experiment ext --ext 5,80 -o out", 64, "0 to 40"),
        ("experiment ext --count 0 -o out", 64, "1 to 100000"),
        ("experiment ext --matches 100 -o out", 64, "25"),
        ("experiment ext --organ kidney -o out", 64, "uterus"),
        ("synth --ext x -o out", 64, "percentage"),
        ("experiment ablation", 64, "--output"),
    ] {
        let done = dsfms(folder.path(), arguments).assert().code(code);
        let message = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
        assert!(message.contains(words), "{arguments}: {message}");
    }
}
