//! A clip of known truth: a moving camera over tissue that is pushed and pulled.

use dsfms::camera::{Camera, CameraModel, Lens, PosedFrame};
use dsfms::geometry::{Isometry, Point3, Vector2, Vector3, point_at};
use dsfms::image::Frame;
use dsfms::light::{LightModel, PointLight, Spot};
use dsfms::mesh::Mesh;
use dsfms::pipeline::Method;
use dsfms::sfm::{SfmOptions, detect};
use dsfms::synth::{Case, CaseOptions, Draw, Gloss, RenderOptions, render};
use dsfms::template::anchor::{AnchorOptions, FeatureView, anchor_features};
use dsfms::template::{SurfaceTexels, Template};
use dsfms::track::{TrackOptions, Tracked, Tracker};
use std::f64::consts::TAU;

/// Frames with the template to track in them, and the truth where it is known.
pub struct Clip {
    pub camera: CameraModel,
    pub template: Template,
    pub frames: Vec<Frame>,
    /// True vertices in camera axes.
    pub truth: Vec<Vec<Point3>>,
    /// Vertices that move.
    pub zone: Vec<bool>,
}

const CAMERA: CameraModel = CameraModel {
    size: [1280, 720],
    focal: [1050.0, 1050.0],
    centre: [639.5, 359.5],
    lens: Lens::Pinhole,
};

fn light() -> LightModel {
    LightModel::Point(PointLight {
        positions: vec![Point3::new(3.0, -2.0, 0.0)],
        reference_distance: 75.0,
        spot: Spot::Linear { inner_deg: 10.0, outer_deg: 60.0 },
    })
}

impl Clip {
    /// A patch 75 mm before the camera: three pulls of 3 % in 120 frames, a camera that
    /// drifts by 12 mm and turns by 6°, an exposure that breathes by 10 %, highlights, noise.
    pub fn synthetic(vertices: usize, frames: usize) -> Self {
        let frames = frames.min(120);
        let draw = Draw { count: 25, sigma_px: 1.0 };
        let options = CaseOptions { vertices, extension: 0.03, light: light(), draw, pull: true };
        let case = Case::new(&options, 5);
        let (rest, albedo) = (&case.template.mesh, case.template.albedo.as_ref().expect("made so"));
        let shape = |k: usize| -> Vec<Point3> {
            let part = 0.5 - 0.5 * (TAU * k as f64 / 40.0).cos();
            let moved = rest.positions.iter().zip(&case.deformation.vertices);
            moved.map(|(a, b)| pose(k) * (a + (b - a) * part)).collect()
        };
        let truth: Vec<Vec<Point3>> = (0..frames).map(shape).collect();
        let take = |(k, x): (usize, &Vec<Point3>)| {
            photograph(&rest.with_positions(x.clone()), albedo, k as u64)
        };
        let mut template = case.template.clone();
        template.features = Some(features(rest, albedo));
        let frames = truth.iter().enumerate().map(take).collect();
        Self { camera: CAMERA, template, frames, truth, zone: case.deformation.zone }
    }

    /// Root mean square error of a shape over the zone and over all vertices, mm.
    fn errors(&self, k: usize, shape: &[Point3]) -> [f64; 2] {
        let square = |v: usize| (shape[v] - self.truth[k][v]).norm_squared();
        let rms = |of: Vec<f64>| (of.iter().sum::<f64>() / of.len().max(1) as f64).sqrt();
        let all = 0..shape.len();
        [
            rms(all.clone().filter(|&v| self.zone[v]).map(square).collect()),
            rms(all.map(square).collect()),
        ]
    }

    pub fn print_errors(&self, tracked: &[Tracked]) {
        let shapes = tracked.iter().take(self.truth.len()).enumerate();
        let errors: Vec<[f64; 2]> = shapes
            .filter_map(|(k, t)| Some(self.errors(k, &t.surface.as_ref()?.vertices)))
            .collect();
        if errors.is_empty() {
            return;
        }
        let of = |axis: usize| {
            let mut all: Vec<f64> = errors.iter().map(|e| e[axis]).collect();
            all.sort_unstable_by(f64::total_cmp);
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            format!(
                "mean {mean:.3}, median {:.3}, most {:.3}",
                all[all.len() / 2],
                all[all.len() - 1]
            )
        };
        println!("error mm, zone: {}; all: {}", of(0), of(1));
    }

