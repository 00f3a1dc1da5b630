//! A surface that one of the attempts on a frame gave, which of two shows the frame better, and the
//! one that the next frame is followed from.

use super::Surface;
use super::exposed::Shown;
use super::look::Look;
use super::places::{Earlier, FollowedPlace};
use crate::geometry::{Isometry, Point3};
use crate::verdict::Verdict;
use std::cmp::Ordering;
use std::sync::Arc;

/// A surface with its judgement.
pub(super) struct Candidate {
    pub(super) verdict: Verdict,
    pub(super) surface: Surface,
    pub(super) look: Arc<Look>,
    pub(super) ambient: f64,
    pub(super) shown: Shown,
    pub(super) jumped: bool,
    /// What descriptors found and the surface explains.
    pub(super) places: Vec<FollowedPlace>,
}

impl Candidate {
    /// Whether it shows the frame better than another: by its verdict, else by the brightness it
    /// leaves unexplained, else by what looks alike.
    pub(super) fn beats(&self, other: &Self) -> bool {
        let (a, b) = (&self.surface, &other.surface);
        let alike = || match (a.photometric, b.photometric) {
            (Some(a), Some(b)) => a < b,
            _ => a.agreement > b.agreement,
        };
        match self.verdict.level.cmp(&other.verdict.level) {
            Ordering::Less => true,
            Ordering::Greater => false,
            Ordering::Equal => alike(),
        }
    }
}

/// The last surface that was not lost.
#[derive(Clone)]
pub(super) struct Last {
    pub(super) frame: usize,
    pub(super) vertices: Vec<Point3>,
    /// `camera_from_template` of its matches.
    pub(super) pose: Isometry,
    pub(super) ambient: f64,
    pub(super) look: Arc<Look>,
    /// Where the next frame may show it.
    pub(super) ahead: Vec<Point3>,
    /// Some frames before, or this one.
    pub(super) earlier: Arc<Earlier>,
}
