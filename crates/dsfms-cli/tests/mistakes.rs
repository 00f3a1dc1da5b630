//! The mistakes of an outside reader, one by one: each is refused with the file, the field, what
//! was expected and what was found, and leaves nothing behind. Those of `litter.rs` and
//! `bad_input.rs` are not repeated.

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
    write("strip.obj", "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n");
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
        ("synth --tone linear --count 1 -o o", USAGE, &["--tone linear", "sRGB"]),
        ("synth --square 3mm -o o", USAGE, &["--square belongs to --chessboard"]),
        ("synth --video --square 3mm -o o", USAGE, &["--square belongs to --chessboard"]),
        ("synth --video --size 32x32 -o o", USAGE, &["64x64"]),
        ("synth --organ tumour.obj --count 1 -o o", NOTHING, &["tumour.obj", "no faces"]),
        ("synth --organ strip.obj --count 1 -o o", NOTHING, &["strip.obj", "no part"]),
        ("synth --video --organ strip.obj -o o", NOTHING, &["strip.obj", "no part"]),
        ("synth --organ gone.ply --count 1 -o o", USAGE, &["gone.ply", "uterus"]),
        ("track gone frames --camera camera.json -o o", NOTHING, &["gone"]),
        ("reconstrct organ.template frames", USAGE, &["reconstruct"]),
    ];
    all_refused(&case, mistakes);
}

/// A case with what a careless command line would destroy or take for something else.
fn careless() -> Case {
    let case = prepared();
    let write = |name: &str, text: &str| fs::write(case.path(name), text).unwrap();
    let copy = |from: &str, to: &str| fs::copy(case.path(from), case.path(to)).unwrap();
    for folder in ["two", "second", "clear"] {
        fs::create_dir(case.path(folder)).unwrap();
    }
    copy("frames/organ_003.png", "two/organ_003.png");
    copy("frames/organ_003.png", "two/organ_004.png");
    copy("organ.ply", "second/organ.ply");
    let pose = r#"{"image": "organ_003.png", "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0, 0, "#;
    write("twice.json", &format!("[{pose}75]}}, {pose}80]}}]"));
    write("below.csv", "frame,depth\n0,-1\n1,0\n");
    write("none.json", r#"{"pairs": []}"#);
    write("blur.toml", "[refine]\nblur = 1e300");
    let transparent = image::RgbaImage::from_pixel(160, 120, image::Rgba([0, 0, 0, 40]));
    transparent.save(case.path("clear/instrument_003.png")).unwrap();
    case
}

#[test]
fn nothing_of_the_user_is_overwritten_or_ignored() {
    let mistakes: &[Mistake] = &[
        (
            "calibrate frames --board 4x3 --square 3mm -o frames/organ_003.png",
            USAGE,
            &["camera.json"],
        ),
        ("calibrate two two --board 4x3 --square 3mm -o c.json", USAGE, &["organ_003", "twice"]),
        ("evaluate organ.ply organ.ply --json organ.ply", USAGE, &["organ.ply", "overwritten"]),
        (
            "reconstruct organ.template frames --camera camera.json --structures organ.ply second/organ.ply -o out",
            USAGE,
            &["two structures are called organ"],
        ),
        (
            "reconstruct organ.template frames --camera camera.json --options blur.toml -o out",
            NOTHING,
            &["refine.blur", "0.25"],
        ),
        (
            "template --mesh organ.template/template.ply -o organ.template",
            USAGE,
            &["would be lost"],
        ),
        ("template --mesh organ.ply --masks masks -o t", USAGE, &["--masks belongs to frames"]),
        ("template --mesh organ.ply --vertices 500 -o t", USAGE, &["--vertices"]),
        (
            "template frames --camera camera.json --mesh organ.ply --poses twice.json -o t",
            NOTHING,
            &["twice.json", "two different poses of organ_003.png"],
        ),
        (
            "template --mesh organ.ply --camera camera.json -o t",
            USAGE,
            &["--camera belongs to frames"],
        ),
        ("export organ.template --mesh organ.template/template.ply", USAGE, &["template itself"]),
        ("export organ.template --mesh albedo.obj", USAGE, &["albedo.png"]),
        (
            "export organ.template --mesh new.ply --pictures notes.txt",
            USAGE,
            &["notes.txt", "folder"],
        ),
        ("register-ct organ.template organ.ply --landmarks none.json -o ct", NOTHING, &["no pair"]),
        (
            "register-ct organ.template organ.ply --rigid --max-deformation 5mm -o ct",
            USAGE,
            &["--rigid", "--max-deformation"],
        ),
        ("register-ct organ.template organ.ply -o two", NOTHING, &["\"organ_003.png\"", "lost"]),
        ("figure organ.ply --frame 3 -o a.svg", USAGE, &["--frame", "output folder"]),
        ("figure matches.csv --y x --frame 3 -o a.svg", USAGE, &["--frame", "output folder"]),
        (
            "figure below.csv --y depth --log y -o a.svg",
            NOTHING,
            &["--y depth", "row 1: -1", "above zero"],
        ),
        ("evaluate organ.ply tumour.obj --json new/a.json", NOTHING, &["tumour.obj"]),
        (
            "track organ.template frames --camera camera.json --igtl-image overlay -o out",
            USAGE,
            &["--igtl"],
        ),
    ];
    all_refused(&careless(), mistakes);
}

#[test]
fn one_file_of_matches_for_several_frames_draws_a_warning() {
    let case = careless();
    let line = "reconstruct organ.template two --camera camera.json --matches matches.csv --method dsfm -o out";
    let done = case.dsfms(&line.split(' ').collect::<Vec<_>>()).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(said.contains("all of 2 frames"), "{said}");
}

#[test]
fn an_evaluation_without_a_pair_writes_nothing() {
    let case = prepared();
    fs::create_dir(case.path("found")).unwrap();
    fs::copy(case.path("organ.ply"), case.path("found/frame_099.ply")).unwrap();
    let done =
        case.dsfms(&["evaluate", "found", "truth", "--json", "new/a.json"]).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(NOTHING), "{said}");
    assert!(said.contains("frame_099.ply") && !case.path("new").exists(), "{said}");
}

#[test]
fn what_decades_cannot_show_is_counted() {
    let case = prepared();
    fs::write(case.path("some.csv"), "frame,error\n0,0.5\n1,0\n2,3\n").unwrap();
    let line = "figure some.csv --y error --log y -o a.svg";
    let done = case.dsfms(&line.split(' ').collect::<Vec<_>>()).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(0), "{said}");
    assert!(said.contains("error: 1 of 3 rows") && said.contains("row 2: 0"), "{said}");
}

#[test]
fn a_mask_in_the_transparency_is_no_mask() {
    let case = careless();
    let line =
        "reconstruct organ.template frames --camera camera.json --matches matches.csv -o out";
    let arguments: Vec<&str> = line.split(' ').chain(["--instrument-masks", "clear"]).collect();
    let done = case.dsfms(&arguments).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(NOTHING), "{said}");
    assert!(said.contains("transparent"), "{said}");
}

#[test]
fn cases_of_two_series_are_not_mixed() {
    let case = Case::new();
    let synth = |seed: &str, extension: &str| {
        let line =
            ["synth", "--vertices", "60", "--count", "1", "-o", "s", "--seed", seed, "--ext"];
        case.dsfms(&[&line[..], &[extension]].concat()).output().unwrap().status.code()
    };
    assert_eq!(synth("1", "5"), Some(0));
    assert_eq!(synth("1", "10"), Some(0));
    assert_eq!(synth("2", "5"), Some(USAGE));
}
