//! A video of the deforming organ, frame after frame: find, follow, survive.
//!
//! A frame is first tried from the last shape: patches of the template's albedo, rendered at that
//! shape, are followed into the frame, so that every match is one of the template and nothing
//! drifts. Where that fails, and every so often where it is not quite convincing, the template is
//! found again by its descriptors. Every surface is then looked at: where the frame does not agree
//! with the albedo rendered at it, it is not shown as good.

mod attempts;
mod beside;
mod busy_wait;
mod candidate;
mod clock;
mod covered;
mod expected;
mod exposed;
mod follow;
mod judged;
pub mod look;
mod mips;
mod parts;
mod places;
mod prepare;
mod recent;
mod reduce;
mod search_times;
mod searcher;
mod seek;
pub mod shapes;
mod surface;
mod surroundings;
mod tracker;
mod verdict;

use crate::geometry::{Isometry, Point3};
use crate::options::{Documented, OptionError, below, check, commented, read};
use crate::pipeline::moved::MOVED;
use crate::pipeline::{CameraSight, FRAME_TABLES, Method, ReconstructOptions};
use crate::refine::VideoOptions;
use crate::register::Match;
use crate::verdict::{Reason, Region};
pub use prepare::{Preparation, Prepared, Regions};
pub use searcher::Searcher;
use serde::{Deserialize, Serialize};
pub use tracker::Tracker;

/// Options of a [`Tracker`].
///
/// Measured: `seek`, `seek_every`, `surroundings` (`docs/results/track.md`), `brief_search`,
/// `search_beside`, `awake` (`docs/performance.md`). Other values of `correlation`, `patience` and
/// `search_every` are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackOptions {
    /// Weights of the solves, the seed, and when a surface is believed. Lengths in px are those of
    /// the frames, whatever their size.
    pub reconstruct: ReconstructOptions,
    /// The joint solve from the last shape.
    pub video: VideoOptions,
    /// Least normalised cross-correlation of a followed patch with the template's, in `[-1, 1]`.
    pub correlation: f64,
    /// Frames after the last good one for which its shape is still followed.
    pub patience: usize,
    /// A frame that is followed but degraded is also searched by descriptors when the last such
    /// search lies this many frames back; one that is merely covered, when it was so for 25 frames.
    pub search_every: usize,
    /// Parts of the picture in which, after a followed frame, places of the template without a
    /// match are sought by descriptors near where the surface has them; 0 = none. A part is 64 px
    /// of a picture of at most 1000 px across its diagonal, and is looked at where a third of its
    /// places or more have no match.
    pub seek: usize,
    /// They are sought in every so many frames.
    pub seek_every: usize,
    /// The camera is followed on what lies around the organ too, where the template holds it: where
    /// the organ stretches, its pose is known (`register.camera_motion`).
    pub surroundings: bool,
    /// A surface that is found from nothing is solved by the blurs after a gap and the few steps of
    /// `video`, in place of the joint solve of a single frame: the frames after it do the rest.
    pub brief_search: bool,
    /// Searches are made on a thread of their own where the program runs one
    /// ([`Tracker::searcher`]): frames go on meanwhile, and what is found is followed into the
    /// frame that is at hand by then.
    pub search_beside: bool,
    /// One more thread does not sleep while a frame is solved, and frames are prepared on it: less
    /// time a frame for more of the processor, where it has the cores.
    pub awake: bool,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            reconstruct: ReconstructOptions::default(),
            video: VideoOptions::default(),
            correlation: 0.7,
            patience: 10,
            search_every: 10,
            seek: 4,
            seek_every: 1,
            surroundings: true,
            brief_search: false,
            search_beside: false,
            awake: false,
        }
    }
}

impl TrackOptions {
    /// For a live source: coarser and about twice as fast.
    pub fn realtime() -> Self {
        // A look for places takes as long as a quarter of a frame.
        let video = VideoOptions::realtime();
        Self {
            video,
            seek: 1,
            seek_every: 2,
            brief_search: true,
            search_beside: true,
            awake: true,
            ..Self::default()
        }
    }

    /// Options from TOML; what the text does not name keeps its default.
    ///
    /// # Errors
    /// Malformed TOML, a field that does not exist, or one out of its bounds.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        Self::default().with_toml(text)
    }

    /// The defaults as TOML, every field under its documentation.
    pub fn commented() -> String {
        let all = [below("", &OWN_TABLES), below("reconstruct", &FRAME_TABLES)].concat();
        commented(&Self::default(), &all)
    }

    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        self.reconstruct.validate()?;
        self.video.validate()?;
        check(&[
            (
                "reconstruct.literal",
                !self.reconstruct.literal,
                "false for a video: the printed equations have no start from the last shape",
            ),
            ("correlation", (-1.0..=1.0).contains(&self.correlation), "from -1 to 1"),
            (
                "search_every, seek_every",
                self.search_every >= 1 && self.seek_every >= 1,
                "at least 1",
            ),
        ])
    }

    /// These options with what a TOML text names.
    ///
    /// # Errors
    /// As [`from_toml`](Self::from_toml).
    pub fn with_toml(&self, text: &str) -> Result<Self, toml::de::Error> {
        let all = read(self, text, "reconstruct", &MOVED)?;
        all.validate().map_err(serde::de::Error::custom)?;
        Ok(all)
    }
}

