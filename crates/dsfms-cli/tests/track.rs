//! `dsfms track`: a small synthetic clip from files, by pipe, damaged and faster than it can be
//! solved.

#[path = "../../dsfms/tests/common/mp4.rs"]
mod mp4;
#[path = "../../dsfms/tests/common/organ.rs"]
mod organ;

use assert_cmd::Command;
use dsfms::geometry::Point3;
use dsfms::io::mesh::{MeshFile, read_mesh};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::template::LengthUnit;
use organ::closed;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::LazyLock;
use tempfile::TempDir;

const SIZE: [u32; 2] = [320, 180];

/// Twelve frames of a clip with its template, made once.
static CLIP: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let synth = ["synth", "--video", "--frames", "12", "--size", "320x180", "--vertices", "150"];
    Command::cargo_bin("dsfms")
        .unwrap()
        .args(synth)
        .args(["--seed", "3", "--quiet", "-o"])
        .arg(folder.path().join("clip"))
        .assert()
        .success();
    folder
});

fn clip(name: &str) -> PathBuf {
    CLIP.path().join("clip").join(name)
}

fn frame(number: usize) -> image::RgbImage {
    image::open(clip(&format!("frames/frame_{number:03}.png"))).unwrap().to_rgb8()
}

fn jpeg(number: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
    frame(number).write_with_encoder(encoder).unwrap();
    bytes
}

/// `track` in the clip's folder; outputs to a fresh one.
fn track(out: &Path, input: &str, arguments: &[&str], stdin: Vec<u8>) -> Output {
    Command::cargo_bin("dsfms")
        .unwrap()
        .current_dir(CLIP.path().join("clip"))
        .args(["track", "organ.template", input, "--camera", "camera.json", "--no-report"])
        .args(["--method", "dsfm"])
        .args(arguments)
        .arg("-o")
        .arg(out)
        .write_stdin(stdin)
        .output()
        .unwrap()
}

/// Lines of JSON with the bytes that follow them.
fn lines(mut bytes: &[u8]) -> Vec<(serde_json::Value, Vec<u8>)> {
    let mut lines = Vec::new();
    while let Some(end) = bytes.iter().position(|&b| b == b'\n') {
        let line: serde_json::Value = serde_json::from_slice(&bytes[..end]).unwrap();
        let count = line["vertices_bytes"].as_u64().unwrap_or(0) as usize;
        lines.push((line, bytes[end + 1..end + 1 + count].to_vec()));
        bytes = &bytes[end + 1 + count..];
    }
    assert!(bytes.is_empty(), "{} bytes too many", bytes.len());
    lines
}

/// A column of `summary.csv`.
fn column(out: &Path, name: &str) -> Vec<String> {
    let text = std::fs::read_to_string(out.join("summary.csv")).unwrap();
    let place = text.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
    text.lines().skip(1).map(|l| l.split(',').nth(place).unwrap().to_owned()).collect()
}

#[test]
fn raw_frames_give_the_shapes_of_files_and_their_vertices_by_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let (files, pipe) = (folder.path().join("files"), folder.path().join("pipe"));
    let done = track(&files, "frames", &["--quiet"], Vec::new());
    assert!(done.stdout.is_empty(), "files say nothing on standard output");
    let raw: Vec<u8> = (0..12).flat_map(|k| frame(k).into_raw()).collect();
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    let arguments = ["--size", &size, "--live-vertices", "--quiet"];
    let live = track(&pipe, "-", &arguments, raw.clone());
    let (a, b) = (files.join("vertices.npz"), pipe.join("vertices.npz"));
    assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
    let (shapes, status) = dsfms::track::shapes::read_shapes(&b).unwrap();
    // One frame is black; where the instrument, of which no mask tells, covers a part, they are
    // degraded.
    assert!(status.iter().filter(|s| **s < 2).count() == 11, "{status:?}");
    assert!(status.iter().filter(|s| **s == 0).count() >= 6, "{status:?}");
    let lines = lines(&live.stdout);
    assert_eq!(lines.len(), 12);
    for (k, (line, bytes)) in lines.iter().enumerate() {
        assert_eq!(line["frame"].as_u64(), Some(k as u64));
        let numbers: Vec<f32> =
            bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let known: Vec<f32> =
            shapes[k].iter().flat_map(|p| [p.x, p.y, p.z]).map(|c| c as f32).collect();
        if status[k] == 2 {
            assert!(numbers.is_empty() && line.get("pose").is_none());
        } else {
            assert_eq!(numbers, known, "frame {k}");
        }
    }
    // Cut off within the third frame: two frames and one that is lost, with the reason.
    let part = raw[..raw.len() / 12 * 2 + 1000].to_vec();
    let cut = track(&folder.path().join("cut"), "-", &["--size", &size], part);
    assert_eq!(cut.status.code(), Some(2));
    let cut = self::lines(&cut.stdout);
    assert_eq!(cut.len(), 3);
    assert_eq!(cut[2].0["status"], "lost");
    assert!(cut[2].0["reasons"][0].as_str().unwrap().contains("ends within a frame"));
}

