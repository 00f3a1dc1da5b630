//! Templates from frames alone through the binary: a textured disc before a textured wall.

mod common;

use assert_cmd::Command;
use dsfms::camera::{Camera, CameraModel};
use dsfms::geometry::{Isometry, Point2, Point3, Vector3};
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::io::mesh::{MeshUnit, read_mesh};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::mesh::Topology;
use dsfms::pipeline::{OrganScene, read_strokes};
use dsfms::template::LengthUnit;
use dsfms::{find_frames, read_frames};
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

const SIZE: [usize; 2] = [240, 180];

fn camera() -> CameraModel {
    CameraModel::pinhole(SIZE, [260.0; 2], [119.5, 89.5])
}

/// `camera_from_world`, all looking at the disc.
fn poses() -> Vec<Isometry> {
    let pose = |i: i32| {
        let (x, y) = (f64::from(i % 3 - 1), f64::from(i / 3) - 0.5);
        let eye = Point3::new(9.0 * x, 8.0 * y, 0.0);
        Isometry::look_at_rh(&eye, &Point3::new(0.0, 0.0, 48.0), &-Vector3::y())
    };
    // From z backwards, y up to z forwards, y down.
    let turn = Isometry::rotation(Vector3::x() * std::f64::consts::PI);
    (0..6).map(|i| turn * pose(i)).collect()
}

/// Depth of the disc: a shallow bowl with bumps.
fn disc(x: f64, y: f64) -> f64 {
    44.0 + 0.03 * (x * x + y * y) + 0.6 * (0.5 * x + 1.0).sin() * (0.4 * y).cos() + 0.05 * x
}

const RADIUS: f64 = 11.0;

fn wall(x: f64, y: f64) -> f64 {
    66.0 + 1.5 * (0.15 * x).sin() * (0.2 * y).cos()
}

