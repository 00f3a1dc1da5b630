//! Mistakes: each is named for what it is, and a refused command leaves nothing behind.

mod common;
#[path = "../../dsfms/tests/common/mp4.rs"]
mod mp4;

use common::refusal::{NOTHING, USAGE, refused};
use common::{Case, save};
use std::fs;

/// A case with a template, a photograph for a mask and a few wrong files.
fn prepared() -> Case {
    let case = Case::new();
    case.template();
    fs::write(case.path("notes.txt"), "no video, no frame, no camera").unwrap();
    fs::write(case.path("clip.mp4"), "no video either").unwrap();
    fs::create_dir(case.path("photographs")).unwrap();
    for name in ["organ_003", "tool_003"] {
        let path = case.path(&format!("photographs/{name}.png"));
        save(&path, [160, 120], |i| [(i % 251) as u8; 3]);
    }
    fs::create_dir(case.path("small")).unwrap();
    fs::create_dir(case.path("texts")).unwrap();
    for i in 0..4 {
        fs::write(case.path(&format!("texts/text_{i}.png")), "no image").unwrap();
        save(&case.path(&format!("small/f_{i}.png")), [80, 60], |_| [120; 3]);
    }
    case
}

const CAMERA: [&str; 2] = ["--camera", "camera.json"];

#[test]
fn reconstruct() {
    let case = prepared();
    let run = |images: &[&str], more: &[&str], code: i32, words: &[&str]| {
        let arguments =
            [&["reconstruct", "organ.template"], images, &CAMERA, more, &["-o", "out"]].concat();
        refused(&case, &arguments, code, words);
    };
    let matches = ["--matches", "matches.csv"];
    run(&["nowhere"], &matches, NOTHING, &["nowhere", "no such file"]);
    run(&["truth"], &matches, NOTHING, &["truth", "none was found"]);
    run(&["frames"], &["--matches", "none.csv"], NOTHING, &["--matches", "none.csv"]);
    run(&["frames"], &["--options", "none.toml"], NOTHING, &["none.toml"]);
    run(&["frames"], &["--instrument-masks", "none"], NOTHING, &["--instrument-masks", "none"]);
    run(&["frames"], &["--structures", "none.ply"], NOTHING, &["none.ply"]);
    run(&["frames"], &["--method", "best"], USAGE, &["best", "joint"]);
    run(&["frames"], &["--formats", "vtk"], USAGE, &["vtk", "vtp"]);
    let size = ["f_0.png", "80x60", "160x120", "camera.json"];
    run(&["small"], &matches, NOTHING, &size);
    let masks = ["--instrument-masks", "photographs", "--matches", "matches.csv"];
    run(&["frames"], &masks, NOTHING, &["photographs", "not a mask", "photograph"]);
    run(&["notes.txt"], &[], NOTHING, &["notes.txt", "image"]);
    run(&["texts"], &[], NOTHING, &["text_0.png", "image"]);
    run(&["clip.mp4"], &[], NOTHING, &["clip.mp4"]);
    let other = ["reconstruct", "frames", "frames", "-o", "out"];
    refused(&case, &other, NOTHING, &["frames", "template"]);
}

#[test]
fn template() {
    let case = prepared();
    let run = |more: &[&str], code: i32, words: &[&str]| {
        refused(&case, &[&["template"], more, &["-o", "deep/new.template"]].concat(), code, words);
    };
    run(&["nowhere", "--camera", "camera.json"], NOTHING, &["nowhere"]);
    run(&["frames"], USAGE, &["--camera"]);
    run(&["small", "--camera", "camera.json"], NOTHING, &["f_0.png", "80x60", "160x120"]);
    run(&["frames", "--camera", "none.json"], NOTHING, &["none.json"]);
    run(&["--mesh", "none.ply"], NOTHING, &["none.ply"]);
    run(&["--mesh", "camera.json"], NOTHING, &["camera.json", ".ply"]);
    run(&["--mesh", "organ.ply", "--albedo", "none.png"], NOTHING, &["none.png"]);
    run(&["frames", "--mesh", "organ.ply", "--camera", "camera.json"], USAGE, &["--poses"]);
    run(&["frames", "--camera", "camera.json", "--vertices", "5"], USAGE, &["100 to 50000"]);
    run(&["frames", "--camera", "camera.json", "--masks", "none"], NOTHING, &["--masks"]);
    let masks = ["--organ-masks", "photographs"];
    run(&[&["frames", "--camera", "camera.json"], &masks[..]].concat(), NOTHING, &["not a mask"]);
}