#[test]
fn a_damaged_picture_of_a_jpeg_stream_is_one_lost_frame() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut damaged = jpeg(1);
    damaged.truncate(damaged.len() / 2);
    // Frames that no instrument is in.
    let stream = [b"--frame\r\n\r\n".to_vec(), jpeg(0), damaged, jpeg(1), jpeg(6)].concat();
    let arguments = ["--input-format", "mjpeg", "--overlay", "--keep-lost"];
    let done = track(&out, "-", &arguments, stream);
    assert_eq!(done.status.code(), Some(2), "{}", String::from_utf8_lossy(&done.stderr));
    let status: Vec<String> =
        lines(&done.stdout).iter().map(|l| l.0["status"].as_str().unwrap().to_owned()).collect();
    assert_eq!(status, ["ok", "lost", "ok", "ok"]);
    // Kept as asked, and said to be lost in the file of shapes too.
    let (shapes, kept) = dsfms::track::shapes::read_shapes(&out.join("vertices.npz")).unwrap();
    assert!(kept == [0, 2, 0, 0] && shapes[1] == shapes[0] && shapes[2] != shapes[0]);
    assert!(column(&out, "reasons")[1].contains("cut off"), "{:?}", column(&out, "reasons"));
    assert!(out.join("overlay/frame_001.png").exists());
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(out.join("overlay.mp4").exists() || said.contains("ffmpeg"), "{said}");
}

/// Seven frames of the clip as a video, and where its coded pictures lie. The eighth is covered
/// (`truth/events.csv`) and rightly lost.
fn video() -> mp4::Video {
    let size = SIZE.map(|n| n as usize);
    let rgb = |k| frame(k).pixels().map(|p| p.0).collect::<Vec<_>>();
    mp4::video(size, &(0..7).map(rgb).collect::<Vec<_>>())
}

#[test]
fn a_damaged_frame_of_a_video_is_lost_under_its_number() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("clip.mp4"), folder.path().join("out"));
    let mut video = video();
    let fifth = video.samples[4].clone();
    video.bytes[fifth.start + 5..fifth.start + 9].fill(0);
    std::fs::write(&path, &video.bytes).unwrap();
    let done = track(&out, path.to_str().unwrap(), &[], Vec::new());
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(2), "{said}");
    let lost: Vec<bool> = column(&out, "status").iter().map(|s| s == "lost").collect();
    let reasons = column(&out, "reasons");
    assert_eq!(lost, [false, false, false, false, true, false, false], "{reasons:?}");
    assert!(reasons[4].contains("coded data"), "{reasons:?}");
    assert_eq!(column(&out, "frame"), ["0", "1", "2", "3", "4", "5", "6"]);
    assert!(said.contains("frame_004 is lost"), "{said}");
    let (shapes, codes) = dsfms::track::shapes::read_shapes(&out.join("vertices.npz")).unwrap();
    assert_eq!((shapes.len(), codes[4]), (7, 2));
}

