//! `-v` and `RUST_LOG`: what is decided is logged on standard error, and only where it is asked
//! for.

mod common;

use common::Case;

fn told(case: &Case, more: &[&str], variable: &str) -> (Option<i32>, String) {
    let arguments = ["frames", "--camera", "camera.json", "--matches", "matches.csv"];
    let mut command =
        case.reconstruct(&[&arguments[..], &["--method", "dsfm", "-o", "out"]].concat());
    let done = command.args(more).env("RUST_LOG", variable).output().unwrap();
    (done.status.code(), String::from_utf8_lossy(&done.stderr).into_owned())
}

#[test]
fn it_says_what_was_decided_only_where_it_is_asked() {
    let case = Case::new();
    case.template();
    let (_, quiet) = told(&case, &[], "");
    assert!(!quiet.contains("INFO") && !quiet.contains("DEBUG"), "{quiet}");
    let (_, info) = told(&case, &["-v"], "");
    let surface = info.lines().find(|line| line.contains(" surface frame=")).unwrap();
    assert!(surface.contains("INFO dsfms::pipeline"), "{info}");
    for figure in ["frame=organ_003", "matches=", "kept=", "verdict=", "seconds="] {
        assert!(surface.contains(figure), "{figure}: {surface}");
    }
    assert!(!info.contains("DEBUG"), "{info}");
    let (_, debug) = told(&case, &["-vv"], "");
    assert!(debug.contains("DEBUG") && debug.contains("stage=register (eq. 3)"), "{debug}");
    let (_, chosen) = told(&case, &[], "dsfms::pipeline=debug");
    assert!(chosen.contains("DEBUG dsfms::pipeline"), "{chosen}");
    let (code, wrong) = told(&case, &[], "dsfms=loud");
    assert_eq!(code, Some(64), "{wrong}");
    assert!(wrong.contains("RUST_LOG=dsfms=loud") && wrong.contains("debug"), "{wrong}");
    // Every line is for a program.
    let (_, json) = told(&case, &["-v", "--progress", "json"], "");
    let lines: Vec<serde_json::Value> = json
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("{line}")))
        .collect();
    assert!(lines.iter().any(|line| line["fields"]["message"] == "surface"), "{json}");
}
