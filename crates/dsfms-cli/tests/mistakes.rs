//! The mistakes of an outside reader, one by one: each is refused with the file, the field, what was expected and
//! what was found, and leaves nothing behind. Those of `litter.rs` and `bad_input.rs` are not repeated.

mod common;

use common::refusal::{NOTHING, USAGE, faults};
use common::{Case, save};
use std::fs;

/// A mistake: the command line, its exit code, what the message must say.
type Mistake = (&'static str, i32, &'static [&'static str]);

/// All of them, so that one that fails does not hide the others.
fn all_refused(case: &Case, mistakes: &[Mistake]) {
    let mut wrong = Vec::new();
    for (line, code, words) in mistakes {
        let arguments: Vec<&str> = line.split(' ').collect();
        let faults = faults(case, &arguments, *code, words);
        wrong.extend((!faults.is_empty()).then(|| format!("{line}\n  {}", faults.join("\n  "))));
    }
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
}

fn prepared() -> Case {
    let case = Case::new();
    case.template();
    let write = |name: &str, text: &str| fs::write(case.path(name), text).unwrap();
    write("notes.txt", "no video, no frame, no camera");
    write(
        "poses.json",
        r#"[{"image": "organ_003.png", "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0, 0, 75]}]"#,
    );
    write(
        "other.json",
        r#"[{"image": "nowhere.png", "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0, 0, 75]}]"#,
    );
    write(
        "skewed.json",
        r#"[{"image": "organ_003.png", "R": [[1,0,0],[0,2,0],[0,0,1]], "t": [0, 0, 75]}]"#,
    );
    fs::create_dir(case.path("empty")).unwrap();
    fs::create_dir(case.path("masks")).unwrap();
    save(&case.path("masks/organ_009.png"), [160, 120], |i| [if i % 2 == 0 { 255 } else { 0 }; 3]);
    fs::create_dir(case.path("small_masks")).unwrap();
    save(&case.path("small_masks/organ_003.png"), [80, 60], |i| [if i < 900 { 255 } else { 0 }; 3]);
    save(&case.path("albedo.png"), [64, 64], |_| [120; 3]);
    write("tumour.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    write("truth.ply", "ply\nformat ascii 1.0\nelement vertex 3\n");
    case
}

#[test]
fn templates() {
    let case = prepared();
    let mistakes: &[Mistake] = &[
        ("template frames/organ_003.png --camera camera.json -o t", NOTHING, &["1", "at least"]),
        ("template frames truth --camera camera.json -o t", NOTHING, &["truth"]),
        ("template notes.txt --camera camera.json -o t", NOTHING, &["notes.txt"]),
        ("template frames --camera notes.txt -o t", NOTHING, &["notes.txt"]),
        ("template --mesh organ.ply --albedo notes.txt -o t", NOTHING, &["notes.txt"]),
        ("template --mesh notes.txt -o t", NOTHING, &["notes.txt", ".ply", ".obj", ".stl"]),
        ("template --mesh tumour.obj -o t", NOTHING, &["tumour.obj", "face"]),
        ("template --mesh truth.ply -o t", NOTHING, &["truth.ply"]),
        ("template --mesh organ.ply --mesh-unit inch -o t", USAGE, &["inch", "mm"]),
        (
            "template frames --camera camera.json --mesh organ.ply --poses other.json -o t",
            NOTHING,
            &["other.json", "organ_003"],
        ),
        (
            "template frames --camera camera.json --mesh organ.ply --poses skewed.json -o t",
            NOTHING,
            &["skewed.json", "rotation"],
        ),
        ("template frames --camera camera.json --vertices many -o t", USAGE, &["many"]),
        ("template frames --camera camera.json --camera-step a b -o t", USAGE, &["--camera-step"]),
        (
            "template frames --camera camera.json --organ-click here -o t",
            USAGE,
            &["here", "--organ-click"],
        ),
    ];
    all_refused(&case, mistakes);
}

#[test]
fn reconstructions() {
    let case = prepared();
    let mistakes: &[Mistake] = &[
        (
            "reconstruct organ.template frames --camera poses.json -o o",
            NOTHING,
            &["poses.json", "--poses"],
        ),
        ("reconstruct organ.template empty --camera camera.json -o o", NOTHING, &["empty", "PNG"]),
        (
            "reconstruct organ.ply frames --camera camera.json -o o",
            NOTHING,
            &["organ.ply", "template"],
        ),
        ("reconstruct gone frames --camera camera.json -o o", NOTHING, &["gone"]),
        ("reconstruct organ.template frames -o o", NOTHING, &["--camera"]),
        (
            "reconstruct organ.template frames --camera camera.json --instrument-masks masks -o o",
            NOTHING,
            &["masks", "organ_003"],
        ),
        (
            "reconstruct organ.template frames --camera camera.json --organ-masks small_masks -o o",
            NOTHING,
            &["small_masks", "80x60", "160x120"],
        ),
        (
            "reconstruct organ.template frames --camera camera.json --matches empty -o o",
            NOTHING,
            &["empty"],
        ),
        (
            "reconstruct organ.template frames --camera camera.json --structures notes.txt -o o",
            NOTHING,
            &["notes.txt"],
        ),
        (
            "reconstruct organ.template frames --camera camera.json --tone film -o o",
            USAGE,
            &["film", "srgb"],
        ),
        (
            "reconstruct organ.template frames --camera camera.json --threads 0 -o o",
            USAGE,
            &["--threads"],
        ),
        ("reconstruct organ.template frames --camera camera.json", USAGE, &["--output"]),
    ];
    all_refused(&case, mistakes);
}

#[test]
fn other_commands() {
    let case = prepared();
    let mistakes: &[Mistake] = &[
        ("calibrate frames --board 7x5 -o c.json", USAGE, &["--square"]),
        ("calibrate empty --board 7x5 --square 3mm -o c.json", NOTHING, &["empty"]),
        ("calibrate notes.txt --board 7x5 --square 3mm -o c.json", NOTHING, &["notes.txt"]),
        ("evaluate gone truth", NOTHING, &["gone"]),
        ("evaluate empty truth", NOTHING, &["empty"]),
        ("evaluate organ.ply notes.txt", NOTHING, &["notes.txt", ".ply"]),
        ("evaluate truth truth --align magic", USAGE, &["magic", "similarity"]),
        ("inspect notes.txt", NOTHING, &["notes.txt"]),
        ("inspect gone", NOTHING, &["gone"]),
        ("export gone --mesh a.ply", NOTHING, &["gone"]),
        ("export organ.template --colmap c", USAGE, &["no exploration frames"]),
        ("figure gone -o a.svg", NOTHING, &["gone"]),
        ("figure empty -o a.svg", NOTHING, &["empty", "frame_NNN.ply"]),
        ("figure truth -o a.jpg", USAGE, &["a.jpg", ".svg", ".pdf", ".png"]),
        ("figure truth --methods joint -o a.svg", NOTHING, &["joint", "truth"]),
        ("figure truth --width 3 -o a.svg", USAGE, &["30 to 1000 mm"]),
        ("figure matches.csv -o a.svg", USAGE, &["--y", "matches.csv are face, b1"]),
        ("figure matches.csv --y gone -o a.svg", NOTHING, &["--y gone", "face, b1"]),
        ("figure matches.csv --y x --bars y,b1 -o a.svg", USAGE, &["2 columns", "has 1"]),
        ("figure matches.csv truth --y x -o a.svg", USAGE, &["matches.csv", "alone"]),
        ("figure truth --y x -o a.svg", USAGE, &["TABLE.csv"]),
        ("figure organ.ply --truth tumour.obj -o a.svg", NOTHING, &["tumour.obj"]),
        ("register-ct organ.template notes.txt -o o", NOTHING, &["notes.txt"]),
        ("synth --organ gone.ply --count 1 -o o", USAGE, &["gone.ply", "uterus"]),
        ("track gone frames --camera camera.json -o o", NOTHING, &["gone"]),
        ("reconstrct organ.template frames", USAGE, &["reconstruct"]),
    ];
    all_refused(&case, mistakes);
}
