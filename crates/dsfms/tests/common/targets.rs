//! Every reader of bytes that others make, by name: what `fuzz_regressions.rs` replays and mutates,
//! and what the targets in `fuzz/` run. An input is accepted or refused; what is accepted must be
//! sound.

#![allow(dead_code, reason = "no test file needs all of it")]

#[path = "mp4.rs"]
pub mod mp4;

use dsfms::geometry::{Isometry, Point2, Point3};
use dsfms::image::Frame;
use dsfms::io::camera::read_camera;
use dsfms::io::clip_truth::{ClipTruth, read_clip_truth, write_clip_truth};
use dsfms::io::colmap::{read_cameras, read_images, read_points};
use dsfms::io::igtl::{HEADER, picture, read};
use dsfms::io::images::decode_bytes;
use dsfms::io::landmarks::{Axes, MarkPlace, read_pairs, read_points as read_landmarks};
use dsfms::io::masks::read_mask;
use dsfms::io::matches::read_matches;
use dsfms::io::mesh::parse_mesh;
use dsfms::io::nifti::read_nifti_from;
use dsfms::io::poses::{PoseList, read_poses};
use dsfms::io::vertex_truth::read_vertex_truth;
use dsfms::pipeline::{OrganScene, ReconstructOptions, TemplateOptions, strokes_from};
use dsfms::template::Features;
use dsfms::track::TrackOptions;
use dsfms::track::shapes::read_shapes;
use dsfms::video::count_frames;
use dsfms::video::mjpeg::Pictures;
use dsfms::{Template, read_template, write_template};
use rawzip::{CompressionMethod, ZipArchive, ZipArchiveWriter};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// A reader: whether it accepted the bytes.
pub type Target = fn(&[u8]) -> bool;

/// Name (and folder of the corpus), extensions, reader.
pub const TARGETS: [(&str, &[&str], Target); 24] = [
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
    ("landmarks", &["csv", "json", "fcsv", "pp"], landmarks),
    ("truth", &["npz", "npy"], truth),
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

/// Pairs, and points in either axes, by every name that says the format.
fn landmarks(bytes: &[u8]) -> bool {
    let sound = |place: &MarkPlace| match place {
        MarkPlace::Point(p) => assert!(p.iter().all(|v| v.is_finite())),
        MarkPlace::Vertex(_) => {}
    };
    let mut accepted = false;
    for name in ["l.csv", "l.json", "l.fcsv", "l.pp"] {
        let path = file(bytes, name);
        for pair in read_pairs(&path).unwrap_or_default() {
            [pair.ct, pair.template].iter().for_each(sound);
            accepted = true;
        }
        for axes in [Axes::Lps, Axes::Ras] {
            for mark in read_landmarks(&path, axes).unwrap_or_default() {
                sound(&mark.place);
                accepted = true;
            }
        }
    }
    accepted
}

/// What the files of a truth begin with.
const NUMPY: &[u8] = b"\x93NUMPY";
/// Arrays of the truth of a clip, in the order in which they follow each other where they are in no
/// archive.
const TRUTHS: [&str; 4] = ["vertices", "displacement", "visible", "zone"];

/// The truth of a clip or of a frame: an npz, or its arrays one behind the other, which get an
/// archive with the checksums that a mutant hardly ever has.
fn truth(bytes: &[u8]) -> bool {
    let path = match bytes.starts_with(b"PK") {
        true => file(bytes, "t.npz"),
        false => file(&archive(TRUTHS.into_iter().zip(arrays(bytes))), "t.npz"),
    };
    let of_frame = read_vertex_truth(&path).is_ok_and(|truth| {
        assert!(truth.displacement.iter().all(|v| v.is_finite()));
        true
    });
    of_frame
        | read_clip_truth(&path).is_ok_and(|truth| {
            let count = truth.frames();
            assert_eq!(
                [truth.displacement.len(), truth.visible.len(), truth.zone.len()],
                [count; 3]
            );
            let numbers = truth.vertices.iter().flatten().flatten();
            assert!(numbers.chain(truth.displacement.iter().flatten()).all(|v| v.is_finite()));
            true
        })
}

/// Files of NumPy one behind the other.
fn arrays(bytes: &[u8]) -> Vec<&[u8]> {
    let starts: Vec<usize> = (0..bytes.len()).filter(|&k| bytes[k..].starts_with(NUMPY)).collect();
    let end = |k: usize| starts.get(k + 1).copied().unwrap_or(bytes.len());
    starts.iter().enumerate().map(|(k, &start)| &bytes[start..end(k)]).collect()
}

/// An npz of arrays as they are.
fn archive<'a>(arrays: impl Iterator<Item = (&'a str, &'a [u8])>) -> Vec<u8> {
    let mut zip = ZipArchiveWriter::new(Vec::new());
    for (name, bytes) in arrays {
        let (mut entry, config) = zip.new_file(format!("{name}.npy")).start().unwrap();
        let mut out = config.wrap(&mut entry);
        out.write_all(bytes).unwrap();
        let (_, sums) = out.finish().unwrap();
        entry.finish(sums).unwrap();
    }
    zip.finish().unwrap()
}

