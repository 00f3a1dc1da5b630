//! The surface in one frame of the deformed organ, by the methods of the paper and by the joint
//! solve: the rigid pose, motion (eq. 3), motion then shading (eq. 4), both in one problem.
//!
//!     cargo run --example 2_reconstruct

use dsfms::synth::Case;
use dsfms::{Method, Observation, ReconstructOptions, reconstruct};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}

/// Root mean square error of every method in the deformed zone, mm.
pub fn run() -> Result<Vec<f64>, Box<dyn Error>> {
    // A template with its albedo, a frame that shows it pulled towards the camera, and 25 matches,
    // none of them in the pulled zone: only shading sees what happens there.
    let case = Case::example(4);
    let observation = Observation::new(&case.frame, &case.camera).matches(&case.matches);
    let options = ReconstructOptions::default();
    let mut errors = Vec::new();
    for method in [Method::Rigid, Method::Dsfm, Method::Dsfms, Method::Joint] {
        let found = reconstruct(&case.template, &observation, method, &options)?;
        let error = case.zone_rms(&found.vertices);
        println!("{method:?}: {error:.3} mm in the deformed zone; {}", found.verdict);
        if let Some(expected) = &found.expected_error {
            let mean = expected.iter().sum::<f64>() / expected.len() as f64;
            println!("    expected error of a vertex, in the mean: {mean:.3} mm");
        }
        errors.push(error);
    }
    Ok(errors)
}
