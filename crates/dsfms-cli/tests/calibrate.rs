//! `dsfms calibrate` through the binary, on pictures of a small chessboard.

mod common;

use assert_cmd::Command;
use common::save;
use dsfms::camera::{Camera, CameraModel};
use dsfms::geometry::{Isometry, Point2, Vector3};
use dsfms::io::camera::read_camera;
use std::fs;

const SIZE: [usize; 2] = [260, 200];

fn camera() -> CameraModel {
    CameraModel::pinhole(SIZE, [240.0, 243.0], [127.0, 103.0])
}

fn poses() -> [Isometry; 5] {
    [
        ([-9.0, -6.0, 32.0], [0.5, 0.1, 0.1]),
        ([-10.0, -4.0, 34.0], [-0.4, 0.4, -0.3]),
        ([-7.0, -8.0, 33.0], [0.2, -0.55, 0.2]),
        ([-12.0, -7.0, 36.0], [-0.5, -0.1, 0.0]),
        ([2.0, -10.0, 40.0], [0.3, 0.3, 1.4]),
    ]
    .map(|(t, r)| Isometry::new(Vector3::from(t), Vector3::from(r)))
}

/// Squares of 3 mm, 8 x 6 of them, in a white margin on grey; 25 samples a pixel.
fn light(pose: &Isometry, pixel: usize) -> [u8; 3] {
    let inverse = pose.inverse();
    let sample = |k: usize| {
        let (dx, dy) = ((k % 5) as f64 / 5.0 - 0.4, (k / 5) as f64 / 5.0 - 0.4);
        let at = Point2::new((pixel % SIZE[0]) as f64 + dx, (pixel / SIZE[0]) as f64 + dy);
        let ray = inverse.rotation * camera().unproject(&at).unwrap();
        let eye = inverse.translation.vector;
        let hit = eye - ray * (eye.z / ray.z);
        let (u, v) = (hit.x / 3.0 + 1.0, hit.y / 3.0 + 1.0);
        let inside = |m: f64| (-m..8.0 + m).contains(&u) && (-m..6.0 + m).contains(&v);
        match (u.floor() + v.floor()) as i64 % 2 {
            0 if inside(0.0) => 25.0,
            _ if inside(1.0) => 225.0,
            _ => 110.0,
        }
    };
    [((0..25).map(sample).sum::<f64>() / 25.0) as u8; 3]
}

#[test]
fn the_intrinsics_and_their_residuals_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("board")).unwrap();
    for (i, pose) in poses().iter().enumerate() {
        save(&path(&format!("board/{i}.png")), SIZE, |p| light(pose, p));
    }
    let run = |board: &str| {
        let mut command = Command::cargo_bin("dsfms").unwrap();
        command.current_dir(folder.path()).args(["calibrate", "board", "--square", "3mm"]);
        command.args(["--board", board, "-o", "camera.json", "--quiet"]);
        command.assert()
    };
    run("7x5").success();
    let found = read_camera(&path("camera.json")).unwrap().camera;
    for (found, truth) in found.focal.iter().zip(camera().focal) {
        assert!((found / truth - 1.0).abs() < 0.02, "focal {found}, true {truth}");
    }
    let report = fs::read_to_string(path("camera.calibration/report.json")).unwrap();
    assert!(report.contains("residual") || report.contains("rms"), "{report:.300}");
    assert!(path("camera.calibration/residuals.png").is_file());
    let wrong = run("12x12").failure();
    let message = String::from_utf8_lossy(&wrong.get_output().stderr).into_owned();
    assert!(message.contains("12") && message.contains("board"), "{message}");
}
