//! A template from frames: camera poses, surface, light and albedo, all from eight pictures of the
//! organ at rest; a known camera step makes its lengths mm.
//!
//!     cargo run --example 1_template

use dsfms::eval::{Alignment, EvaluateOptions, Truth, evaluate};
use dsfms::synth::Case;
use dsfms::template::scale::ScaleReference;
use dsfms::{Exploration, Silent, TemplateOptions, template_from_frames};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    println!("median distance to the true surface: {:.3} mm", run()?);
    Ok(())
}

/// Median distance of the template's vertices to the true surface, mm.
pub fn run() -> Result<f64, Box<dyn Error>> {
    // Frames as `read_frames` gives them from files; here they are rendered.
    let case = Case::example(1);
    let (frames, poses) = case.explore(8);
    let exploration = Exploration::new(&frames, &case.camera);

    // How far the camera moved between two frames: a tracked laparoscope, or a ruler.
    let centre = |k: usize| poses[k].inverse().translation.vector;
    let step = ScaleReference::CameraStep {
        frames: [frames[0].name.clone(), frames[4].name.clone()],
        millimetres: (centre(4) - centre(0)).norm(),
    };
    let options = TemplateOptions { vertices: 300, scale: vec![step], ..Default::default() };

    let built = template_from_frames(&exploration, &options, &Silent)?;
    let template = &built.template;
    println!("{} vertices, unit {:?}", template.mesh.positions.len(), template.unit);
    println!("{} of {} frames have a pose", template.views.len(), frames.len());
    for (name, why) in &built.rejected {
        println!("frame {name} is left out: {why}");
    }

    // The template's world is its own: it is placed on the truth before the two are compared.
    let truth = Truth::new(&case.template.mesh);
    let aligned = EvaluateOptions { alignment: Alignment::Rigid };
    let errors = evaluate(&template.mesh, &truth, &aligned)?;
    Ok(errors.found_to_truth.median)
}
