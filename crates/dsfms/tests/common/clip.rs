//! A small clip of known truth: a moving camera, a growing push, a black frame and a cut.

use dsfms::camera::{CameraModel, PosedFrame};
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::image::Frame;
use dsfms::light::LightModel;
use dsfms::mesh::Mesh;
use dsfms::sfm::{SfmOptions, detect};
use dsfms::synth::{Case, CaseOptions, Draw, RenderOptions, render};
use dsfms::template::anchor::{AnchorOptions, FeatureView, anchor_features};
use dsfms::template::{SurfaceTexels, Template};

pub struct Clip {
    pub camera: CameraModel,
    pub template: Template,
    pub frames: Vec<Frame>,
    pub truth: Vec<Option<Vec<Point3>>>,
}

fn photograph(camera: &CameraModel, mesh: &Mesh, albedo: &SurfaceTexels, seed: u64) -> Frame {
    let options = RenderOptions { gain: 1.0 + 0.03 * seed as f64, seed, ..Default::default() };
    render(camera, &LightModel::Collinear, mesh, albedo, &options)
}

/// Nine frames, 7.5 per cent of the whole pull each; frame 4 is black, before frame 6 is a cut.
pub fn clip() -> Clip {
    let options = CaseOptions {
        vertices: 300,
        extension: 0.03,
        light: LightModel::Collinear,
        draw: Draw { count: 25, sigma_px: 1.0 },
        pull: true,
    };
    let case = Case::new(&options, 5);
    let (camera, mut template) = (case.camera, case.template);
    let albedo = template.albedo.clone().unwrap();
    let rest = template.mesh.clone();
    let at = |x: f64, turn: f64| {
        Isometry::new(Vector3::new(x, 0.5 * x, 75.0), Vector3::new(0.3 * turn, 0.1, turn))
    };
    let posed = |pose: &Isometry, shape: &[Point3]| {
        rest.with_positions(shape.iter().map(|p| pose * p).collect())
    };
    let pose = at(0.0, 0.0);
    let look = photograph(&camera, &posed(&pose, &rest.positions), &albedo, 9);
    let found = detect(&look, None, &SfmOptions::default());
    let (points, descriptors) = (&found.points[..], &found.descriptors[..]);
    let view = FeatureView { posed: PosedFrame::new(&look, &camera, pose), points, descriptors };
    template.features = Some(anchor_features(&rest, &[view], &AnchorOptions::default()));
    let (mut frames, mut truth) = (Vec::new(), Vec::new());
    for k in 0..9 {
        if k == 4 {
            let size = camera.size;
            frames.push(Frame { name: "black".into(), size, rgb: vec![[2; 3]; size[0] * size[1]] });
            truth.push(None);
            continue;
        }
        let part = 0.075 * k as f64;
        let push = rest.positions.iter().zip(&case.deformation.vertices);
        let shape: Vec<Point3> = push.map(|(a, b)| a + (b - a) * part).collect();
        let cut = if k >= 6 { 12.0 } else { 0.0 };
        let mesh = posed(&at(0.6 * k as f64 - cut, 0.01 * k as f64 + 0.02 * cut), &shape);
        frames.push(photograph(&camera, &mesh, &albedo, k));
        truth.push(Some(mesh.positions));
    }
    Clip { camera, template, frames, truth }
}
