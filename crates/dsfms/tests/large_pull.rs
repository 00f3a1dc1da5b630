//! A small place pulled across the image by many times the finest blur, with texture all over it.

use dsfms::camera::PosedFrame;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::image::Frame;
use dsfms::pipeline::{Method, Observation, ReconstructOptions, reconstruct};
use dsfms::sfm::{SfmOptions, detect};
use dsfms::synth::{Case, RenderOptions, render};
use dsfms::template::anchor::{AnchorOptions, FeatureView, anchor_features};
use dsfms::template::{SurfaceTexels, Template};

/// Vessels in every direction, a few millimetres apart, over the albedo of a sheet.
fn veined(template: &Template) -> SurfaceTexels {
    let mut albedo = template.albedo.clone().unwrap();
    let rest = &template.mesh;
    for face in 0..albedo.resolution.len() {
        let centres: Vec<[f64; 3]> = albedo.centres(face).collect();
        let at = albedo.offset[face] as usize;
        for (k, barycentric) in centres.into_iter().enumerate() {
            let p = rest.topology.point(face as u32, barycentric, &rest.positions);
            let waves = [[1.9, 0.4], [-0.7, 2.3], [1.1, -1.6], [2.9, 1.7], [0.5, -3.1]];
            let dark: f64 = waves.iter().map(|w| (w[0] * p.x + w[1] * p.y).sin()).sum();
            albedo.value[at + k] = albedo.value[at + k].map(|v| v * (1.0 + 0.08 * dark as f32));
        }
    }
    albedo
}

#[test]
fn a_pull_beyond_descriptors_and_blurs_is_followed_along_its_texture() {
    let case = Case::example(1);
    let (camera, mut template) = (case.camera, case.template);
    let (rest, albedo, light) =
        (template.mesh.clone(), veined(&template), template.light.clone().unwrap());
    let photograph = |shape: Vec<Point3>, seed: u64| -> Frame {
        let options = RenderOptions { noise: 1.5, seed, ..Default::default() };
        render(&camera, &light, &rest.with_positions(shape), &albedo, &options)
    };
    let pose = Isometry::new(Vector3::new(0.0, 0.0, 75.0), Vector3::new(0.1, -0.1, 0.0));
    let still: Vec<Point3> = rest.positions.iter().map(|p| pose * p).collect();
    let look = photograph(still.clone(), 1);
    let found = detect(&look, None, &SfmOptions::default());
    let (points, descriptors) = (&found.points[..], &found.descriptors[..]);
    let view = FeatureView { posed: PosedFrame::new(&look, &camera, pose), points, descriptors };
    template.features = Some(anchor_features(&rest, &[view], &AnchorOptions::default()));
    template.albedo = Some(albedo.clone());
    // 12 mm are 120 px; the coarse blurs would reach it, so that they are left out.
    let middle = still.iter().map(|p| p.coords).sum::<Vector3>() / still.len() as f64;
    let share = |p: &Point3| (-0.5 * ((p.coords - middle).norm() / 9.0).powi(2)).exp();
    let truth: Vec<Point3> =
        still.iter().map(|p| p + Vector3::new(10.0, 6.0, -2.4) * share(p)).collect();
    let frame = photograph(truth.clone(), 2);
    let off = |follow: bool| {
        let mut options = ReconstructOptions::default();
        options.joint.follow_texture = follow;
        options.joint.blurs = vec![0.0045, 0.003];
        options.joint.look_again = 1;
        let seen = Observation::new(&frame, &camera);
        let surface = reconstruct(&template, &seen, Method::Joint, &options).unwrap();
        let pulled: Vec<usize> = (0..truth.len()).filter(|&v| share(&still[v]) > 0.5).collect();
        let off = |&v: &usize| (surface.vertices[v] - truth[v]).norm();
        pulled.iter().map(off).sum::<f64>() / pulled.len() as f64
    };
    let [without, followed] = [false, true].map(off);
    assert!(followed < 0.5 * without, "{followed:.2} mm off, {without:.2} without");
}
