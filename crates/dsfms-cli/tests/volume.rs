//! `--volume` through the binary: files, frames of reference, refusals.

#[path = "../../dsfms/tests/common/organ.rs"]
mod organ;

use assert_cmd::Command;
use dsfms::Mesh;
use dsfms::camera::CameraModel;
use dsfms::geometry::{Isometry, Point3, Similarity, Vector3};
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::io::matches::write_matches;
use dsfms::io::mesh::read_mesh;
use dsfms::io::nifti::{NiftiFile, read_nifti, write_warped};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::nalgebra::{Affine3, Matrix4};
use dsfms::preoperative::LandmarkPair;
use dsfms::synth::{Draw, Random, correspond};
use dsfms::template::LengthUnit;
use dsfms::voxels::{VoxelGrid, VoxelKind, VoxelVolume};
use organ::{Explored, bent, closed, organ};
use serde_json::Value;
use std::fs;
use std::io::Read;
use std::path::PathBuf;
use tempfile::TempDir;

/// A CT of an organ of 140 x 90 x 60 mm, which the template is made of.
struct Case {
    folder: TempDir,
    ct: Mesh,
    grid: VoxelGrid,
}

impl Case {
    fn new() -> Self {
        let sides = Matrix4::new_nonuniform_scaling(&Vector3::new(-4.0, 4.0, 4.0));
        let map = Matrix4::new_translation(&Vector3::new(110.0, -90.0, -60.0)) * sides;
        let grid = VoxelGrid::new([56, 44, 30], Affine3::from_matrix_unchecked(map)).unwrap();
        let case = Self { folder: tempfile::tempdir().unwrap(), ct: organ(20, 34), grid };
        case.write("ct.ply", &case.ct);
        case.volume("ct.nii.gz", &case.grid);
        let camera = CameraModel::pinhole([320, 240], [400.0, 400.0], [159.5, 119.5]);
        let file = CameraFile { camera, tone: None, light: None, vignetting: None };
        write_camera(&case.path("camera.json"), &file).unwrap();
        case.template("ct.ply");
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, mesh: &Mesh) {
        let (unit, extras) = (LengthUnit::Millimetre, PlyExtras::default());
        write_ply(&self.path(name), &mesh.topology, &mesh.positions, unit, &extras).unwrap();
    }

    /// Hounsfield units that rise with every axis, -1000 in the first voxel.
    fn volume(&self, name: &str, grid: &VoxelGrid) {
        let [nx, ny, nz] = grid.size();
        let value = |i: usize| match i {
            0 => -1000i16,
            i => (3 * (i % nx) + 5 * (i / nx % ny) + 7 * (i / nx / ny)) as i16,
        };
        let bytes = (0..nx * ny * nz).flat_map(|i| value(i).to_le_bytes()).collect();
        let volume = VoxelVolume::new(grid.clone(), VoxelKind::I16, bytes).unwrap();
        let file = NiftiFile::new(volume);
        let slice = 2 * nx * ny;
        write_warped(&self.path(name), &file, |k| file.volume.bytes()[k * slice..][..slice].into())
            .unwrap();
    }

    fn template(&self, mesh: &str) {
        let line = ["template", "--mesh", mesh, "-o", "organ.template", "--no-report", "--quiet"];
        self.dsfms(&line).assert().success();
    }

    fn dsfms(&self, arguments: &[&str]) -> Command {
        let mut command = Command::cargo_bin("dsfms").unwrap();
        command.current_dir(self.folder.path()).args(arguments);
        command
    }

    /// Matches of a mesh that is posed in front of the camera.
    fn matches(&self, mesh: &Mesh, posed: &[Point3]) {
        let camera = CameraModel::pinhole([320, 240], [400.0, 400.0], [159.5, 119.5]);
        let anywhere = vec![true; posed.len()];
        let draw = Draw { count: 300, sigma_px: 0.1 };
        let random = &mut Random::new(5, 1);
        let matches = correspond(&camera, mesh, posed, &anywhere, draw, random);
        fs::create_dir(self.path("tracks")).unwrap();
        write_matches(&self.path("tracks/frame_003.csv"), &matches).unwrap();
    }

    fn reconstruct(&self, more: &[&str]) -> Command {
        let line = ["reconstruct", "organ.template", "--matches", "tracks", "--method", "dsfm"];
        let mut command = self.dsfms(&line);
        command.args(["--camera", "camera.json", "--no-report", "-o", "out"]).args(more);
        command
    }

