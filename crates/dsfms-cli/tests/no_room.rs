//! Output that cannot be written: a disk without room, and a folder that may only be read. The run
//! ends with 1 and its reason; what is under a final name is whole, and older results stay where
//! nothing new could be written.
//!
//! Room is taken away by the largest file that a process may write (`ulimit -f`), for which no
//! right is needed; `scripts/faults.py` fills real disks.
#![cfg(unix)]

mod common;

use common::Case;
use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// Each command and the entry of the case's folder that it writes.
const COMMANDS: [(&str, &str); 3] = [
    (
        "reconstruct organ.template frames --camera camera.json --matches matches.csv --method rigid -o out/r",
        "r",
    ),
    (
        "track organ.ply frames --poses pose.json --camera camera.json --method dsfm --ply -o out/t",
        "t",
    ),
    ("template --mesh organ.ply --albedo albedo.csv -o out/m", "m"),
];

/// Every file below a folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            found.extend(files(&path).into_iter().map(|(below, b)| (format!("{name}/{below}"), b)));
        } else {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

/// Run behind other words: a program that takes a right away, and its arguments.
fn behind(case: &Case, before: &[&str], arguments: &str) -> Output {
    let program = assert_cmd::cargo::cargo_bin("dsfms");
    let mut command = Command::new(before[0]);
    command.current_dir(case.folder.path()).args(&before[1..]).arg(program);
    command.args(arguments.split(' ')).output().unwrap()
}

/// A case with an older result of every command, and a file of the user beside each.
fn with_older() -> Case {
    let case = Case::new();
    case.template();
    let pose =
        r#"[{"image": "organ_003.png", "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [1, -0.5, 75]}]"#;
    fs::write(case.path("pose.json"), pose).unwrap();
    for (arguments, out) in COMMANDS {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let code = case.dsfms(&arguments).output().unwrap().status.code();
        assert!(matches!(code, Some(0 | 2)), "{arguments:?}: {code:?}");
        if out != "m" {
            fs::write(case.path("out").join(out).join("notes.txt"), "the user's").unwrap();
        }
    }
    case
}

/// The command failed for a reason that it tells.
fn told(done: &Output, reason: &str) {
    let text = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{text}");
    assert!(text.contains(reason) && text.contains("out"), "expected {reason:?} in: {text}");
    assert!(!text.contains("panicked") && text.matches("error:").count() >= 1, "{text}");
}

/// What is under a final name is whole: the same bytes as those of an undisturbed run, or text that
/// ends.
fn whole(name: &str, bytes: &[u8], older: &BTreeMap<String, Vec<u8>>) {
    match Path::new(name).extension().unwrap_or_default().to_str() {
        Some("json") => {
            assert!(serde_json::from_slice::<serde_json::Value>(bytes).is_ok(), "{name}")
        }
        Some("csv" | "toml") => assert!(bytes.ends_with(b"\n"), "{name}"),
        Some("html") => assert!(bytes.trim_ascii_end().ends_with(b"</html>"), "{name}"),
        _ => assert!(older.get(name).is_some_and(|b| b == bytes), "{name}"),
    }
}

#[test]
fn a_disk_without_room_leaves_no_half_file() {
    let limit = |blocks: &str| format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
    for (arguments, out) in COMMANDS {
        let case = with_older();
        let folder = case.path("out").join(out);
        let older = files(&folder);
        // Nothing, and one or four KiB, or twice as much by the blocks of some shells.
        for blocks in ["0", "2", "8"] {
            let done = behind(&case, &["sh", "-c", &limit(blocks), "sh"], arguments);
            told(&done, "File too large");
            let left = files(&folder);
            left.iter().for_each(|(name, bytes)| whole(name, bytes, &older));
            assert!(left.keys().all(|name| !name.contains(".partial-")), "{:?}", left.keys());
            if out == "m" || blocks == "0" {
                assert!(left == older, "{out} {blocks}: older results are gone");
            } else {
                assert_eq!(left["notes.txt"], older["notes.txt"]);
            }
        }
        // And with room the same command runs to its end.
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let code = case.dsfms(&arguments).output().unwrap().status.code();
        assert!(matches!(code, Some(0 | 2)), "{code:?}");
        assert_eq!(
            files(&folder).into_keys().collect::<Vec<_>>(),
            older.into_keys().collect::<Vec<_>>()
        );
    }
}

#[test]
fn a_folder_that_may_only_be_read_is_told_and_stays_as_it_is() {
    let case = with_older();
    let older = files(&case.path("out"));
    let places = ["out/r", "out/t", "out"].map(|name| case.path(name));
    let mode = |mode: u32| {
        places.iter().for_each(|p| fs::set_permissions(p, Permissions::from_mode(mode)).unwrap());
    };
    mode(0o555);
    // The superuser writes anywhere, unless that right is taken away.
    let prefixes: [&[&str]; 2] = [&["env"], &["setpriv", "--bounding-set=-dac_override"]];
    let kept_out = |prefix: &&[&str]| {
        let mut touch = Command::new(prefix[0]);
        let done = touch.args(&prefix[1..]).arg("touch").arg(case.path("out/r/x")).output();
        done.is_ok_and(|done| done.status.code() == Some(1))
    };
    let prefix = prefixes.into_iter().find(kept_out);
    if prefix.is_none() {
        eprintln!("!! SKIPPED  no right can be taken away: read-only folders are NOT tested");
    }
    let done: Vec<Output> = (prefix.iter())
        .flat_map(|prefix| COMMANDS.map(|(arguments, _)| behind(&case, prefix, arguments)))
        .collect();
    // The case's folder is to be removed.
    mode(0o755);
    let _ = fs::remove_file(case.path("out/r/x"));
    done.iter().for_each(|done| told(done, "cannot be written"));
    assert!(files(&case.path("out")) == older);
}
