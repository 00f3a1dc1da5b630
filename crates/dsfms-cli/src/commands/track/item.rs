//! One frame of the input on its way from its reader to the solver.

use crate::outputs::FrameMasks;
use dsfms::track::Prepared;
use dsfms::video::frame_name;
use std::time::{Instant, SystemTime};

/// One frame that is taken.
pub struct FrameItem {
    /// Place in the input, from 0.
    pub number: usize,
    /// When it was made, as far as the source tells, else when it came.
    pub time: SystemTime,
    /// When it came.
    pub came: Instant,
    /// Frames of the input, where that is known.
    pub total: Option<usize>,
    /// What is wrong with its mask, or could be.
    pub warnings: Vec<String>,
    pub content: Content,
}

impl FrameItem {
    /// A frame that could not be read.
    pub fn unread(number: usize, why: String) -> Self {
        let content = Content::Unreadable(frame_name(number), why);
        let (time, came) = (SystemTime::now(), Instant::now());
        Self { number, time, came, total: None, warnings: Vec::new(), content }
    }
}

/// What an item holds.
pub enum Content {
    /// A frame.
    Frame(Box<Ready>),
    /// No frame: its name and the reason.
    Unreadable(String, String),
}

/// A frame, ready to be solved.
pub struct Ready {
    pub prepared: Prepared,
    /// What hides the organ and where it is, as far as masks were given.
    pub masks: FrameMasks,
    /// What must be said of it besides.
    pub reservation: Option<String>,
    /// In an earlier run: whether what the search beside found was taken in it.
    pub answered: Option<bool>,
}