#[test]
fn a_frame_of_another_size_or_without_its_mask_is_lost_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let (frames, masks) = (folder.path().join("frames"), folder.path().join("masks"));
    let out = folder.path().join("out");
    std::fs::create_dir_all(&frames).unwrap();
    std::fs::create_dir_all(&masks).unwrap();
    for k in 0..6 {
        let name = format!("frame_{k:03}.png");
        let picture = if k == 3 { image::RgbImage::new(64, 48) } else { frame(k) };
        picture.save(frames.join(&name)).unwrap();
        if k != 1 {
            image::GrayImage::new(picture.width(), picture.height())
                .save(masks.join(&name))
                .unwrap();
        }
    }
    let arguments = ["--instrument-masks", masks.to_str().unwrap()];
    let done = track(&out, frames.to_str().unwrap(), &arguments, Vec::new());
    assert_eq!(done.status.code(), Some(2), "{}", String::from_utf8_lossy(&done.stderr));
    let status = column(&out, "status");
    let lost: Vec<bool> = status.iter().map(|s| s == "lost").collect();
    assert_eq!(lost, [false, true, false, true, false, false], "{status:?}");
    let reasons = column(&out, "reasons");
    assert!(reasons[1].contains("mask") && reasons[3].contains("64"), "{reasons:?}");
    assert!(out.join("vertices.npz").exists());
}

/// Which frames are dropped depends on the machine (`queue.rs` has the rule); that none is
/// forgotten does not.
#[test]
fn realtime_accounts_for_every_frame_however_fast_they_come() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    // The whole clip within twelve milliseconds.
    let done = track(&out, "frames", &["--realtime", "--rate", "1000"], Vec::new());
    let said = String::from_utf8_lossy(&done.stderr);
    let dropped: usize = column(&out, "dropped").iter().map(|d| d.parse::<usize>().unwrap()).sum();
    let numbers = column(&out, "frame");
    assert_eq!(numbers.len() + dropped, 12, "{dropped} and {numbers:?}");
    assert_eq!(numbers.last().unwrap(), "11", "the newest frame is never dropped");
    assert_eq!(said.contains(&format!("{dropped} dropped")), dropped > 0, "{said}");
    // Until the search beside has answered, a frame is lost with that reason.
    let (status, reasons) = (column(&out, "status"), column(&out, "reasons"));
    assert_eq!(status[0], "lost");
    assert!(reasons[0].contains("search"), "{reasons:?}");
}

#[test]
fn a_file_that_is_no_picture_is_one_lost_frame_and_wrong_usage_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let frames = folder.path().join("frames");
    std::fs::create_dir(&frames).unwrap();
    for (to, k) in [0, 1, 6].into_iter().enumerate() {
        std::fs::copy(clip(&format!("frames/frame_{k:03}.png")), frames.join(format!("a{to}.png")))
            .unwrap();
    }
    std::fs::write(frames.join("a1.png"), b"no picture").unwrap();
    let out = folder.path().join("out");
    let done = track(&out, frames.to_str().unwrap(), &[], Vec::new());
    assert_eq!(done.status.code(), Some(2));
    assert_eq!(column(&out, "status"), ["ok", "lost", "ok"]);
    for (input, arguments, expected) in [
        ("-", vec![], "--size"),
        ("frames", vec!["--live-vertices"], "--live-vertices"),
        ("frames", vec!["-"], "stands alone"),
        ("-", vec!["--size", "320"], "WIDTHxHEIGHT"),
    ] {
        let wrong = track(&out, input, &arguments, Vec::new());
        let said = String::from_utf8_lossy(&wrong.stderr);
        assert_eq!(wrong.status.code(), Some(64), "{said}");
        assert!(said.contains(expected), "{expected}: {said}");
    }
    // Another size than the camera's ends the run.
    let wrong = track(&out, "-", &["--size", "32x18"], vec![0; 3 * 32 * 18]);
    assert_eq!(wrong.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("[32, 18]"));
    let none = track(&out, "-", &["--input-format", "mjpeg"], Vec::new());
    // What lies there is told from results of this run.
    let said = String::from_utf8_lossy(&none.stderr);
    assert!(said.contains("no frame") && said.contains("is of an older run"), "{said}");
    assert!(none.status.code() == Some(1) && out.join("summary.csv").is_file(), "{said}");
}

