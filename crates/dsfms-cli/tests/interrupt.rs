//! Runs that are stopped: what is told, what is kept, and that it goes on to the same result.
#![cfg(unix)]

mod common;

use common::save;
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::synth;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use tempfile::TempDir;

fn dsfms(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin("dsfms"));
    command.current_dir(folder).args(arguments);
    command
}

/// Start it, wait for a line of its standard error, and send a signal; code and all lines.
fn stopped(
    mut command: Command,
    wanted: impl Fn(&str) -> bool,
    signal: &str,
) -> (Option<i32>, String) {
    let mut child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let mut reader = BufReader::new(child.stderr.take().unwrap());
    let mut text = String::new();
    while !text.lines().last().is_some_and(&wanted) {
        assert!(reader.read_line(&mut text).unwrap() > 0, "not in {text}");
    }
    send(&child, signal);
    reader.read_to_string(&mut text).unwrap();
    (child.wait().unwrap().code(), text)
}

/// A line of progress of a stage.
fn stage(name: &str) -> impl Fn(&str) -> bool {
    let name = format!("\"stage\":\"{name}\"");
    move |line| line.contains(&name)
}

fn send(child: &Child, signal: &str) {
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
}

/// Every file below, by its place.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            found.extend(
                files(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)),
            );
        } else {
            found.insert(name, std::fs::read(path).unwrap());
        }
    }
    found
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Eight frames of a synthetic organ at rest, and their camera.
fn exploration() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let case = synth::Case::example(1);
    std::fs::create_dir(folder.path().join("frames")).unwrap();
    for frame in case.explore(8).0 {
        let path = folder.path().join(format!("frames/{}.png", frame.name));
        save(&path, frame.size, |i| frame.rgb[i]);
    }
    let light = case.template.light.clone();
    let file = CameraFile { camera: case.camera, tone: None, light, vignetting: None };
    write_camera(&folder.path().join("camera.json"), &file).unwrap();
    // On few pixels: what is shown is that stages are kept, not how well they work.
    let quick = "[dense]\nmax_pixels = 20000\n[albedo]\nmax_resolution = 4\n[light]\nspots = 300\n";
    std::fs::write(folder.path().join("quick.toml"), quick).unwrap();
    folder
}

fn template(folder: &Path, output: &str) -> Command {
    let arguments = ["template", "frames", "--camera", "camera.json", "--options", "quick.toml"];
    let more = ["--vertices", "150", "--progress", "json", "--no-report", "-o", output];
    dsfms(folder, &[&arguments[..], &more].concat())
}

/// Build to the end; what was told.
fn whole(folder: &Path, output: &str) -> String {
    let done = template(folder, output).output().unwrap();
    let text = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(matches!(done.status.code(), Some(0 | 2)), "{text}");
    text
}

#[test]
fn a_template_goes_on_where_it_was_stopped() {
    let place = exploration();
    let folder = place.path();
    whole(folder, "whole.template");
    let expected = files(&folder.join("whole.template"));
    let output = "organ.template";
    // Early: nothing was finished.
    let (code, text) = stopped(template(folder, output), stage("features"), "-INT");
    assert_eq!(code, Some(130), "{text}");
    assert!(text.contains("stopped; "), "{text}");
    // Between stages, by both signals and by one that nobody can catch.
    let (code, text) = stopped(template(folder, output), stage("camera poses"), "-TERM");
    assert_eq!(code, Some(143), "{text}");
    assert!(text.contains("matches") && text.contains("organ.template.partial"), "{text}");
    assert!(text.contains("the same command goes on"), "{text}");
    let (code, text) = stopped(template(folder, output), stage("stereo"), "-KILL");
    assert_eq!(code, None, "{text}");
    assert!(text.contains("resumed after matches (8 frames)"), "{text}");
    assert!(names(&folder.join("organ.template.partial")).contains(&"poses.stage".to_string()));
    assert!(!folder.join(output).exists());
    // A damaged value is made again, from the one before it.
    let poses = folder.join("organ.template.partial/poses.stage");
    let mut bytes = std::fs::read(&poses).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&poses, bytes).unwrap();
    let text = whole(folder, output);
    assert!(text.contains("poses.stage is damaged and not used"), "{text}");
    assert!(text.contains("resumed after matches"), "{text}");
    let left = ["camera.json", "frames", "organ.template", "quick.toml", "whole.template"];
    assert_eq!(names(folder), left);
    let found = files(&folder.join(output));
    assert_eq!(found.keys().collect::<Vec<_>>(), expected.keys().collect::<Vec<_>>());
    for (name, bytes) in &found {
        assert!(
            *bytes == expected[name],
            "{name} differs from that of the run that was not stopped"
        );
    }
}

#[test]
fn frames_that_are_done_stay_and_the_rest_is_told() {
    let case = common::Case::new();
    case.template();
    let image = case.path("frames/organ_003.png");
    for i in 4..40 {
        std::fs::copy(&image, case.path(&format!("frames/organ_{i:03}.png"))).unwrap();
    }
    let arguments = ["reconstruct", "organ.template", "frames", "--camera", "camera.json"];
    let more = ["--matches", "matches.csv", "--progress", "json", "--threads", "1", "-o", "out"];
    let run = dsfms(case.folder.path(), &[&arguments[..], &more].concat());
    let (code, text) =
        stopped(run, |line| line.contains("\"done\":") && !line.contains("\"done\":0"), "-INT");
    assert_eq!(code, Some(130), "{text}");
    assert!(text.contains("of 37 frames are whole in out"), "{text}");
    let summary = std::fs::read_to_string(case.path("out/summary.csv")).unwrap();
    let rows = summary.lines().count() - 1;
    assert!((1..37).contains(&rows), "{summary}");
    let left = names(&case.path("out"));
    assert_eq!(
        left.iter().filter(|n| n.starts_with("frame_") && n.ends_with(".json")).count(),
        rows,
        "{left:?}"
    );
    assert!(left.iter().all(|name| !name.starts_with(".partial")), "{left:?}");
}

#[test]
fn a_tracker_that_waits_for_frames_ends_with_what_it_has() {
    let place = tempfile::tempdir().unwrap();
    let synth = ["synth", "--video", "--frames", "2", "--size", "160x120", "--vertices", "150"];
    let made =
        dsfms(place.path(), &[&synth[..], &["--seed", "3", "-q", "-o", "clip"]].concat()).status();
    assert!(made.unwrap().success());
    let clip = place.path().join("clip");
    let frame = image::open(clip.join("frames/frame_000.png")).unwrap().to_rgb8();
    let arguments =
        ["track", "organ.template", "-", "--camera", "camera.json", "--size", "160x120"];
    let more = ["--method", "dsfm", "--no-report", "-o", "out"];
    let mut child = dsfms(&clip, &[&arguments[..], &more].concat())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    input.write_all(frame.as_raw()).unwrap();
    // The answer to the frame; no other comes.
    let mut answers = BufReader::new(child.stdout.take().unwrap());
    let mut line = String::new();
    answers.read_line(&mut line).unwrap();
    send(&child, "-INT");
    let done = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(130), "{text}");
    assert!(text.contains("the 1 frame(s) so far are whole in out"), "{text}");
    assert_eq!(std::fs::read_to_string(clip.join("out/summary.csv")).unwrap().lines().count(), 2);
    assert!(clip.join("out/vertices.npz").is_file());
    drop(input);
}
