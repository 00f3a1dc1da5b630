//! What a near light tells of distance: as much as the exposure is known, and nothing where it has
//! changed.

#[path = "common/near_pull.rs"]
mod near_pull;

use dsfms::geometry::median;
use dsfms::synth::{Case, RenderOptions, render};
use dsfms::{Method, Observation, ReconstructOptions, reconstruct};
use near_pull::near_pull;

/// Median error in depth over what is seen of the frame under a gain, mm, and the gain found.
fn depth_off(case: &Case, method: Method, gain: f64) -> (f64, f64) {
    let template = &case.template;
    let (light, albedo) = (template.light.as_ref().unwrap(), template.albedo.as_ref().unwrap());
    let shape = template.mesh.with_positions(case.truth.clone());
    let look = RenderOptions { gain, noise: 1.0, seed: 3, ..RenderOptions::default() };
    let frame = render(&case.camera, light, &shape, albedo, &look);
    let observation = Observation::new(&frame, &case.camera).matches(&case.matches);
    let options = ReconstructOptions::default();
    let found = reconstruct(template, &observation, method, &options).unwrap();
    let seen = (0..case.truth.len()).filter(|&v| case.visible[v]);
    let mut off: Vec<f64> = seen.map(|v| found.vertices[v].z - case.truth[v].z).collect();
    (median(&mut off).unwrap(), found.gain)
}

#[test]
fn another_exposure_than_the_explorations_is_told_and_moves_nothing() {
    let case = near_pull(25);
    for method in [Method::Dsfms, Method::Joint] {
        for gain in [1.0, 0.8, 1.25] {
            let (off, found) = depth_off(&case, method, gain);
            // Held to the exploration's, a gain of 1.25 moves a surface at 75 mm by 8 mm.
            assert!(off.abs() < 0.5, "{method:?}, gain {gain}: depth off by {off:.2} mm");
            assert!((found / gain).ln().abs() < 0.02, "{method:?}, gain {gain}: found {found:.3}");
        }
    }
}