/// Where the fields of the options are documented, beside those of a single frame.
const OWN_TABLES: [Documented; 2] = [
    ("", include_str!("mod.rs"), "TrackOptions"),
    ("video", include_str!("../refine/video.rs"), "VideoOptions"),
];

/// What became of a frame; no surface where it is [`Lost`](crate::verdict::Level::Lost).
pub type TrackStatus = crate::verdict::Level;

/// How a surface came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// By descriptors.
    Found,
    /// From the previous frame.
    Followed,
}

/// The surface of one frame.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Vertices in camera axes, template's unit and vertex order.
    pub vertices: Vec<Point3>,
    /// Vertices that the camera sees.
    pub visible: Vec<bool>,
    /// What is known of every vertex.
    pub regions: Vec<Region>,
    /// Rigid part: `camera_from_template`.
    pub pose: Isometry,
    /// Matches, `true` for those that the surface explains.
    pub matches: Vec<(Match, bool)>,
    /// Median distance of the kept matches from the surface, px.
    pub residual_px: f64,
    /// Their mean distance, px.
    pub reprojection_px: f64,
    /// Mean relative difference of the frame's brightness from what template, light and exposure
    /// predict at the surface; `None` for the method without shading, and where nothing could be
    /// used for it.
    pub photometric: Option<f64>,
    /// How far the depth of the surface is uncertain for the solve of eq. 3, of the visible radius:
    /// it grows with the motion that no rigid pose explains.
    pub depth_uncertainty: f64,
    /// Share of the textured places of the template in view, where the frame may be used, whose
    /// surroundings look like the template's, in `[0, 1]`.
    pub agreement: f64,
    /// Number of such places.
    pub places: usize,
    /// How it came about.
    pub origin: Origin,
}

impl Surface {
    /// Number of matches that the surface explains.
    pub fn matches_kept(&self) -> usize {
        self.matches.iter().filter(|m| m.1).count()
    }
}

/// What a frame gave.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Trust.
    pub status: TrackStatus,
    /// Why not `ok`.
    pub reasons: Vec<Reason>,
    /// The surface; `None` where lost.
    pub surface: Option<Surface>,
    /// The camera as what lies around the organ shows it, whatever becomes of the organ; `None`
    /// where the template or the frame shows too little of that.
    pub camera: Option<CameraSight>,
    /// What a search beside the video found was taken in this frame.
    pub answered: bool,
    /// Wall time of every stage that ran, seconds, in order; last `other`, all that is in none.
    pub stages: Vec<(&'static str, f64)>,
}

impl Tracked {
    /// A frame that could not be read, so that nothing was solved.
    pub fn unread(why: String) -> Self {
        let reasons = vec![Reason::Input { why }];
        Self {
            status: TrackStatus::Lost,
            reasons,
            surface: None,
            camera: None,
            answered: false,
            stages: Vec::new(),
        }
    }

    /// Say of a surface that its frame is not as it was taken.
    pub fn reserve(&mut self, why: String) {
        if self.surface.is_some() {
            self.status = self.status.max(TrackStatus::Degraded);
            self.reasons.push(Reason::Input { why });
        }
    }
}

/// Why a video cannot be tracked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrackError {
    /// Nothing to find the organ by.
    #[error(
        "the template holds no descriptors, so it cannot be found in a video; build it from frames"
    )]
    NoDescriptors,
    /// Nothing to follow.
    #[error("the template holds no albedo, so there is nothing to follow; build it from frames")]
    NoAlbedo,
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// A method that is not for video.
    #[error("method {0:?} does not track; use dsfm or joint")]
    Method(Method),
    /// Image and camera disagree.
    #[error(
        "frame {name} is {found:?} px but the camera file says {expected:?}; use the camera file of this resolution"
    )]
    SizeMismatch {
        /// Name of the frame.
        name: String,
        /// Size of the frame or of its mask.
        found: [usize; 2],
        /// Size in the camera file.
        expected: [usize; 2],
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_changes_what_it_names_and_nothing_else() {
        let base = TrackOptions::realtime();
        let found = base.with_toml("patience = 3\n[video]\nsteps = 7").unwrap();
        let video = VideoOptions { steps: 7, ..base.video.clone() };
        assert_eq!(found, TrackOptions { patience: 3, video, ..base.clone() });
        assert_eq!(base.with_toml("").unwrap(), base);
        let error = base.with_toml("[video]\nstep = 7").unwrap_err().to_string();
        assert!(error.contains("line 2") && error.contains("step"), "{error}");
    }
}
