//! A small synthetic clip, what `dsfms track` makes of its files, and the program as it runs.

#![allow(dead_code, reason = "no test file needs all of it")]

use assert_cmd::Command as Assert;
use dsfms::image::Frame;
use dsfms::track::shapes::read_shapes;
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::LazyLock;
use tempfile::TempDir;

pub const SIZE: [usize; 2] = [320, 180];
pub const FRAMES: usize = 12;

/// Twelve frames of a clip with its template, made once, and `files`, what they give without a
/// network.
pub static CLIP: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    Assert::cargo_bin("dsfms")
        .unwrap()
        .args(["synth", "--video", "--frames", "12", "--size", "320x180", "--vertices", "150"])
        .args(["--seed", "3", "--quiet", "-o"])
        .arg(folder.path().join("clip"))
        .assert()
        .success();
    let plain = Assert::cargo_bin("dsfms")
        .unwrap()
        .current_dir(folder.path())
        .args(["track", "clip/organ.template", "clip/frames", "--camera", "clip/camera.json"])
        .args(["--no-report", "--quiet", "--method", "dsfm", "-o", "files"])
        .output()
        .unwrap();
    assert_ne!(plain.status.code(), Some(1), "{}", String::from_utf8_lossy(&plain.stderr));
    folder
});

pub fn frame(number: usize) -> Frame {
    let path = CLIP.path().join(format!("clip/frames/frame_{number:03}.png"));
    let rgb = image::open(path).unwrap().to_rgb8();
    Frame { name: String::new(), size: SIZE, rgb: rgb.pixels().map(|p| p.0).collect() }
}

/// `dsfms track` of the template as it runs.
pub fn track(out: &Path, input: &str, arguments: &[&str]) -> Child {
    track_of("organ.template", out, input, arguments)
}

/// `dsfms track` of a template or mesh of the clip as it runs.
pub fn track_of(template: &str, out: &Path, input: &str, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_dsfms"))
        .current_dir(CLIP.path().join("clip"))
        .args(["track", template, input, "--camera", "camera.json", "--no-report"])
        .args(["--method", "dsfm"])
        .args(arguments)
        .arg("-o")
        .arg(out)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// A column of `summary.csv`.
pub fn column(out: &Path, name: &str) -> Vec<String> {
    let text = std::fs::read_to_string(out.join("summary.csv")).unwrap();
    let place = text.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
    text.lines().skip(1).map(|l| l.split(',').nth(place).unwrap().to_owned()).collect()
}

/// The same bits as from files.
pub fn assert_as_files(shapes: &[Vec<dsfms::geometry::Point3>], status: &[u8]) {
    let (known, of) = read_shapes(&CLIP.path().join("files/vertices.npz")).unwrap();
    assert_eq!(status, of);
    assert!(status.iter().filter(|s| **s < 2).count() >= FRAMES / 2, "{status:?}");
    for k in (0..FRAMES).filter(|k| status[*k] < 2) {
        assert_eq!(shapes[k], known[k], "frame {k}");
    }
}

/// What a process said on standard error.
pub trait Text {
    fn said(&mut self) -> String;
}

impl Text for Child {
    fn said(&mut self) -> String {
        let mut said = String::new();
        self.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        self.wait().unwrap();
        said
    }
}
