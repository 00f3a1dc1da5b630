//! A tiny synthetic case on disk: a textured, bumpy patch with known albedo, pushed by a tool.

#![allow(dead_code, reason = "no test file needs all of it")]

pub mod refusal;

use assert_cmd::Command;
use dsfms::camera::CameraModel;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::io::matches::write_matches;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::light::LightModel;
use dsfms::mesh::Mesh;
use dsfms::synth::{Attraction, Draw, Random, RenderOptions, correspond, deform, patch, render};
use dsfms::template::LengthUnit;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// The files of the case.
pub struct Case {
    pub folder: TempDir,
}

impl Case {
    /// Write mesh, albedo, camera, one deformed frame, its matches and its truth.
    pub fn new() -> Self {
        let case = Self { folder: tempfile::tempdir().unwrap() };
        let camera = camera();
        let organ = patch(200, 7);
        let n = organ.mesh.positions.len();
        let write = |path: &Path, positions: &[Point3]| {
            let extras = PlyExtras::default();
            write_ply(path, &organ.mesh.topology, positions, LengthUnit::Millimetre, &extras)
                .unwrap();
        };
        write(&case.path("organ.ply"), &organ.mesh.positions);
        let file = CameraFile { camera: camera.clone(), tone: None, light: None, vignetting: None };
        write_camera(&case.path("camera.json"), &file).unwrap();
        let attraction = Attraction {
            direction: -Vector3::z(),
            point: Point3::new(0.0, 0.0, -12.0),
            angle: 0.7,
        };
        let shape = deform(&organ.mesh, &[attraction], 0.08, 0.0);
        let pose = Isometry::translation(1.0, -0.5, 75.0);
        let posed: Vec<Point3> = shape.vertices.iter().map(|p| pose * p).collect();
        std::fs::create_dir(case.path("truth")).unwrap();
        std::fs::create_dir(case.path("frames")).unwrap();
        write(&case.path("truth/frame_003.ply"), &posed);
        let values = vertex_albedo(&organ.mesh, n);
        let texels = dsfms::template::SurfaceTexels::from_vertex_values(
            &organ.mesh,
            &values,
            vec![8; organ.mesh.topology.faces.len()],
        )
        .unwrap();
        let csv: String = values.iter().map(|v| format!("{}\n", v[0])).collect();
        std::fs::write(case.path("albedo.csv"), format!("albedo\n{csv}")).unwrap();
        let deformed = organ.mesh.with_positions(posed);
        let frame =
            render(&camera, &LightModel::Collinear, &deformed, &texels, &RenderOptions::default());
        save(&case.path("frames/organ_003.png"), frame.size, |i| frame.rgb[i]);
        let calm: Vec<bool> = shape.zone.iter().map(|z| !z).collect();
        let matches = correspond(
            &camera,
            &organ.mesh,
            &deformed.positions,
            &calm,
            Draw { count: 30, sigma_px: 0.5 },
            &mut Random::new(5, 1),
        );
        write_matches(&case.path("matches.csv"), &matches).unwrap();
        case
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The binary, in the case's folder.
    pub fn dsfms(&self, arguments: &[&str]) -> Command {
        let mut command = Command::cargo_bin("dsfms").unwrap();
        command.current_dir(self.folder.path()).args(arguments);
        command
    }

    /// Build the template `organ.template` from mesh and albedo.
    pub fn template(&self) {
        self.dsfms(&["template", "--mesh", "organ.ply", "--albedo", "albedo.csv"])
            .args(["-o", "organ.template", "--quiet"])
            .assert()
            .success();
    }

    /// `reconstruct` with rigid poses, further arguments at the end.
    pub fn reconstruct(&self, arguments: &[&str]) -> Command {
        let mut command = self.dsfms(&["reconstruct", "organ.template"]);
        command.args(arguments);
        command
    }
}

/// 160 x 120 px.
pub fn camera() -> CameraModel {
    CameraModel::pinhole([160, 120], [200.0, 200.0], [79.5, 59.5])
}

/// A smooth pattern with contrast.
fn vertex_albedo(mesh: &Mesh, n: usize) -> Vec<[f32; 3]> {
    (0..n)
        .map(|i| {
            let p = mesh.positions[i];
            [(0.5 + 0.15 * (0.5 * p.x).sin() * (0.6 * p.y).cos()) as f32; 3]
        })
        .collect()
}

/// A PNG whose pixel `i` (row major) is `value(i)`.
pub fn save(path: &Path, size: [usize; 2], value: impl Fn(usize) -> [u8; 3]) {
    image::RgbImage::from_fn(size[0] as u32, size[1] as u32, |x, y| {
        image::Rgb(value(y as usize * size[0] + x as usize))
    })
    .save(path)
    .unwrap();
}