    fn record(&self) -> Value {
        let text = fs::read_to_string(self.path("out/volume/frame_003.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    }

    /// Vectors of the displacement field at the voxels.
    fn field(&self) -> Vec<Vector3> {
        let file = fs::File::open(self.path("out/volume/frame_003_displacement.nii.gz")).unwrap();
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(file).read_to_end(&mut bytes).unwrap();
        let all: Vec<f64> = bytes[352..]
            .chunks(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]).into())
            .collect();
        let n = self.grid.count();
        assert_eq!(all.len(), 3 * n);
        (0..n).map(|i| Vector3::new(all[i], all[n + i], all[2 * n + i])).collect()
    }
}

/// Volume that a closed mesh encloses, mm³.
fn enclosed(mesh: &Mesh) -> f64 {
    let at = |i: u32| mesh.positions[i as usize].coords;
    let cone = |[a, b, c]: [u32; 3]| at(a).dot(&at(b).cross(&at(c))) / 6.0;
    mesh.topology.faces.iter().map(|&face| cone(face)).sum::<f64>().abs()
}

/// Before the camera, seen from the flat side.
fn pose() -> Isometry {
    Isometry::new(Vector3::new(4.0, -6.0, 260.0), Vector3::new(2.6, 0.3, 0.1))
}

#[test]
fn field_and_warped_volume_are_where_structures_are() {
    let case = Case::new();
    let lump = closed(5, 8, |d| d * 9.0 + Vector3::new(12.0, 6.0, 4.0));
    case.write("lump.ply", &lump);
    let posed: Vec<Point3> = case.ct.positions.iter().map(|p| pose() * bent(p, 8.0)).collect();
    case.matches(&case.ct, &posed);
    let volume = ["--volume", "ct.nii.gz", "--volume-out", "both", "--structures", "lump.ply"];
    let code = case.reconstruct(&volume).output().unwrap().status.code();
    assert!(matches!(code, Some(0 | 2)), "{code:?}");
    // What moves: voxels at corners of the lump, displaced, before the camera.
    let record = case.record();
    let matrix: [[f64; 4]; 4] =
        serde_json::from_value(record["camera_from_volume"].clone()).unwrap();
    let camera = Matrix4::from_fn(|r, c| matrix[r][c]);
    let field = case.field();
    let at = read_mesh(&case.path("out/structures/frame_003_lump.ply")).unwrap().mesh;
    for (rest, carried) in lump.positions.iter().zip(&at.positions) {
        let world = Point3::new(-rest.x, -rest.y, rest.z);
        let place = case.grid.world_from_voxel().inverse() * world;
        let mut u = Vector3::zeros();
        for corner in 0..8usize {
            let low = place.map(f64::floor);
            let step =
                Vector3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64);
            let node = low + step;
            let weight: f64 = (0..3).map(|c| 1.0 - (place[c] - node[c]).abs()).product();
            let index = node.x + 56.0 * (node.y + 44.0 * node.z);
            u += field[index as usize] * weight;
        }
        let seen = camera.transform_point(&(world + Vector3::new(-u.x, -u.y, u.z)));
        assert!((seen - carried).norm() < 0.1, "{seen} {carried}");
    }
    let largest = record["displacement_largest_mm"].as_f64().unwrap();
    assert!((1.0..30.0).contains(&largest), "{largest}");
    assert!(field.iter().any(|u| u.norm() > 0.5) && field[0] == Vector3::zeros());
    let warped = read_nifti(&case.path("out/volume/frame_003_warped.nii.gz")).unwrap().volume;
    let source = read_nifti(&case.path("ct.nii.gz")).unwrap().volume;
    assert_eq!((warped.grid(), warped.kind()), (source.grid(), source.kind()));
    let organ = (0..source.grid().count()).filter(|&i| warped.value(i) != -1000.0).count();
    let shown = read_mesh(&case.path("out/frame_003.ply")).unwrap().mesh;
    let share = organ as f64 * 64.0 / enclosed(&shown);
    assert!((0.97..1.03).contains(&share) && record["folded_voxels"] == 0, "{share}");
}

