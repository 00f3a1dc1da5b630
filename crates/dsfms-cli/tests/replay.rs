//! `dsfms replay` of recorded, live and changed runs, and `dsfms track --view`.

mod clip;

use clip::{CLIP, FRAMES, SIZE, Text, track};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

fn replay(out: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dsfms"));
    command.arg("replay").arg(out).args(arguments).args(["--quiet"]).output().unwrap()
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[test]
fn a_recorded_run_gives_the_same_bits_again_and_a_changed_one_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (out, record) = (folder.path().join("out"), folder.path().join("recording"));
    let record = record.to_str().unwrap();
    // Six frames in three seconds: the search in the first one ends before the last.
    let arguments = ["--record", record, "--stride", "2", "--realtime", "--rate", "2"];
    let said = track(&out, "frames", &arguments).said();
    let run = std::fs::read_to_string(out.join("run.json")).unwrap();
    let again = replay(&out, &[]);
    assert_eq!(again.status.code(), Some(0), "{said}\n{}\n{run}", told(&again));
    assert!(told(&again).contains("the same bits"), "{}", told(&again));
    // The frames are told by their numbers in the source, dropped ones or not.
    let value: serde_json::Value = serde_json::from_str(&run).unwrap();
    let numbers: Vec<u64> =
        value["frames"].as_array().unwrap().iter().map(|t| t["number"].as_u64().unwrap()).collect();
    assert!(numbers.iter().all(|n| n % 2 == 0 && (*n as usize) < FRAMES), "{numbers:?}");
    // Another picture in the recording, of the first frame that has a surface.
    let summary = std::fs::read_to_string(out.join("summary.csv")).unwrap();
    let mut shown = summary.lines().skip(1).filter(|row| !row.contains(",lost,"));
    let first = shown.next().and_then(|row| row.split(',').next()).expect("a surface");
    let first: u64 = first.parse().unwrap();
    let picture = Path::new(record).join(format!("frame_{first:06}.png"));
    let kept = std::fs::read(&picture).unwrap();
    let other = CLIP.path().join(format!("clip/frames/frame_{:03}.png", FRAMES - 1));
    std::fs::copy(other, &picture).unwrap();
    let again = replay(&out, &[]);
    assert_eq!(again.status.code(), Some(2), "{}", told(&again));
    let named = format!("differs first in frame {first}:");
    assert!(told(&again).contains(&named), "{}", told(&again));
    // A frame that is missing, and one that was moved elsewhere.
    std::fs::remove_file(&picture).unwrap();
    let again = replay(&out, &[]);
    assert_eq!(again.status.code(), Some(1), "{}", told(&again));
    assert!(told(&again).contains("lacks 1 of"), "{}", told(&again));
    std::fs::write(&picture, kept).unwrap();
    let moved = folder.path().join("archive");
    std::fs::rename(record, &moved).unwrap();
    assert!(told(&replay(&out, &[])).contains("--frames"));
    assert_eq!(replay(&out, &["--frames", moved.to_str().unwrap()]).status.code(), Some(0));
}

/// A recording names its frames by their place, masks are named as the files were.
#[test]
fn masks_of_a_recorded_run_are_found_again_and_a_seed_of_the_options_counts() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    for name in ["shots", "valid"] {
        std::fs::create_dir(path(name)).unwrap();
    }
    for k in 0..2 {
        let name = format!("shot_{}.png", 20 + k);
        let shot = CLIP.path().join(format!("clip/frames/frame_{k:03}.png"));
        std::fs::copy(shot, path("shots") + "/" + &name).unwrap();
        let [width, height] = SIZE.map(|side| side as u32);
        let valid = |x, _| image::Luma([255 * u8::from(x > 20 * k)]);
        let mask = image::GrayImage::from_fn(width, height, valid);
        mask.save(path("valid") + "/" + &name).unwrap();
    }
    std::fs::write(path("options.toml"), "[reconstruct]\nseed = 7").unwrap();
    let out = folder.path().join("out");
    let (valid, record, options) = (path("valid"), path("record"), path("options.toml"));
    let arguments = ["--masks", &valid, "--record", &record, "--options", &options];
    let said = track(&out, &path("shots"), &arguments).said();
    let again = replay(&out, &[]);
    assert_eq!(again.status.code(), Some(0), "{said}\n{}", told(&again));
    let run = std::fs::read_to_string(out.join("run.json")).unwrap();
    let run: serde_json::Value = serde_json::from_str(&run).unwrap();
    assert_eq!(run["options"]["reconstruct"]["seed"], 7);
}

#[test]
fn what_cannot_be_replayed_is_refused_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let again = replay(folder.path(), &[]);
    assert!(
        again.status.code() == Some(1) && told(&again).contains("run.json"),
        "{}",
        told(&again)
    );
    // Files are read again without a recording; a camera that has changed since is told.
    let (out, camera) = (folder.path().join("out"), folder.path().join("other.json"));
    track(&out, "frames", &["--stride", "4"]).said();
    assert_eq!(replay(&out, &[]).status.code(), Some(0));
    let text = std::fs::read_to_string(CLIP.path().join("clip/camera.json")).unwrap();
    std::fs::write(&camera, text + " ").unwrap();
    let again = replay(&out, &["--camera", camera.to_str().unwrap()]);
    assert!(again.status.code() == Some(1) && told(&again).contains("changed"), "{}", told(&again));
}

#[test]
fn a_running_track_serves_its_page() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_dsfms"))
        .current_dir(CLIP.path().join("clip"))
        .args(["track", "organ.template", "frames", "--camera", "camera.json", "--method", "dsfm"])
        .args(["--view", "--quiet", "--realtime", "--rate", "0.5", "-o"])
        .arg(folder.path().join("out"))
        .env("SSH_CONNECTION", "no browser")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let url = line.trim().rsplit(' ').next().unwrap().to_owned();
    let rest = url.strip_prefix("http://").unwrap_or_else(|| panic!("{line}"));
    let (host, root) = rest.split_once('/').unwrap();
    let get = |path: &str| {
        let mut stream = TcpStream::connect(host).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    };
    let start = Instant::now();
    let page = loop {
        assert!(start.elapsed() < Duration::from_secs(60), "no page of the run");
        let page = get(&format!("/{root}"));
        assert!(page.starts_with("HTTP/1.1 200"), "{page}");
        if page.contains(", running") {
            break page;
        }
        std::thread::sleep(Duration::from_millis(100));
    };
    assert!(host.starts_with("127.0.0.1:") && page.contains("Matches kept"), "{host}");
    assert!(get("/").starts_with("HTTP/1.1 404"));
    child.kill().unwrap();
    child.wait().unwrap();
}
