//! How far each vertex is expected to be from the truth (§8.1's error, predicted).
//!
//! `error = R exp(w · f)`: `R` is the radius of a disc of the visible area, `f` are dimensionless
//! features of a vertex ([`mod@features`]) that each grow with what makes a vertex uncertain, `w` ≥
//! 0 is fitted once on synthetic cases, clips and path-traced scenes ([`model`]). So the expected
//! error scales with the unit, is finite everywhere, and never falls with the distance to evidence.

pub mod features;
pub mod model;

use crate::geometry::Point3;
use crate::refine::{Photograph, RefineOptions};
use crate::register::{Match, Scene};
pub use features::{COUNT, ErrorFeatures, NAMES, features};
pub use model::Model;

/// A reconstructed frame and what it was made from.
#[derive(Clone, Copy)]
pub struct Solved<'a> {
    /// The frame with the rest shape posed rigidly.
    pub scene: &'a Scene<'a>,
    /// Vertices in camera axes.
    pub vertices: &'a [Point3],
    /// Vertices the camera sees, not covered by an instrument.
    pub visible: &'a [bool],
    /// Matches, with `true` for those that were kept.
    pub matches: &'a [(Match, bool)],
    /// The image and albedo, where the template has one; motion alone is judged by them too.
    pub photo: Option<&'a Photograph<'a>>,
    /// Which brightness can be used; of eq. 4 for every method, as the model was fitted.
    pub refine: &'a RefineOptions,
}

/// Expected error of every vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct ExpectedErrors {
    /// Expected distance from the truth, length units of the vertices; finite and positive.
    pub errors: Vec<f64>,
    /// Nine vertices of ten, and the deformed zone in nine frames of ten, are off by less than this
    /// multiple of their expected error.
    pub bound: f64,
    /// `true` where the frame says something about the vertex: it is seen, and a kept match or a
    /// brightness that can be used lies within [`features::REACH`] visible radii along the surface.
    /// Elsewhere the vertex is held by the prior alone.
    pub observed: Vec<bool>,
}

/// Predict the error of every vertex.
#[doc(alias("expected error", "uncertainty"))]
pub fn expected_errors(solved: &Solved, model: Model) -> ExpectedErrors {
    let found = features(solved);
    let weights = model.weights();
    let grey = solved.photo.is_some_and(Photograph::lost_colour);
    let more = if grey && model.reads_shading() { model::GREY } else { 1.0 };
    let error = |f: &[f64; COUNT]| {
        let sum: f64 = f.iter().zip(weights).map(|(f, w)| f * w).sum();
        found.radius * (sum + more.ln()).min(model::LARGEST).exp()
    };
    ExpectedErrors {
        errors: found.values.iter().map(error).collect(),
        bound: model.bound(),
        observed: found.observed,
    }
}
