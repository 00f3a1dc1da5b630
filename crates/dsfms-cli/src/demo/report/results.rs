//! What the demo found.

use crate::demo::METHODS;
use crate::demo::scene::{DeformedFrame, Scene};
use crate::demo::truth::{FrameTruth, Tie};
use crate::outputs::FrameReport;
use dsfms::eval::Evaluation;
use dsfms::pipeline::{BuiltTemplate, Method, Reconstruction};
use dsfms::register::Match;

/// One method on one frame.
pub struct MethodResult {
    pub report: FrameReport,
    /// `None` where it failed.
    pub surface: Option<(Reconstruction, Evaluation)>,
}

/// One deformed frame.
pub struct FrameResult {
    pub name: String,
    pub matches: Vec<Match>,
    /// Matches of the scene, before those off the template were left out.
    pub given_matches: usize,
    pub truth: FrameTruth,
    /// In the order of [`METHODS`].
    pub methods: Vec<MethodResult>,
}

impl FrameResult {
    pub fn new(deformed: &DeformedFrame, matches: Vec<Match>, truth: FrameTruth) -> Self {
        let (name, given_matches) = (deformed.frame.name.clone(), deformed.matches.len());
        Self { name, matches, given_matches, truth, methods: Vec::new() }
    }

    /// Add the result of the next method.
    pub fn add(
        &mut self,
        method: Method,
        outcome: (FrameReport, Option<(Reconstruction, Evaluation)>),
    ) {
        debug_assert_eq!(METHODS[self.methods.len()], method);
        let (report, surface) = outcome;
        self.methods.push(MethodResult { report, surface });
    }
}

/// All that the report shows.
pub struct Report<'a> {
    pub scene: &'a Scene,
    pub built: &'a BuiltTemplate,
    pub tie: &'a Tie,
    pub frames: &'a [FrameResult],
    pub template_seconds: f64,
    pub seconds: f64,
}