/// Smooth noise of lattice values.
fn noise(x: f64, y: f64, seed: u64) -> f64 {
    let value = |i: f64, j: f64| {
        let mut h = (i as i64 as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
            ^ (j as i64 as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
            ^ seed.wrapping_mul(0x1656_67b1_9e37_79f9);
        h ^= h >> 29;
        h = h.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((h ^ (h >> 32)) & 0xffff) as f64 / 65535.0 - 0.5
    };
    let (i, j) = (x.floor(), y.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v) = (smooth(x - i), smooth(y - j));
    let row = |j: f64| (1.0 - u) * value(i, j) + u * value(i + 1.0, j);
    (1.0 - v) * row(j) + v * row(j + 1.0)
}

fn texture(x: f64, y: f64, seed: u64) -> f64 {
    0.45 + 0.4 * noise(0.5 * x, 0.5 * y, seed) + 0.3 * noise(1.3 * x, 1.3 * y, seed + 1)
}

/// Where a ray meets a height field.
fn meet(eye: &Point3, ray: &Vector3, height: impl Fn(f64, f64) -> f64) -> Point3 {
    let mut hit = eye + ray * ((50.0 - eye.z) / ray.z);
    for _ in 0..12 {
        hit = eye + ray * ((height(hit.x, hit.y) - eye.z) / ray.z);
    }
    hit
}

fn grey(pose: &Isometry, pixel: usize) -> f64 {
    let at = Point2::new((pixel % SIZE[0]) as f64, (pixel / SIZE[0]) as f64);
    let ray = pose.rotation.inverse() * camera().unproject(&at).unwrap();
    let eye = pose.inverse_transform_point(&Point3::origin());
    let front = meet(&eye, &ray, disc);
    if front.x.hypot(front.y) < RADIUS {
        return texture(front.x, front.y, 3);
    }
    let behind = meet(&eye, &ray, wall);
    texture(0.7 * behind.x, 0.7 * behind.y, 11)
}

struct Frames {
    folder: TempDir,
}

impl Frames {
    fn new() -> Self {
        let frames = Self { folder: tempfile::tempdir().unwrap() };
        fs::create_dir(frames.path("frames")).unwrap();
        for (i, pose) in poses().iter().enumerate() {
            let value = |p: usize| [(255.0 * grey(pose, p).clamp(0.0, 0.95)) as u8; 3];
            common::save(&frames.path(&format!("frames/f_{i}.png")), SIZE, value);
        }
        let file = CameraFile { camera: camera(), tone: None, light: None, vignetting: None };
        write_camera(&frames.path("camera.json"), &file).unwrap();
        frames
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn template(&self, arguments: &[&str], threads: &str, output: &str) {
        self.dsfms(&["template", "frames", "--camera", "camera.json", "--no-report", "--quiet"])
            .args(["--vertices", "300", "-o", output])
            .args(arguments)
            .env("RAYON_NUM_THREADS", threads)
            .assert()
            .success();
    }

    fn dsfms(&self, arguments: &[&str]) -> Command {
        let mut command = Command::cargo_bin("dsfms").unwrap();
        command.current_dir(self.folder.path()).args(arguments);
        command
    }

    /// Vertices in the axes of the first frame, over their mean depth.
    fn shape(&self, template: &str) -> Vec<Vector3> {
        let mesh = read_mesh(&self.path(&format!("{template}/template.ply"))).unwrap().mesh;
        let depth = mesh.positions.iter().map(|p| p.z).sum::<f64>() / mesh.positions.len() as f64;
        mesh.positions.iter().map(|p| p.coords / depth).collect()
    }

    /// What the template keeps of its organ gives, with its strokes and the frames, the masks that
    /// it was built with.
    fn assert_drawn(&self, template: &str) {
        let scene = OrganScene::read(&self.path(&format!("{template}/organ.scene"))).unwrap();
        let strokes = self.path(&format!("{template}/organ_scribbles.json"));
        let strokes = read_strokes(&strokes).unwrap();
        assert_eq!((strokes.len(), scene.strokes()), (3, &strokes[..]));
        let pictures = read_frames(&find_frames(&[self.path("frames")]).unwrap()).unwrap();
        assert!(scene.names().eq(pictures.iter().map(|picture| picture.name.as_str())));
        let part = scene.part(&pictures, &strokes).unwrap();
        assert!(part.masks.len() >= 5);
        for (name, mask) in &part.masks {
            let kept = self.path(&format!("{template}/organ_masks/{name}.png"));
            let kept = image::open(kept).unwrap().to_luma8();
            assert!(kept.pixels().map(|p| p.0[0] > 127).eq(mask.data.iter().copied()), "{name}");
        }
        let first = image::load_from_memory(scene.photo(0).unwrap()).unwrap();
        assert_eq!([first.width(), first.height()], SIZE.map(|n| n as u32));
    }

    fn assert_disc(&self, template: &str) {
        let shape = self.shape(template);
        let middle = shape.iter().sum::<Vector3>() / shape.len() as f64;
        let radius = shape.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
        // 11 of 46, less a rim; the wall is seen half as wide again.
        assert!((0.18..0.28).contains(&radius), "{template}: radius {radius}");
    }
}

#[test]
fn the_organ_by_click_has_the_same_bits_at_any_number_of_threads() {
    let frames = Frames::new();
    let click = ["--organ-click", "120,90@f_4"];
    frames.template(&click, "1", "one");
    frames.template(&click, "2", "two");
    frames.assert_disc("one");
    let atlas = image::open(frames.path("one/pictures/atlas.png")).unwrap().to_rgb8();
    let colours: std::collections::BTreeSet<_> = atlas.pixels().map(|p| p.0).collect();
    assert!(atlas.dimensions() == (2048, 2048) && colours.len() > 100, "{}", colours.len());
    for file in [
        "template.ply",
        "template.toml",
        "albedo.npz",
        "features.npz",
        "flattening.npz",
        "sigma.npz",
        "precision.json",
    ] {
        let [one, two] = ["one", "two"].map(|t| fs::read(frames.path(&format!("{t}/{file}"))));
        assert!(one.unwrap() == two.unwrap(), "{file} differs");
    }
    frames
        .dsfms(&[
            "export", "one", "--colmap", "sparse", "--mesh", "o.obj", "--mesh", "o.glb", "--mesh",
            "o.ply",
        ])
        .assert()
        .success();
    let exported = fs::read(frames.path("o.ply")).unwrap();
    let header = String::from_utf8_lossy(&exported[..400]).into_owned();
    assert!(header.contains("property float expected_error"), "{header}");
    let sparse = fs::read_to_string(frames.path("sparse/images.txt")).unwrap();
    assert!(sparse.contains("f_0") && sparse.contains("f_5"), "{sparse:.300}");
    let [ply, obj] = ["one/template.ply", "o.obj"]
        .map(|f| read_mesh(&frames.path(f)).unwrap().mesh.positions.len());
    assert_eq!(ply, obj);
}

#[test]
fn the_organ_by_polygon_takes_its_scale_from_a_metric_mesh() {
    let frames = Frames::new();
    // The disc with a margin, on a grid of 0.5 mm, moved and turned.
    let n = 53u32;
    let at = |i: u32| f64::from(i) * 0.5 - 13.0;
    let moved = Isometry::new(Vector3::new(80.0, -3.0, 9.0), Vector3::new(0.5, 1.0, -0.7));
    let place = |k: u32| (at(k % n), at(k / n));
    let positions: Vec<Point3> =
        (0..n * n).map(place).map(|(x, y)| moved * Point3::new(x, y, disc(x, y))).collect();
    let inside = |k: &u32| place(*k).0.hypot(place(*k).1) < 12.0;
    let faces = (0..(n - 1) * (n - 1))
        .map(|c| c / (n - 1) * n + c % (n - 1))
        .filter(inside)
        .flat_map(|k| [[k, k + n, k + 1], [k + 1, k + n, k + n + 1]]);
    let topology = Topology::new(positions.len(), faces.collect()).unwrap();
    let (path, unit) = (frames.path("organ.ply"), LengthUnit::Millimetre);
    write_ply(&path, &topology, &positions, unit, &PlyExtras::default()).unwrap();
    let pose = poses()[4];
    let corners: Vec<String> = (0..24)
        .map(|k| f64::from(k) / 24.0 * std::f64::consts::TAU)
        .map(|a| (RADIUS * a.cos(), RADIUS * a.sin()))
        .map(|(x, y)| camera().project(&(pose * Point3::new(x, y, disc(x, y)))).unwrap().pixel)
        .map(|p| format!("{:.1},{:.1}", p.x, p.y))
        .collect();
    let polygon = format!("f_4:{}", corners.join(","));
    let arguments = ["--organ-polygon", &polygon, "--scale-mesh", "organ.ply"];
    frames.template(&arguments, "2", "organ");
    frames.assert_disc("organ");
    let file = read_mesh(&frames.path("organ/template.ply")).unwrap();
    assert_eq!(file.unit, Some(MeshUnit::Millimetre));
    let precision = fs::read(frames.path("organ/precision.json")).unwrap();
    let precision: serde_json::Value = serde_json::from_slice(&precision).unwrap();
    assert_eq!(precision["unit"], "millimetre");
    let centre = |f: &serde_json::Value| f["centre"].as_f64().unwrap();
    let centres: Vec<f64> = precision["frames"].as_array().unwrap().iter().map(centre).collect();
    assert!(centres.len() == 6 && centres.iter().all(|c| *c > 0.0 && *c < 1.0), "{centres:?}");
    let n = file.mesh.positions.len() as f64;
    let depth = file.mesh.positions.iter().map(|p| p.coords.norm()).sum::<f64>() / n;
    let eye = poses()[0].inverse_transform_point(&Point3::origin());
    let true_depth = (Point3::new(0.0, 0.0, 46.0) - eye).norm();
    assert!((depth / true_depth - 1.0).abs() < 0.05, "{depth} mm, {true_depth} expected");
}

#[test]
fn known_poses_without_a_mesh_keep_their_world_and_nothing_is_left_to_guess() {
    let frames = Frames::new();
    let pose = |(i, pose): (usize, &Isometry)| {
        let (r, t) = (pose.rotation.to_rotation_matrix(), pose.translation.vector);
        let rows: Vec<Vec<f64>> =
            (0..3).map(|i| r.matrix().row(i).iter().copied().collect()).collect();
        serde_json::json!({ "image": format!("f_{i}.png"), "R": rows, "t": [t.x, t.y, t.z] })
    };
    let list: Vec<_> = poses().iter().enumerate().map(pose).collect();
    fs::write(frames.path("poses.json"), serde_json::Value::from(list).to_string()).unwrap();
    let arguments = ["--poses", "poses.json", "--organ-click", "120,90@f_4"];
    frames.template(&[&arguments[..], &["--albedo-rule", "minimum"]].concat(), "2", "known");
    let mesh = read_mesh(&frames.path("known/template.ply")).unwrap().mesh;
    let mut misses: Vec<f64> =
        mesh.positions.iter().map(|p| (p.z - disc(p.x, p.y)).abs()).collect();
    misses.sort_by(f64::total_cmp);
    // A pixel is 0.17 units on the disc.
    assert!(misses[misses.len() / 2] < 0.2, "median {}", misses[misses.len() / 2]);
    let shown = frames
        .dsfms(&["template", "frames", "--poses", "poses.json", "--camera", "camera.json"])
        .args(["--self-calibrate", "-o", "t"])
        .assert()
        .failure();
    assert!(String::from_utf8_lossy(&shown.get_output().stderr).contains("--poses"));
}

#[test]
fn with_nothing_said_the_organ_is_what_the_frames_look_at_and_its_masks_are_shown() {
    let frames = Frames::new();
    frames.template(&[], "2", "t");
    let mask = image::open(frames.path("t/organ_masks/f_4.png")).unwrap().to_luma8();
    let [w, h] = SIZE.map(|n| n as u32);
    assert_eq!(mask.dimensions(), (w, h));
    assert_eq!([mask.get_pixel(w / 2, h / 2).0, mask.get_pixel(5, 5).0], [[255], [0]]);
    assert!(frames.path("t/pictures/organ.png").exists());
    let widest = frames.shape("t").iter().map(|p| p.x.hypot(p.y)).fold(0.0, f64::max);
    assert!(widest < 0.35, "no wall: {widest} of the depth, truth 0.239");
    assert!(frames.path("t/pictures/measured.png").exists());
    // Outlines of some frames are enough, and of none an error.
    let [some, other] = ["some", "other"].map(|folder| frames.path(folder));
    fs::create_dir(&some).unwrap();
    fs::create_dir(&other).unwrap();
    for own in fs::read_dir(frames.path("t/organ_masks")).unwrap().map(|own| own.unwrap()) {
        if own.file_name() != "f_2.png" {
            fs::copy(own.path(), some.join(own.file_name())).unwrap();
        }
    }
    fs::copy(some.join("f_4.png"), other.join("f_400.png")).unwrap();
    let given =
        ["template", "frames", "--camera", "camera.json", "--no-report", "--vertices", "300"];
    let shown = frames.dsfms(&given).args(["-o", "s", "--organ-masks", "some"]).output().unwrap();
    let said = String::from_utf8_lossy(&shown.stderr);
    assert!(said.contains("organ masks for 5 of 6 frames"), "{said}");
    // So small a scene may be measured on less than three quarters.
    assert!(matches!(shown.status.code(), Some(0 | 2)), "{said}");
    let widest = frames.shape("s").iter().map(|p| p.x.hypot(p.y)).fold(0.0, f64::max);
    assert!(widest < 0.35, "no wall: {widest} of the depth, truth 0.239");
    let none =
        ["template", "frames", "--camera", "camera.json", "-o", "n", "--organ-masks", "other"];
    let shown = frames.dsfms(&none).assert().failure();
    assert!(String::from_utf8_lossy(&shown.get_output().stderr).contains("any of the"));
    // Another template in the same place leaves nothing of this one.
    fs::copy(frames.path("t/template.ply"), frames.path("m.ply")).unwrap();
    frames.dsfms(&["template", "--mesh", "m.ply", "--no-report", "-o", "t"]).assert().success();
    assert!(!frames.path("t/organ_masks").exists());
}

#[test]
fn strokes_name_the_organ_and_the_wall_is_kept_as_a_second_surface() {
    let frames = Frames::new();
    let strokes = r#"{"strokes": [
        {"frame": "f_4", "organ": true, "px": [[100, 90], [140, 90], [120, 70]]},
        {"frame": "f_4", "organ": false, "px": [[8, 8], [230, 8]]}]}"#;
    fs::write(frames.path("s.json"), strokes).unwrap();
    let arguments = ["--organ-scribbles", "s.json", "--not-organ-click", "120,170@f_4"];
    frames.template(&arguments, "1", "one");
    frames.template(&arguments, "2", "two");
    for file in
        ["template.ply", "surroundings.ply", "surrounding_features.npz", "organ_masks/f_4.png"]
    {
        let [one, two] = ["one", "two"].map(|t| fs::read(frames.path(&format!("{t}/{file}"))));
        assert!(one.unwrap() == two.unwrap(), "{file} differs");
    }
    frames.assert_drawn("one");
    let widest = frames.shape("one").iter().map(|p| p.x.hypot(p.y)).fold(0.0, f64::max);
    assert!(widest < 0.35, "no wall: {widest} of the depth, truth 0.239");
    // The wall lies behind the disc: 66 and 46 units from the cameras.
    let depth = |file: &str| {
        let mesh = read_mesh(&frames.path(file)).unwrap().mesh;
        mesh.positions.iter().map(|p| p.z).sum::<f64>() / mesh.positions.len() as f64
    };
    let ratio = depth("one/surroundings.ply") / depth("one/template.ply");
    assert!((1.25..1.6).contains(&ratio), "{ratio}");
    let shown = frames.dsfms(&["inspect", "one"]).assert().success();
    let shown = String::from_utf8_lossy(&shown.get_output().stdout).into_owned();
    assert!(shown.contains("surroundings") && shown.contains("descriptors around"), "{shown}");
    frames.dsfms(&["export", "one", "--surroundings", "w.ply"]).assert().success();
    assert!(frames.path("w.ply").exists());
    let beside = r#"{"strokes": [{"organ": true, "px": []}]}"#;
    fs::write(frames.path("s.json"), beside).unwrap();
    let run = ["template", "frames", "--camera", "camera.json", "-o", "t", "--organ-scribbles"];
    let wrong = frames.dsfms(&run).arg("s.json").assert().failure();
    assert!(String::from_utf8_lossy(&wrong.get_output().stderr).contains("stroke 0"));
}

#[test]
fn a_click_beside_everything_and_a_bad_click_are_said() {
    let frames = Frames::new();
    let run = |click: &str| {
        let output = frames
            .dsfms(&["template", "frames", "--camera", "camera.json", "-o", "t", "--no-report"])
            .args(["--organ-click", click])
            .assert()
            .failure();
        String::from_utf8_lossy(&output.get_output().stderr).into_owned()
    };
    assert!(run("12").contains("X,Y"));
    assert!(run("500,20@f_2").contains("click the organ"), "{}", run("500,20@f_2"));
}