#[test]
fn a_registered_volume_goes_the_way_of_its_mesh() {
    let case = Case::new();
    let way = Similarity::new(Vector3::new(50.0, 20.0, -9.0), Vector3::new(0.4, 0.9, -0.2), 1.0);
    let seen = Explored::of(&case.ct, Vector3::new(0.2, 0.3, 1.0).normalize(), 3.0, 0.3, way);
    case.write("seen.ply", &seen.template);
    fs::remove_dir_all(case.path("organ.template")).unwrap();
    case.template("seen.ply");
    let mut text = String::from("name,ct_x,ct_y,ct_z,template_x,template_y,template_z\n");
    for LandmarkPair { name, ct: c, template: t } in seen.landmarks(&case.ct, 5, 1.0, &[], 0.0) {
        text += &format!("{name},{},{},{},{},{},{}\n", c.x, c.y, c.z, t.x, t.y, t.z);
    }
    fs::write(case.path("pairs.csv"), text).unwrap();
    case.dsfms(&[
        "register-ct",
        "organ.template",
        "ct.ply",
        "--landmarks",
        "pairs.csv",
        "-o",
        "ct",
    ])
    .assert()
    .success();
    let middle = seen.template.positions.iter().map(|p| p.coords).sum::<Vector3>()
        / seen.template.positions.len() as f64;
    let pose = Isometry::new(Vector3::new(4.0, -6.0, 260.0), Vector3::new(2.0, 0.9, 0.1))
        * Isometry::translation(-middle.x, -middle.y, -middle.z);
    let posed: Vec<Point3> = seen.template.positions.iter().map(|p| pose * p).collect();
    case.matches(&seen.template, &posed);
    // Without the registration the template, a part of the organ, encloses nothing.
    let refused = case.reconstruct(&["--volume", "ct.nii.gz"]).output().unwrap();
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("is open") && said.contains("--volume-registration"), "{said}");
    assert!(!case.path("out").exists());
    let volume = ["--volume", "ct.nii.gz", "--volume-registration", "ct", "--volume-out", "field"];
    let code = case.reconstruct(&volume).output().unwrap().status.code();
    assert!(matches!(code, Some(0 | 2)), "{code:?}");
    assert!(!case.path("out/volume/frame_003_warped.nii.gz").exists());
    // At rest before the camera: the field is what the organ bent since the CT, seen from the
    // template.
    let record = case.record();
    let matrix: [[f64; 4]; 4] =
        serde_json::from_value(record["camera_from_volume"].clone()).unwrap();
    let camera = Matrix4::from_fn(|r, c| matrix[r][c]);
    let field = case.field();
    let [nx, ny, _] = case.grid.size();
    let mut errors = Vec::new();
    for (i, u) in field.iter().enumerate().filter(|(_, u)| **u != Vector3::zeros()) {
        let voxel = Point3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64);
        let world = case.grid.world_from_voxel() * voxel;
        let lps = Point3::new(-world.x, -world.y, world.z);
        let found = camera.transform_point(&(world + Vector3::new(-u.x, -u.y, u.z)));
        errors.push((found - pose * seen.now(&lps)).norm());
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 2000 && errors[errors.len() / 2] < 3.0, "{}", errors[errors.len() / 2]);
}

#[test]
fn what_is_wrong_with_a_volume_is_said_and_leaves_nothing() {
    let case = Case::new();
    let posed: Vec<Point3> = case.ct.positions.iter().map(|p| pose() * p).collect();
    case.matches(&case.ct, &posed);
    fs::write(case.path("notes.nii"), "no volume").unwrap();
    let good = fs::read(case.path("ct.nii.gz")).unwrap();
    fs::write(case.path("half.nii.gz"), &good[..good.len() / 2]).unwrap();
    let refused = |more: &[&str], code: i32, words: &[&str]| {
        let done = case.reconstruct(more).output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(code), "{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "{word}: {said}"));
        assert!(!case.path("out").exists());
    };
    refused(&["--volume", "none.nii"], 1, &["none.nii", "no such file"]);
    refused(&["--volume", "notes.nii"], 1, &["notes.nii", "truncated"]);
    refused(&["--volume", "half.nii.gz"], 1, &["half.nii.gz", "copy or export"]);
    refused(&["--volume-out", "both"], 64, &["--volume"]);
    refused(&["--volume", "ct.nii.gz", "--volume-out", "all"], 64, &["field", "warped", "both"]);
    let none = ["--volume", "ct.nii.gz", "--volume-registration", "tracks"];
    refused(&none, 1, &["registration.json", "register-ct"]);
    // Mesh and volume 150 mm to the side, which is not the same in LPS and RAS.
    let aside = case.ct.positions.iter().map(|p| p + Vector3::new(150.0, 0.0, 0.0)).collect();
    case.write("ct.ply", &case.ct.with_positions(aside));
    let shift = Matrix4::new_translation(&Vector3::new(150.0, 0.0, 0.0));
    let map = Affine3::from_matrix_unchecked(shift * case.grid.world_from_voxel().matrix());
    case.volume("ct.nii.gz", &VoxelGrid::new(case.grid.size(), map).unwrap());
    fs::remove_dir_all(case.path("organ.template")).unwrap();
    case.template("ct.ply");
    refused(&["--volume", "ct.nii.gz"], 1, &["ct.nii.gz", "no voxel", "RAS", "--volume-axes"]);
    let line = ["track", "organ.template", "tracks", "-o", "out", "--realtime", "--volume"];
    let done = case.dsfms(&line).arg("ct.nii.gz").output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.code() == Some(64) && said.contains("--realtime"), "{said}");
}