#[test]
fn track() {
    let case = prepared();
    let run = |input: &[&str], more: &[&str], code: i32, words: &[&str]| {
        let arguments =
            [&["track", "organ.template"], input, &CAMERA, more, &["-o", "out"]].concat();
        refused(&case, &arguments, code, words);
    };
    // What an older run left stays.
    fs::create_dir(case.path("out")).unwrap();
    fs::write(case.path("out/dsfms.json"), "{}").unwrap();
    fs::write(case.path("out/frame_000.ply"), "of an older run").unwrap();
    for input in ["notes.txt", "clip.mp4", "gone.mp4", "gone.png", "gone", "truth"] {
        run(&[input], &["--record", "kept"], NOTHING, &[input]);
    }
    run(&["frames", "gone.mp4"], &[], NOTHING, &["gone.mp4"]);
    run(&["-"], &[], USAGE, &["--size"]);
    run(&["-"], &["--size", "160x120", "--input-format", "mjpeg"], USAGE, &["--size", "raw"]);
    run(&["frames"], &["--size", "160x120"], USAGE, &["--size", "standard input"]);
    run(&["frames"], &["--input-format", "raw"], USAGE, &["--input-format", "standard input"]);
    run(&["frames"], &["--record", "small"], USAGE, &["small", "not empty"]);
    run(&["igtl://nowhere"], &[], USAGE, &["igtl://nowhere"]);
}

/// A million pictures of one byte each are no frames of which each has its file.
#[test]
fn a_video_without_pictures() {
    let case = prepared();
    fs::write(case.path("junk.mp4"), mp4::tiny_samples([160, 120], None, 1 << 20)).unwrap();
    let words = ["junk.mp4", "more than 3000 pictures in a row"];
    let track = ["track", "organ.template", "junk.mp4", "--camera", "camera.json", "-o", "out"];
    let template = ["template", "junk.mp4", "--camera", "camera.json", "-o", "new.template"];
    let reconstruct = [&["reconstruct"], &track[1..]].concat();
    let calibrate = ["calibrate", "junk.mp4", "--board", "7x5", "--square", "3", "-o", "new.json"];
    for arguments in [&track[..], &template, &reconstruct, &calibrate] {
        refused(&case, arguments, NOTHING, &words);
    }
}

#[test]
fn other_commands() {
    let case = prepared();
    let calibrate = ["calibrate", "frames", "--square", "3mm", "-o", "new/cal.json", "--board"];
    let board = |b| [&calibrate[..], &[b]].concat();
    refused(&case, &board("7x5"), NOTHING, &["board"]);
    refused(&case, &board("seven"), USAGE, &["10x7"]);
    let gone = ["calibrate", "none", "--board", "7x5", "--square", "3mm", "-o", "new.json"];
    refused(&case, &gone, NOTHING, &["none"]);
    let organ = ["synth", "--organ", "spleen", "--count", "1", "-o", "out"];
    refused(&case, &organ, USAGE, &["spleen", "uterus"]);
    let series = ["experiment", "ext", "--organ", "spleen", "--count", "1", "-o", "out"];
    refused(&case, &series, USAGE, &["spleen", "uterus"]);
    refused(&case, &["inspect", "frames"], NOTHING, &["frames"]);
    refused(&case, &["view", "none", "--no-open"], NOTHING, &["none"]);
    refused(&case, &["export", "organ.template"], USAGE, &["--mesh"]);
    refused(&case, &["export", "organ.template", "--mesh", "a.fbx"], USAGE, &["a.fbx", ".glb"]);
    let figure = ["figure", "truth", "--frame", "77", "-o", "plate.svg"];
    refused(&case, &figure, NOTHING, &["no frame 77", "holds 3"]);
    refused(&case, &["figure", "truth", "-o", "plate.gif"], USAGE, &["plate.gif", ".svg"]);
    refused(&case, &["evaluate", "truth", "organ.ply"], USAGE, &["both be files"]);
}