/// Names, without their ending, and contents of an npz.
fn unpacked(npz: &[u8]) -> Vec<(String, Vec<u8>)> {
    let zip = ZipArchive::from_slice(npz).unwrap();
    let mut entries = zip.entries();
    let mut arrays = Vec::new();
    while let Some(file) = entries.next_entry().unwrap() {
        let data = zip.get_entry(file.wayfinder()).unwrap().data();
        let mut bytes = Vec::new();
        match file.compression_method() {
            CompressionMethod::STORE => bytes.extend(data),
            _ => _ = flate2::bufread::DeflateDecoder::new(data).read_to_end(&mut bytes).unwrap(),
        }
        let name = String::from_utf8(file.file_path().as_bytes().to_vec()).unwrap();
        arrays.push((name.trim_end_matches(".npy").to_owned(), bytes));
    }
    arrays
}

/// The truth of two frames of a face, as an npz and as its arrays.
pub fn small_truth() -> [Vec<u8>; 2] {
    let mut truth = ClipTruth::default();
    for k in [0.0, 1.0] {
        let points = [[0.0, 0.0, 50.0 + k], [9.0, 0.0, 50.0], [0.0, 9.0, 51.5]].map(Point3::from);
        truth.push(&points, &[k, 0.0, 0.5 * k], &[true, true, false], &[k > 0.0, false, false]);
    }
    let path = file(&[], "small.npz");
    write_clip_truth(&path, &truth).unwrap();
    let npz = std::fs::read(path).unwrap();
    let parts = unpacked(&npz);
    let of = |name: &str| parts.iter().find(|(n, _)| n == name).unwrap().1.clone();
    let arrays = TRUTHS.map(of).concat();
    [npz, arrays]
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

/// A stream of H.264 with start codes (Annex B), decoded as the pictures of an mp4; some picture
/// came out.
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
const PARTS: [&str; 12] = [
    "template.toml",
    "template.ply",
    "albedo.npz",
    "features.npz",
    "flattening.npz",
    "seen.npz",
    "sigma.npz",
    "usual.toml",
    "surroundings.ply",
    "surrounding_features.npz",
    "sparse/images.txt",
    "sparse/points3D.txt",
];

/// A template one of whose files is replaced: its name on a line of its own, then its bytes; or one
/// array of a file (`albedo.npz/value`).
fn template(bytes: &[u8]) -> bool {
    thread_local!(static FOLDER: tempfile::TempDir = {
        let folder = tempfile::tempdir().unwrap();
        write_template(&folder.path().join("t"), &small_template()).unwrap();
        folder
    });
    let end = bytes.iter().position(|&b| b == b'\n').unwrap_or(bytes.len());
    let (line, content) = bytes.split_at(end);
    let content = content.get(1..).unwrap_or_default();
    let named = |part: &&&str| line.starts_with(part.as_bytes());
    let Some(name) = PARTS.iter().find(named) else { return false };
    FOLDER.with(|folder| {
        let path = folder.path().join("t");
        let good = std::fs::read(path.join(name)).unwrap();
        let changed = match line[name.len()..].strip_prefix(b"/") {
            Some(array) => with_array(&good, array, content),
            None => content.to_vec(),
        };
        std::fs::write(path.join(name), changed).unwrap();
        let found = read_template(&path);
        std::fs::write(path.join(name), good).unwrap();
        found.is_ok_and(|template| {
            assert_sound(&template);
            true
        })
    })
}

/// An npz with other content of one array, the checksums being right.
fn with_array(npz: &[u8], array: &[u8], content: &[u8]) -> Vec<u8> {
    let mut parts = unpacked(npz);
    if let Some(part) = parts.iter_mut().find(|(name, _)| name.as_bytes() == array) {
        part.1 = content.to_vec();
    }
    archive(parts.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())))
}

