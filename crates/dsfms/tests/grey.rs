//! A grey recording of tissue of several colours: compared by its luma, under an exposure of which
//! the coloured exploration tells nothing.

#[path = "common/near_pull.rs"]
mod near_pull;

use dsfms::synth::{Case, RenderOptions, render};
use dsfms::verdict::Level;
use dsfms::{Frame, Method, Observation, ReconstructOptions, Reconstruction, reconstruct};
use near_pull::near_pull;

/// A pull under a near light of tissue whose right half is yellow, and its frame.
fn case() -> (Case, Frame) {
    let mut case = near_pull(40);
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

fn mean_expected(case: &Case, frame: &Frame) -> f64 {
    let expected = joint(case, frame).expected_error.unwrap();
    expected.iter().sum::<f64>() / expected.len() as f64
}

#[test]
fn less_is_promised_of_a_grey_frame() {
    let (case, frame) = case();
    let [coloured, grey] = [frame.clone(), grey(&frame)].map(|frame| mean_expected(&case, &frame));
    assert!(grey > 1.5 * coloured, "{grey} and {coloured} mm");
}

#[test]
fn a_grey_template_lost_nothing_in_grey() {
    let (mut case, frame) = case();
    let frame = grey(&frame);
    let coloured = mean_expected(&case, &frame);
    for value in &mut case.template.albedo.as_mut().unwrap().value {
        let luma = [0.299, 0.587, 0.114].iter().zip(*value).map(|(w, v)| w * v.sqrt()).sum::<f32>();
        *value = [luma * luma; 3];
    }
    let grey = mean_expected(&case, &frame);
    assert!(coloured > 1.5 * grey, "{coloured} and {grey} mm");
}
