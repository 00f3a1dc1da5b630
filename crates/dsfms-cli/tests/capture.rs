//! `dsfms track` of what an installed ffmpeg captures, and of what it recorded itself.

mod clip;

use clip::{FRAMES, Text, assert_as_files, frame, track};
use dsfms::track::shapes::read_shapes;
use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// The frames of the clip as a device, pixel by pixel what the files hold.
const DEVICE: &str = "lavfi:movie=frames/frame_%03d.png:f=image2";

/// Whether there is an ffmpeg; it is said where there is none.
fn ffmpeg() -> bool {
    let found = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !found {
        eprintln!("!! SKIPPED  no ffmpeg (Debian: apt install ffmpeg): capture is NOT tested");
    }
    found
}

/// `dsfms track` of a device.
fn device(out: &Path, name: &str, arguments: &[&str]) -> Child {
    track(out, &format!("--device={name}"), arguments)
}

#[test]
fn a_device_gives_what_files_give_and_so_does_its_recording() {
    if !ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (out, again) = (folder.path().join("out"), folder.path().join("again"));
    let record = folder.path().join("recording");
    let record = record.to_str().unwrap();
    let said = device(&out, DEVICE, &["--record", record]).said();
    let (shapes, status) = read_shapes(&out.join("vertices.npz")).unwrap();
    assert_eq!(status.len(), FRAMES, "{said}");
    assert_as_files(&shapes, &status);
    assert!(said.contains("12 frame(s) recorded, 0 left out"), "{said}");
    let times = std::fs::read_to_string(Path::new(record).join("times.csv")).unwrap();
    assert_eq!(times.lines().count(), FRAMES + 1, "{times}");
    let recorded = dsfms::io::images::read_frame(&Path::new(record).join("frame_000007.png"));
    assert_eq!(recorded.unwrap().rgb, frame(7).rgb, "lossless");
    let said = track(&again, record, &[]).said();
    let (shapes, status) = read_shapes(&again.join("vertices.npz")).unwrap();
    assert_eq!(status.len(), FRAMES, "{said}");
    assert_as_files(&shapes, &status);
    // What was recorded is never written over.
    let said = track(&again, "frames", &["--record", record]).said();
    assert!(said.contains("not empty"), "{said}");
}

#[test]
fn a_recording_plays_at_its_times() {
    let folder = tempfile::tempdir().unwrap();
    let (record, out) = (folder.path().join("recording"), folder.path().join("out"));
    let recorded = track(&out, "frames", &["--record", record.to_str().unwrap()]).said();
    assert!(recorded.contains("12 frame(s) recorded"), "{recorded}");
    // The last frame came two seconds after the others.
    let times: String = (0..FRAMES)
        .map(|k| {
            let seconds = 1_700_000_000 + if k == FRAMES - 1 { 2 } else { 0 };
            format!("frame_{k:06}.png,{seconds}.{:09}\n", 1000 * k)
        })
        .collect();
    std::fs::write(record.join("times.csv"), format!("file,unix_s\n{times}")).unwrap();
    let start = Instant::now();
    track(&out, record.to_str().unwrap(), &["--realtime", "--rate", "1000"]).said();
    assert!(start.elapsed() > Duration::from_secs(2), "{:?}", start.elapsed());
}

#[test]
fn ffmpeg_that_is_missing_or_fails_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let missing = Command::new(env!("CARGO_BIN_EXE_dsfms"))
        .current_dir(clip::CLIP.path().join("clip"))
        .args(["track", "organ.template", "--camera", "camera.json", "--device", DEVICE, "-o"])
        .arg(&out)
        .env("PATH", folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&missing.stderr);
    assert!(said.contains("not found") && said.contains("install"), "{said}");
    assert_eq!(missing.status.code(), Some(1));
    for (name, arguments, expected) in [
        ("v4l2", vec![], "KIND:NAME"),
        (":x", vec![], "KIND:NAME"),
        ("v4l2:/dev/video0", vec!["frames"], "cannot be used with"),
    ] {
        let mut child = device(&out, name, &arguments);
        let said = child.said();
        assert!(said.contains(expected), "{expected}: {said}");
        assert_eq!(child.wait().unwrap().code(), Some(64), "{said}");
    }
    if !ffmpeg() {
        return;
    }
    for input in [
        "--device=v4l2:/dev/no-such-device",
        "--device=no-such-format:x",
        "rtsp://127.0.0.1:1/stream",
    ] {
        let mut child = track(&out, input, &[]);
        let said = child.said();
        assert!(said.contains("ffmpeg says"), "{said}");
        assert_eq!(child.wait().unwrap().code(), Some(1), "{said}");
    }
}

/// Processes that a process started.
#[cfg(target_os = "linux")]
fn children(id: u32) -> Vec<u32> {
    let tasks = std::fs::read_dir(format!("/proc/{id}/task")).unwrap();
    let lists = tasks.map(|task| std::fs::read_to_string(task.unwrap().path().join("children")));
    let lists = lists.map(Result::unwrap_or_default).collect::<Vec<_>>().join(" ");
    lists.split_whitespace().map(|id| id.parse().unwrap()).collect()
}

/// A run that is killed leaves no ffmpeg behind.
#[cfg(target_os = "linux")]
#[test]
fn ffmpeg_ends_with_the_run() {
    if !ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut child =
        device(&folder.path().join("out"), "lavfi:testsrc=size=320x180:rate=25", &["--quiet"]);
    let start = Instant::now();
    let patient = || assert!(start.elapsed() < Duration::from_secs(60));
    let started = loop {
        patient();
        match children(child.id()).as_slice() {
            [] => std::thread::sleep(Duration::from_millis(5)),
            [one, ..] => break *one,
        }
    };
    std::thread::sleep(Duration::from_millis(500));
    child.kill().unwrap();
    child.wait().unwrap();
    while Path::new(&format!("/proc/{started}/exe")).exists() {
        patient();
        std::thread::sleep(Duration::from_millis(5));
    }
}
