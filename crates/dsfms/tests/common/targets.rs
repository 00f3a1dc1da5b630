//! Every reader of bytes that others make, by name: what `fuzz_regressions.rs` replays and mutates, and what
//! the targets in `fuzz/` run. An input is accepted or refused; what is accepted must be sound.

#![allow(dead_code)]

#[path = "mp4.rs"]
pub mod mp4;

use dsfms::geometry::Point3;
use dsfms::image::Frame;
use dsfms::io::camera::read_camera;
use dsfms::io::colmap::{read_cameras, read_images, read_points};
use dsfms::io::igtl::{HEADER, picture, read};
use dsfms::io::images::decode_bytes;
use dsfms::io::masks::read_mask;
use dsfms::io::matches::read_matches;
use dsfms::io::mesh::parse_mesh;
use dsfms::io::nifti::read_nifti_from;
use dsfms::io::poses::{PoseList, read_poses};
use dsfms::io::vertex_truth::read_vertex_truth;
use dsfms::pipeline::{OrganScene, ReconstructOptions, TemplateOptions, strokes_from};
use dsfms::track::TrackOptions;
use dsfms::track::shapes::read_shapes;
use dsfms::video::count_frames;
use dsfms::video::mjpeg::Pictures;
use dsfms::{Template, read_template, write_template};
use std::path::{Path, PathBuf};

/// A reader: whether it accepted the bytes.
pub type Target = fn(&[u8]) -> bool;

/// Name (and folder of the corpus), extensions, reader.
pub const TARGETS: [(&str, &[&str], Target); 22] = [
    ("ply", &["ply"], |b| mesh(b, "a.ply")),
    ("obj", &["obj"], |b| mesh(b, "a.obj")),
    ("stl", &["stl"], |b| mesh(b, "a.stl")),
    ("off", &["off"], |b| mesh(b, "a.off")),
    ("vtk", &["vtk"], |b| mesh(b, "a.vtk")),
    ("vtp", &["vtp"], |b| mesh(b, "a.vtp")),
    ("gltf", &["gltf", "glb"], |b| mesh(b, "a.gltf")),
    ("camera", &["json", "yaml", "txt"], camera),
    ("poses", &["json", "txt"], poses),
    ("matches", &["csv"], matches),
    ("image", &["png", "jpg", "tif"], |b| decode_bytes(b).is_ok()),
    ("mask", &["png", "tif"], |b| read_mask(&file(b, "m.png")).is_ok()),
    ("mp4", &["mp4"], |b| count_frames(b).is_ok()),
    ("h264", &["h264"], h264),
    ("mjpeg", &["jpg"], mjpeg),
    ("npz", &["npz"], npz),
    ("template", &["part"], template),
    ("options", &["toml"], options),
    ("igtl", &["igtl"], igtl),
    ("strokes", &["json"], strokes),
    ("scene", &["scene"], scene),
    ("nifti", &["nii", "gz"], nifti),
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
    ReconstructOptions::from_toml(text).is_ok()
        | TrackOptions::from_toml(text).is_ok()
        | TemplateOptions::from_toml(text).is_ok()
}

fn strokes(bytes: &[u8]) -> bool {
    let text = std::str::from_utf8(bytes).unwrap_or_default();
    strokes_from(text).is_ok_and(|found| {
        assert!(found.iter().flat_map(|s| &s.px).all(|p| p.iter().all(|v| v.is_finite())));
        true
    })
}

/// By what an organ was told, behind the head of its file; what is accepted can be parted.
fn scene(bytes: &[u8]) -> bool {
    OrganScene::of_value(bytes).is_ok_and(|scene| {
        let [w, h] = scene.size();
        if w.saturating_mul(h) < 10_000 && scene.names().count() < 8 {
            let frame =
                |name: &str| Frame { name: name.into(), size: [w, h], rgb: vec![[90; 3]; w * h] };
            let frames: Vec<Frame> = scene.names().map(frame).collect();
            let _ = scene.part(&frames, scene.strokes());
        }
        true
    })
}

