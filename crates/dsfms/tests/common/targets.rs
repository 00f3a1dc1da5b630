//! Every reader of bytes that others make, by name: what `fuzz_regressions.rs` replays and mutates, and what
//! the targets in `fuzz/` run. An input is accepted or refused; what is accepted must be sound.

#![allow(dead_code)]

use dsfms::geometry::Point3;
use dsfms::io::camera::read_camera;
use dsfms::io::colmap::{read_cameras, read_images, read_points};
use dsfms::io::igtl::{HEADER, picture, read};
use dsfms::io::images::decode_bytes;
use dsfms::io::matches::read_matches;
use dsfms::io::mesh::parse_mesh;
use dsfms::io::poses::{PoseList, read_poses};
use dsfms::io::vertex_truth::read_vertex_truth;
use dsfms::pipeline::ReconstructOptions;
use dsfms::track::TrackOptions;
use dsfms::track::shapes::read_shapes;
use dsfms::video::count_frames;
use dsfms::video::mjpeg::Pictures;
use std::path::{Path, PathBuf};

/// A reader: whether it accepted the bytes.
pub type Target = fn(&[u8]) -> bool;

/// Name (and folder of the corpus), extensions, reader.
pub const TARGETS: [(&str, &[&str], Target); 13] = [
    ("ply", &["ply"], |b| mesh(b, "a.ply")),
    ("obj", &["obj"], |b| mesh(b, "a.obj")),
    ("stl", &["stl"], |b| mesh(b, "a.stl")),
    ("gltf", &["gltf", "glb"], |b| mesh(b, "a.gltf")),
    ("camera", &["json", "yaml", "txt"], camera),
    ("poses", &["json", "txt"], poses),
    ("matches", &["csv"], matches),
    ("image", &["png", "jpg", "tif"], |b| decode_bytes(b).is_ok()),
    ("mp4", &["mp4"], |b| count_frames(b).is_ok()),
    ("mjpeg", &["jpg"], mjpeg),
    ("npz", &["npz"], npz),
    ("options", &["toml"], options),
    ("igtl", &["igtl"], igtl),
];

fn mesh(bytes: &[u8], name: &str) -> bool {
    let finite = |p: &Point3| p.iter().all(|c| c.is_finite());
    parse_mesh(bytes, Path::new(name)).is_ok_and(|file| {
        assert!(file.mesh.positions.iter().all(finite));
        true
    })
}

/// A stream of OpenIGTLink.
fn igtl(bytes: &[u8]) -> bool {
    let sound = |content: &[u8]| {
        picture(content).is_ok_and(|(size, rgb)| {
            assert_eq!(size[0] * size[1], rgb.len());
            true
        })
    };
    let (mut stream, mut accepted) = (bytes, false);
    loop {
        match read(&mut stream, |header| header.kind == "IMAGE") {
            Ok(Some(message)) => accepted |= sound(&message.content),
            Err(error) if !error.fatal() => {}
            _ => break,
        }
    }
    // The checksum of a mutant is hardly ever right; its content is read all the same.
    bytes.get(HEADER..).is_some_and(sound) || accepted
}

/// A file of its own for the readers that take a path.
fn file(bytes: &[u8], name: &str) -> PathBuf {
    thread_local!(static FOLDER: tempfile::TempDir = tempfile::tempdir().unwrap());
    let path = FOLDER.with(|folder| folder.path().join(name));
    std::fs::write(&path, bytes).unwrap();
    path
}

fn camera(bytes: &[u8]) -> bool {
    let mut accepted = false;
    for name in ["c.json", "c.yaml", "cameras.txt", "cameras.bin"] {
        if let Ok(found) = read_camera(&file(bytes, name)) {
            found.camera.validate().expect("an accepted camera is one");
            accepted = true;
        }
        accepted |= read_cameras(&file(bytes, name)).is_ok();
    }
    accepted
}

fn poses(bytes: &[u8]) -> bool {
    let mut accepted = false;
    for name in ["p.json", "images.txt", "images.bin"] {
        for pose in read_poses(&file(bytes, name), PoseList::Exploration).unwrap_or_default() {
            assert!(pose.camera_from_world.to_homogeneous().iter().all(|v| v.is_finite()));
            accepted = true;
        }
        accepted |= read_images(&file(bytes, name)).is_ok();
    }
    accepted
        | read_points(&file(bytes, "points3D.txt")).is_ok()
        | read_points(&file(bytes, "points3D.bin")).is_ok()
}

fn matches(bytes: &[u8]) -> bool {
    read_matches(&file(bytes, "m.csv"), 100, [640, 480]).is_ok_and(|found| {
        assert!(found.iter().all(|m| m.pixel.iter().chain(&m.barycentric).all(|v| v.is_finite())));
        true
    })
}

fn mjpeg(bytes: &[u8]) -> bool {
    let mut pictures = Pictures::new(bytes);
    let mut whole = false;
    while let Some(picture) = pictures.next().unwrap() {
        whole |= picture.is_ok_and(|bytes| decode_bytes(&bytes).is_ok());
    }
    whole
}

fn npz(bytes: &[u8]) -> bool {
    let path = file(bytes, "a.npz");
    read_shapes(&path).is_ok() | read_vertex_truth(&path).is_ok()
}

fn options(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    ReconstructOptions::from_toml(text).is_ok() | TrackOptions::from_toml(text).is_ok()
}