/// Twelve camera files, each with one mistake: the file, what was found, and what is expected.
#[test]
fn cameras() {
    let case = prepared();
    let write = |name: &str, text: &str| fs::write(case.path(name), text).unwrap();
    let with = |more: &str| {
        format!(
            r#"{{"width": 160, "height": 120, "fx": 200, "fy": 200, "cx": 79.5, "cy": 59.5{more}}}"#
        )
    };
    let identity =
        r#"[{"image": "organ_003.png", "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0, 0, 75]}]"#;
    write("poses.json", identity);
    let twice = with("").replace("160", "-160");
    let mistakes: [(&str, String, &[&str]); 11] = [
        ("poses.json", identity.into(), &["poses", "--poses"]),
        ("empty.json", String::new(), &["empty"]),
        ("cut.json", with("")[..40].into(), &["JSON"]),
        ("no_focal.json", with("").replace("\"fx\": 200, ", ""), &["fx"]),
        ("nan.json", with("").replace("79.5", "NaN"), &["NaN", "finite"]),
        ("negative.json", twice, &["width", "-160"]),
        ("zero.json", with("").replace("\"fy\": 200", "\"fy\": 0"), &["positive"]),
        ("misspelt.json", with(r#", "distorsion": {"k1": 0.1}"#), &["distorsion", "distortion"]),
        ("lens.json", with(r#", "distortion_model": "magic""#), &["magic"]),
        ("tone.json", with(r#", "tone_curve": "rainbow""#), &["rainbow", "srgb"]),
        ("light.json", with(r#", "light": {"kind": "sun"}"#), &["sun"]),
    ];
    for (name, text, words) in mistakes {
        write(name, &text);
        let arguments = ["template", "frames", "--camera", name, "-o", "new/organ.template"];
        refused(&case, &arguments, NOTHING, &[&[name], words].concat());
    }
    // The twelfth is a folder; and a camera is no list of poses.
    let folder = ["template", "frames", "--camera", "truth", "-o", "new/organ.template"];
    refused(&case, &folder, NOTHING, &["truth"]);
    let swapped = ["template", "frames", "--camera", "camera.json", "--poses", "camera.json"];
    let arguments = [&swapped[..], &["-o", "new/organ.template"]].concat();
    refused(&case, &arguments, NOTHING, &["camera.json", "--camera"]);
}

#[test]
fn matches_and_options() {
    let case = prepared();
    let write = |name: &str, text: &str| fs::write(case.path(name), text).unwrap();
    let head = "face,b1,b2,b3,x,y\n";
    let mistakes: [(&str, String, &[&str]); 6] = [
        ("columns.csv", "face,b1,b2,x,y\n".into(), &["b3", "expected a header"]),
        ("short.csv", format!("{head}0,1,0,0,5\n"), &["line 2", "5 values"]),
        ("word.csv", format!("{head}0,1,0,0,here,9\n"), &["line 2", "here", "finite number"]),
        ("sum.csv", format!("{head}0,1,1,0,5,5\n"), &["line 2", "expected 1"]),
        ("face.csv", format!("{head}99999,1,0,0,5,5\n"), &["face 99999", "not in the template"]),
        ("far.csv", format!("{head}0,1,0,0,9000,5\n"), &["9000", "160x120"]),
    ];
    for (name, text, words) in mistakes {
        write(name, &text);
        let arguments = ["reconstruct", "organ.template", "frames", "--camera", "camera.json"];
        let more = ["--matches", name, "--method", "rigid", "-o", "out"];
        refused(&case, &[&arguments[..], &more].concat(), NOTHING, &[words, &[name]].concat());
    }
    write("typo.toml", "[joint]\nheaviness = 1.0\n");
    write("bound.toml", "[register]\nrobust_px = -1.0\n");
    for (name, words) in [("typo.toml", "heaviness"), ("bound.toml", "robust_px")] {
        let arguments = ["reconstruct", "organ.template", "frames", "--camera", "camera.json"];
        let more = ["--options", name, "-o", "out"];
        refused(&case, &[&arguments[..], &more].concat(), NOTHING, &[name, words]);
    }
}