    /// How far the kept matches lie from where the truth projects: `median / 90 % / mean offset`.
    pub fn print_matches(&self, tracked: &[Tracked]) {
        let (mut distances, mut sum) = (Vec::new(), Vector2::zeros());
        for (t, truth) in tracked.iter().zip(&self.truth) {
            let matches = t.surface.iter().flat_map(|s| &s.matches).filter(|m| m.1);
            for (m, _) in matches {
                let face = self.template.mesh.topology.faces[m.face as usize];
                let point = point_at(face.map(|v| &truth[v as usize]), m.barycentric);
                let Some(seen) = self.camera.project(&point) else { continue };
                distances.push((m.pixel - seen.pixel).norm());
                sum += m.pixel - seen.pixel;
            }
        }
        distances.sort_unstable_by(f64::total_cmp);
        let n = distances.len();
        if n > 0 {
            println!(
                "matches {}, a frame {:.0}: {:.2} px median, {:.2} px 90 %, offset {:.2} {:.2}",
                n,
                n as f64 / tracked.len() as f64,
                distances[n / 2],
                distances[n * 9 / 10],
                sum.x / n as f64,
                sum.y / n as f64
            );
        }
    }

    /// Every so-manieth frame by itself, found and solved from nothing, beside the tracked one.
    pub fn print_cold(&self, tracked: &[Tracked], method: Method, every: usize) {
        let tone = self.template.tone.clone();
        let (mut sums, mut count) = ([0.0; 2], 0.0);
        for k in (0..self.truth.len()).step_by(every) {
            let options = TrackOptions::realtime();
            let fresh = Tracker::new(&self.template, &self.camera, &tone, method, options);
            let alone = fresh.ok().and_then(|mut t| t.next(&self.frames[k], None).ok());
            let cold = alone.and_then(|t| t.surface);
            let warm = tracked[k].surface.as_ref();
            let (Some(cold), Some(warm)) = (cold, warm) else { continue };
            let errors = [&warm.vertices, &cold.vertices].map(|s| self.errors(k, s)[0]);
            println!("frame {k:4}: zone {:.3} mm tracked, {:.3} mm alone", errors[0], errors[1]);
            (sums[0], sums[1], count) = (sums[0] + errors[0], sums[1] + errors[1], count + 1.0);
        }
        println!(
            "mean zone error: {:.3} mm tracked, {:.3} mm alone",
            sums[0] / count,
            sums[1] / count
        );
    }
}

fn pose(k: usize) -> Isometry {
    let turn = TAU * k as f64 / 90.0;
    let place = Vector3::new(6.0 * turn.sin(), 3.0 * (1.0 - turn.cos()), 75.0 + 3.0 * turn.sin());
    Isometry::new(place, Vector3::new(0.1 * turn.sin(), 0.05, 0.1 * (1.0 - turn.cos())))
}

fn photograph(mesh: &Mesh, albedo: &SurfaceTexels, k: u64) -> Frame {
    let options = RenderOptions {
        gain: 1.0 + 0.1 * (k as f64 / 15.0).sin(),
        ambient: 0.01,
        gloss: Some(Gloss { strength: 1.5, width: 0.06 }),
        noise: 1.5,
        shadows: false,
        seed: k,
        ..Default::default()
    };
    render(&CAMERA, &light(), mesh, albedo, &options)
}

fn features(rest: &Mesh, albedo: &SurfaceTexels) -> dsfms::template::Features {
    let pose = pose(0);
    let posed = rest.with_positions(rest.positions.iter().map(|p| pose * p).collect());
    let look = photograph(&posed, albedo, 1000);
    let found = detect(&look, None, &SfmOptions::default());
    let (points, descriptors) = (&found.points[..], &found.descriptors[..]);
    let posed = PosedFrame::new(&look, &CAMERA, pose);
    let view = FeatureView { posed, points, descriptors };
    anchor_features(rest, &[view], &AnchorOptions::default())
}
