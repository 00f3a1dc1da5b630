//! A grey recording of tissue of several colours: compared by its luma, under an exposure of which
//! the coloured exploration tells nothing.

use dsfms::geometry::{Isometry, Point3};
use dsfms::light::{LightModel, PointLight, Spot};
use dsfms::synth::{Case, CaseOptions, Draw, RenderOptions, render};
use dsfms::template::TemplateView;
use dsfms::verdict::Level;
use dsfms::{Frame, Method, Observation, ReconstructOptions, Reconstruction, reconstruct};

/// A pull under a near light of tissue whose right half is yellow, and its frame.
fn case() -> (Case, Frame) {
    let light = LightModel::Point(PointLight {
        positions: vec![Point3::new(3.0, 0.0, 0.0)],
        reference_distance: 75.0,
        spot: Spot::Isotropic,
    });
    let draw = Draw { count: 40, sigma_px: 0.3 };
    let options = CaseOptions { vertices: 300, extension: 0.05, light, draw, pull: true };
    let mut case = Case::new(&options, 5);
    let view = |k: usize| TemplateView {
        name: format!("frame_{k}"),
        camera_from_template: Isometry::identity(),
        gain: [0.998, 1.002][k % 2],
        reprojection_px: 0.0,
    };
    case.template.views = (0..6).map(view).collect();
    let rest = case.template.mesh.clone();
    let albedo = case.template.albedo.as_mut().unwrap();
    for face in 0..rest.topology.faces.len() {
        let right = rest.corners(face).iter().map(|p| p.x).sum::<f64>() > 0.0;
        let texels = albedo.offset[face] as usize..albedo.offset[face + 1] as usize;
        let green = if right { 2.0 } else { 1.0 };
        albedo.value[texels].iter_mut().for_each(|value| value[1] *= green);
    }
    let template = &case.template;
    let shape = rest.with_positions(case.truth.clone());
    let look = RenderOptions { noise: 1.0, seed: 3, ..RenderOptions::default() };
    let (light, albedo) = (template.light.as_ref().unwrap(), template.albedo.as_ref().unwrap());
    let frame = render(&case.camera, light, &shape, albedo, &look);
    (case, frame)
}

/// As a grey recording has it.
fn grey(frame: &Frame) -> Frame {
    let luma = |[r, g, b]: [u8; 3]| {
        (0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)).round() as u8
    };
    let rgb = frame.rgb.iter().map(|p| [luma(*p); 3]).collect();
    Frame { rgb, ..frame.clone() }
}

fn joint(case: &Case, frame: &Frame) -> Reconstruction {
    let observation = Observation::new(frame, &case.camera).matches(&case.matches);
    let options = ReconstructOptions::default();
    reconstruct(&case.template, &observation, Method::Joint, &options).unwrap()
}

#[test]
fn tissue_of_several_colours_is_recognised_and_solved_in_grey() {
    let (case, frame) = case();
    let [coloured, grey] = [frame.clone(), grey(&frame)].map(|frame| joint(&case, &frame));
    let zone = |found: &Reconstruction| case.zone_rms(&found.vertices);
    assert_eq!(coloured.verdict.level, Level::Ok, "{:?}", coloured.verdict.reasons);
    assert_eq!(grey.verdict.level, Level::Ok, "{:?}", grey.verdict.reasons);
    let (own, other) = (zone(&coloured), zone(&grey));
    println!("zone {own:.3} mm in colour, {other:.3} in grey");
    assert!(other < 1.0, "{other} mm in grey, {own} in colour");
}

#[test]
fn less_is_promised_of_a_grey_frame() {
    let (case, frame) = case();
    let mean = |frame: &Frame| {
        let expected = joint(&case, frame).expected_error.unwrap();
        expected.iter().sum::<f64>() / expected.len() as f64
    };
    let (coloured, grey) = (mean(&frame), mean(&grey(&frame)));
    assert!(grey > 1.5 * coloured, "{grey} and {coloured} mm");
}
