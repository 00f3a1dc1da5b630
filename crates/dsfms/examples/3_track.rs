//! A video of the deforming organ: the template is found in the first frame by its descriptors and
//! then followed by motion; a black frame is lost, and the next is found again.
//!
//!     cargo run --example 3_track

use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::image::ToneCurve;
use dsfms::pipeline::template_from_posed_frames;
use dsfms::synth::{Case, RenderOptions, render};
use dsfms::track::TrackStatus;
use dsfms::{Exploration, Frame, LengthUnit, Method, Silent, Template, TemplateOptions};
use dsfms::{TrackOptions, Tracker};
use std::error::Error;

/// The frame in which the lens is covered.
pub const COVERED: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}

/// What became of a frame.
pub struct Outcome {
    /// Trust.
    pub status: TrackStatus,
    /// Root mean square error where it has a surface, mm.
    pub rms: Option<f64>,
}

/// Every frame of the video.
pub fn run() -> Result<Vec<Outcome>, Box<dyn Error>> {
    let case = Case::example(5);
    let template = template(&case)?;
    let (tone, options) = (ToneCurve::Srgb, TrackOptions::default());
    let mut tracker = Tracker::new(&template, &case.camera, &tone, Method::Dsfm, options)?;
    let mut all = Vec::new();
    for k in 0..4 {
        let (frame, truth) = frame(&case, k);
        let tracked = tracker.next(&frame, None)?;
        let (status, found) = (tracked.status, tracked.surface.as_ref());
        let rms = found.map(|found| rms(&found.vertices, &truth));
        println!("frame {k}: {status:?}, error {rms:.3?} mm");
        tracked.reasons.iter().for_each(|why| println!("    {why}"));
        all.push(Outcome { status, rms });
    }
    Ok(all)
}

/// On the true rest shape; light, albedo and descriptors are measured in two frames of known pose.
fn template(case: &Case) -> Result<Template, Box<dyn Error>> {
    let (frames, poses) = case.explore(2);
    let poses: Vec<_> = poses.into_iter().map(Some).collect();
    let exploration = Exploration::new(&frames, &case.camera);
    let (mesh, unit) = (case.template.mesh.clone(), LengthUnit::Millimetre);
    let options = TemplateOptions::default();
    let built = template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent)?;
    Ok(built.template)
}

/// A frame and its true vertices in camera axes: the camera moves sideways while the pull grows.
fn frame(case: &Case, k: usize) -> (Frame, Vec<Point3>) {
    let pose = Isometry::new(Vector3::new(0.6 * k as f64, 0.0, 75.0), Vector3::zeros());
    let moved = case.template.mesh.positions.iter().zip(&case.deformation.vertices);
    let truth: Vec<Point3> = moved.map(|(a, b)| pose * (a + (b - a) * (0.1 * k as f64))).collect();
    let mesh = case.template.mesh.with_positions(truth.clone());
    let Template { light, albedo, .. } = &case.template;
    let (light, albedo) = (light.as_ref().expect("given"), albedo.as_ref().expect("given"));
    let look = RenderOptions { seed: k as u64, ..Default::default() };
    let mut frame = render(&case.camera, light, &mesh, albedo, &look);
    if k == COVERED {
        frame.rgb.fill([2; 3]);
    }
    (frame, truth)
}

fn rms(found: &[Point3], truth: &[Point3]) -> f64 {
    let squares = found.iter().zip(truth).map(|(a, b)| (a - b).norm_squared());
    (squares.sum::<f64>() / truth.len() as f64).sqrt()
}
