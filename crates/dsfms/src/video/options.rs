//! How frames are chosen.

use crate::options::{OptionError, check};
use serde::{Deserialize, Serialize};

/// How frames are chosen. Other values are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SelectOptions {
    /// Frames to choose, at most; at least 1. The video is cut into as many windows, of each of
    /// which the sharpest frame is a candidate. Default 48: ten seconds of exploration at about
    /// five frames a second.
    pub max_frames: usize,
    /// Length of a window in frames; `None` = the length of the video over `max_frames`.
    pub stride: Option<usize>,
    /// A candidate must have moved by this much from the frame chosen before it: mean
    /// displacement of its image blocks as a fraction of the image's width, in `[0, 1)`. Default
    /// 0.004 (5 px of 1280): matches that moved less hardly triangulate.
    pub min_motion: f64,
}

impl Default for SelectOptions {
    fn default() -> Self {
        Self { max_frames: 48, stride: None, min_motion: 0.004 }
    }
}

impl SelectOptions {
    /// Check every bound.
    ///
    /// # Errors
    /// The first option out of range, by name.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[
            ("video.max_frames", self.max_frames >= 1, "at least 1"),
            ("video.stride", self.stride != Some(0), "at least 1"),
            ("video.min_motion", (0.0..1.0).contains(&self.min_motion), "from 0 to below 1"),
        ])
    }
}
