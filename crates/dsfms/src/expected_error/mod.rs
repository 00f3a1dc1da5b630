//! How far each vertex is expected to be from the truth (§8.1's error, predicted).
//!
//! `error = R exp(w · f)`: `R` is the radius of a disc of the visible area, `f` are dimensionless
//! features of a vertex ([`mod@features`]) that each grow with what makes a vertex uncertain, `w` ≥
//! 0 is fitted once on synthetic cases, clips and path-traced scenes ([`model`]). So the expected
//! error scales with the unit, is finite everywhere, and never falls with the distance to evidence.

pub mod features;
pub mod model;
mod solved;

use crate::refine::Photograph;
pub use features::{COUNT, ErrorFeatures, NAMES, features};
pub use model::Model;
pub use solved::Solved;

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