/// What was read can be worked with: every number is one, and every index of something.
fn assert_sound(t: &Template) {
    let finite = |p: &Point3| p.iter().all(|c| c.is_finite());
    let (vertices, faces) = (t.mesh.positions.len(), t.mesh.topology.faces.len());
    assert!(t.mesh.positions.iter().all(finite));
    assert!(t.seen.is_empty() || t.seen.len() == vertices);
    assert!(t.sigma.iter().all(|s| *s >= 0.0));
    assert!(t.tone.table().iter().all(|v| v.is_finite()));
    assert!(t.views.iter().all(|view| {
        let pose = view.camera_from_template;
        (pose.rotation.quaternion().norm() - 1.0).abs() < 1e-5
            && pose.translation.vector.iter().all(|v| v.is_finite())
            && view.gain.is_finite()
    }));
    assert!(t.points.iter().all(|p| {
        finite(&p.position) && p.sightings.iter().all(|s| (s.0 as usize) < t.views.len())
    }));
    let features = |f: &Features, faces: usize| {
        assert!(f.faces.iter().all(|&f| (f as usize) < faces));
        assert!(f.barycentrics.as_flattened().iter().all(|b| b.is_finite()));
        assert_eq!([f.faces.len(), f.barycentrics.len()], [f.descriptors.len(); 2]);
    };
    if let Some(albedo) = &t.albedo {
        assert_eq!(albedo.resolution.len(), faces);
        assert!(albedo.value.as_flattened().iter().all(|v| v.is_finite()));
        let count = albedo.offset[faces] as usize;
        assert_eq!([albedo.spread.len(), albedo.views.len()], [count; 2]);
        assert_eq!(albedo.value.len(), count);
    }
    if let Some(own) = &t.features {
        features(own, faces);
    }
    if let Some(map) = &t.flattening {
        assert_eq!(map.corners.len(), faces);
        assert!(map.corners.as_flattened().iter().all(|p| p.iter().all(|v| v.is_finite())));
    }
    if let Some(around) = &t.surroundings {
        assert!(around.mesh.positions.iter().all(finite));
        features(&around.features, around.mesh.topology.faces.len());
    }
}

/// With every file that a template may have.
pub fn small_template() -> Template {
    use dsfms::template::flatten::{FlattenOptions, flatten};
    use dsfms::template::usual::{Appearance, Usual};
    use dsfms::template::{SparsePoint, SurfaceTexels, Surroundings, TemplateView};
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
    let features = Features {
        descriptors: vec![[7; 128]; 2],
        faces: vec![3, 5],
        barycentrics: vec![[0.1, 0.2, 0.7], [0.5, 0.25, 0.25]],
    };
    let pose = Isometry::translation(0.0, 0.0, 75.0);
    let view = |k: u32| TemplateView {
        name: format!("frame_{k:03}.png"),
        camera_from_template: pose,
        gain: 1.0 + 0.125 * f64::from(k),
        reprojection_px: 0.25,
    };
    let sightings = vec![(0, Point2::new(12.5, 40.0)), (1, Point2::new(13.5, 41.0))];
    let position = Point3::new(1.0, 2.0, 0.5);
    Template {
        sigma: vec![0.1; mesh.positions.len()],
        seen: vec![2; mesh.positions.len()],
        flattening: flatten(&mesh, &FlattenOptions::default()).ok(),
        albedo: SurfaceTexels::from_vertex_values(&mesh, &values, resolution).ok(),
        surroundings: Some(Surroundings { mesh: mesh.clone(), features: features.clone() }),
        features: Some(features),
        usual: Some(Usual { frames: 12, appearance, depth: [40.0, 90.0] }),
        views: vec![view(0), view(1)],
        points: vec![SparsePoint { position, rgb: [180, 90, 70], error_px: 0.5, sightings }],
        mesh,
        ..dsfms::synth::Case::example(1).template
    }
}

/// The files of [`small_template`] as the target takes them, and the arrays in them.
pub fn template_parts() -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t");
    write_template(&path, &small_template()).unwrap();
    let one = |name: &str, content: &[u8]| {
        (name.replace('/', "_"), [name.as_bytes(), b"\n", content].concat())
    };
    let mut parts = Vec::new();
    for name in PARTS {
        let content = std::fs::read(path.join(name)).unwrap();
        parts.push(one(name, &content));
        if name.ends_with(".npz") {
            let arrays = unpacked(&content);
            parts
                .extend(arrays.iter().map(|(array, bytes)| one(&format!("{name}/{array}"), bytes)));
        }
    }
    parts
}
