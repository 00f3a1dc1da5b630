//! Whoever reads standard output or standard error may go away: no panic, and no run ends for it.
#![cfg(unix)]

mod common;

use common::Case;
use std::process::{Command, Stdio};

/// The binary in the folder of a case, its standard output and standard error pipes without a
/// reader.
fn unread(case: &Case, arguments: &[&str]) -> Option<i32> {
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("dsfms"))
        .current_dir(case.folder.path())
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop((child.stdout.take(), child.stderr.take()));
    child.wait().unwrap().code()
}

#[test]
fn a_run_goes_on_where_nobody_reads_its_progress() {
    let case = Case::new();
    case.template();
    let run = |out| {
        let arguments = ["reconstruct", "organ.template", "frames", "--camera", "camera.json"];
        let more =
            ["--matches", "matches.csv", "--method", "rigid", "--progress", "lines", "-o", out];
        unread(&case, &[&arguments[..], &more].concat())
    };
    assert_eq!(run("out"), Some(0));
    for name in ["frame_003.ply", "frame_003.json", "summary.csv", "report.html"] {
        assert!(case.path("out").join(name).is_file(), "{name}");
    }
    // Errors keep their code, told or not.
    assert_eq!(unread(&case, &["reconstruct", "nowhere", "frames", "-o", "out2"]), Some(1));
    assert_eq!(unread(&case, &["reconstruct"]), Some(64));
}

#[test]
fn texts_without_a_reader_are_no_panic() {
    let case = Case::new();
    case.template();
    for arguments in [
        &["--help"][..],
        &["options", "reconstruct"],
        &["inspect", "organ.template"],
        &["completions", "bash"],
        &["evaluate", "truth", "truth"],
    ] {
        let code = unread(&case, arguments);
        assert!(matches!(code, Some(0..=2)), "{arguments:?}: {code:?}");
    }
}