/// A stream of H.264 with start codes (Annex B), decoded as the pictures of an mp4; some picture came out.
fn h264(bytes: &[u8]) -> bool {
    count_frames(&mp4::of_annex_b([48, 32], bytes)).is_ok_and(|[shown, _]| shown > 0)
}

/// A volume, packed or not.
fn nifti(bytes: &[u8]) -> bool {
    read_nifti_from(bytes, Path::new("a.nii")).is_ok_and(|file| {
        let (grid, kind) = (file.volume.grid(), file.volume.kind());
        assert_eq!(file.volume.bytes().len(), grid.count() * kind.bytes());
        assert!(grid.world_from_voxel().matrix().iter().all(|v| v.is_finite()));
        assert!(file.background().is_finite());
        true
    })
}

/// Files of a template that may be damaged.
const PARTS: [&str; 7] = [
    "template.toml",
    "template.ply",
    "albedo.npz",
    "features.npz",
    "flattening.npz",
    "sigma.npz",
    "usual.toml",
];

/// A template one of whose files is replaced: its name on a line of its own, then its bytes.
fn template(bytes: &[u8]) -> bool {
    thread_local!(static FOLDER: tempfile::TempDir = {
        let folder = tempfile::tempdir().unwrap();
        write_template(&folder.path().join("t"), &small_template()).unwrap();
        folder
    });
    let end = bytes.iter().position(|&b| b == b'\n').unwrap_or(bytes.len());
    let (name, content) = bytes.split_at(end);
    let Some(name) = PARTS.iter().find(|part| part.as_bytes() == name) else { return false };
    FOLDER.with(|folder| {
        let path = folder.path().join("t");
        let good = std::fs::read(path.join(name)).ok();
        std::fs::write(path.join(name), content.get(1..).unwrap_or_default()).unwrap();
        let found = read_template(&path);
        match good {
            Some(good) => std::fs::write(path.join(name), good).unwrap(),
            None => std::fs::remove_file(path.join(name)).unwrap(),
        }
        found.is_ok_and(|t| {
            assert!(t.mesh.positions.iter().all(|p| p.iter().all(|c| c.is_finite())));
            let faces = t.mesh.topology.faces.len();
            assert!(t.albedo.is_none_or(|a| a.resolution.len() == faces));
            assert!(t.features.is_none_or(|f| f.faces.iter().all(|&f| (f as usize) < faces)));
            assert!(t.flattening.is_none_or(|f| f.corners.len() == faces));
            true
        })
    })
}

/// With every file that a template may have but those of its views.
pub fn small_template() -> Template {
    use dsfms::template::flatten::{FlattenOptions, flatten};
    use dsfms::template::usual::{Appearance, Usual};
    use dsfms::template::{Features, SurfaceTexels};
    let mesh = dsfms::synth::patch(16, 1).mesh;
    let values = vec![[0.4, 0.3, 0.2]; mesh.positions.len()];
    let resolution = vec![2; mesh.topology.faces.len()];
    let appearance = Appearance {
        correlation: Some(0.9),
        contrast: Some(0.8),
        residual: 0.03,
        shown: 0.98,
        compared: 0.8,
    };
    Template {
        sigma: vec![0.1; mesh.positions.len()],
        flattening: flatten(&mesh, &FlattenOptions::default()).ok(),
        albedo: SurfaceTexels::from_vertex_values(&mesh, &values, resolution).ok(),
        features: Some(Features {
            descriptors: vec![[7; 128]; 2],
            faces: vec![3, 5],
            barycentrics: vec![[0.1, 0.2, 0.7], [0.5, 0.25, 0.25]],
        }),
        usual: Some(Usual { frames: 12, appearance, depth: [40.0, 90.0] }),
        mesh,
        ..dsfms::synth::Case::example(1).template
    }
}

/// The files of [`small_template`] as the target takes them.
pub fn template_parts() -> Vec<(&'static str, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t");
    write_template(&path, &small_template()).unwrap();
    let part = |name: &&'static str| {
        let content = std::fs::read(path.join(name)).unwrap();
        (*name, [name.as_bytes(), b"\n", &content].concat())
    };
    PARTS.iter().map(part).collect()
}