#[test]
fn a_clip_goes_on_where_it_was_and_keeps_to_its_parameters() {
    let truth = dsfms::io::clip_truth::read_clip_truth(&clip("truth/clip.npz")).unwrap();
    assert_eq!(truth.frames(), 12);
    assert!(truth.visible[0].iter().filter(|v| **v).count() > 100);
    let synth = |size: &str| {
        let mut command = Command::cargo_bin("dsfms").unwrap();
        command
            .args(["synth", "--video", "--frames", "12", "--vertices", "150", "--size", size])
            .args(["--seed", "3", "--quiet", "-o"])
            .arg(clip(""));
        command
    };
    let before = std::fs::metadata(clip("frames/frame_005.png")).unwrap().modified().unwrap();
    synth("320x180").assert().success();
    let after = std::fs::metadata(clip("frames/frame_005.png")).unwrap().modified().unwrap();
    assert_eq!(before, after);
    let other = synth("160x90").output().unwrap();
    assert_eq!(other.status.code(), Some(64));
    assert!(String::from_utf8_lossy(&other.stderr).contains("another clip"));
}

#[test]
fn hidden_structures_are_carried_and_drawn_with_what_is_known_of_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let rest = read_mesh(&clip("organ.template/template.ply")).unwrap();
    let [low, high] = rest.mesh.bounding_box();
    let (middle, size) = (low + (high - low) * 0.5, (high - low).norm());
    let lump = closed(6, 9, |d| d * (0.06 * size) + middle.coords);
    let write = |name: &str, expected: Option<&[f64]>| {
        let path = folder.path().join(name);
        let extras = PlyExtras { expected_error: expected, ..Default::default() };
        write_ply(&path, &lump.topology, &lump.positions, LengthUnit::Millimetre, &extras).unwrap();
        path.to_string_lossy().into_owned()
    };
    let errors = vec![0.05 * size; lump.positions.len()];
    let (plain, told) = (write("lump.ply", None), write("told.ply", Some(&errors)));
    let picture = |name: &str, structures: &[&str]| {
        let out = folder.path().join(name);
        let arguments = [&["--stride", "11", "--overlay", "--ply"], structures].concat();
        assert!(track(&out, "frames", &arguments, Vec::new()).status.code().unwrap() != 64);
        image::open(out.join("overlay/frame_000.png")).unwrap().to_rgb8()
    };
    let (none, without) = (picture("none", &[]), picture("without", &["--structures", &plain]));
    let with = picture("with", &["--structures", &told]);
    let changed =
        |a: &image::RgbImage| a.pixels().zip(none.pixels()).filter(|(p, q)| p != q).count();
    // The halo of what is known of its place lies around it.
    assert!(changed(&without) > 50 && changed(&with) > changed(&without) + 50);
    let carried =
        read_mesh(&folder.path().join("with/structures/frame_000_told.ply")).unwrap().mesh;
    let surface = read_mesh(&folder.path().join("without/frame_000.ply")).unwrap();
    // The surface says how far it may be off, and its structure farther.
    let largest =
        |mesh: &MeshFile| mesh.attributes["expected_error"].iter().copied().fold(0.0, f64::max);
    assert!(largest(&surface) > 0.0 && surface.attributes.contains_key("observed"));
    let hidden = read_mesh(&folder.path().join("without/structures/frame_000_lump.ply")).unwrap();
    assert!(largest(&hidden) > 0.0);
    let surface = surface.mesh;
    let [low, high] = surface.bounding_box();
    let inside =
        |p: &Point3| (0..3).all(|k| p[k] > low[k] - 0.2 * size && p[k] < high[k] + 0.2 * size);
    assert!(carried.positions.iter().all(inside));
}
