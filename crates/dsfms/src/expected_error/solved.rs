//! What an error is expected of.

use crate::geometry::Point3;
use crate::refine::{Photograph, RefineOptions};
use crate::register::{Match, Scene};

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
