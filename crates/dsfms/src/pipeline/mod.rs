//! One deformed frame through all stages of a method.

mod frame_solve;
pub mod inputs;
mod logging;
pub(crate) mod moved;
pub mod progress;
pub mod reconstruct;
mod reconstruct_options;
mod sight;
pub mod sources;
mod stage_log;
mod surroundings;
pub mod template;
mod trust;

pub(crate) use frame_solve::joined;
pub use progress::{Progress, Silent};
pub use reconstruct::{reconstruct, reconstruct_with};
pub(crate) use reconstruct_options::FRAME_TABLES;
pub use reconstruct_options::ReconstructOptions;
pub use surroundings::CameraSight;
pub(crate) use surroundings::sighted;
pub use template::{
    BuiltTemplate, Exploration, FoundOrgan, FramePrecision, Organ, OrganClick, OrganGuess,
    OrganOptions, OrganOutline, OrganScene, OrganSceneError, OrganStroke, SparsePrecision,
    StrokeError, TemplateError, TemplateOptions, drawn_from, read_strokes, strokes_from,
    template_from_frames, template_from_mesh, template_from_posed_frames, template_from_poses,
    write_strokes,
};

use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point3};
use crate::image::{Frame, Mask, Outline, ToneCurve};
use crate::light::LightModel;
use crate::options::OptionError;
use crate::register::{Match, RegisterError};
use crate::sfs::SfsError;
use crate::solver::Summary;
use crate::template::Template;
use crate::verdict::{Evidence, Region, Verdict};
use serde::{Deserialize, Serialize};

/// How a deformed frame is reconstructed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Rigid pose of the template only.
    Rigid,
    /// Shape from shading alone (perspective, light at the camera), given the rigid registration.
    Sfs,
    /// Motion only (eq. 3).
    Dsfm,
    /// Motion and shading (eq. 4).
    Dsfms,
    /// Motion, prior and shading in one problem (beyond the paper).
    Joint,
}

impl Method {
    /// Its name in files: `rigid`, `sfs`, `dsfm`, `dsfms` or `joint`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rigid => "rigid",
            Self::Sfs => "sfs",
            Self::Dsfm => "dsfm",
            Self::Dsfms => "dsfms",
            Self::Joint => "joint",
        }
    }

    /// Where none is asked for: the best that the template allows.
    pub fn best_for(template: &Template) -> Self {
        if template.albedo.is_some() { Self::Joint } else { Self::Dsfm }
    }
}

/// What is known of one deformed frame.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    /// The image.
    pub frame: &'a Frame,
    /// Camera of this frame.
    pub camera: &'a CameraModel,
    /// Tone curve of this frame.
    pub tone: &'a ToneCurve,
    /// Light of the camera file, where the template knows none.
    pub light: Option<&'a LightModel>,
    /// Fall-off of this frame's lens towards the border, where it is known; else that of the
    /// exploration.
    pub vignetting: Option<f64>,
    /// Given matches; `None` = find them by the template's descriptors.
    pub matches: Option<&'a [Match]>,
    /// `true` where an instrument covers the organ.
    pub instrument: Option<&'a Mask>,
    /// `true` where the organ is the first surface hit.
    pub organ: Option<&'a Mask>,
}

impl<'a> Observation<'a> {
    /// A frame of a camera: sRGB, matches to be found, no instrument, the organ anywhere.
    ///
    /// ```
    /// use dsfms::{Observation, synth::Case};
    ///
    /// let case = Case::example(1);
    /// let observation = Observation::new(&case.frame, &case.camera).matches(&case.matches);
    /// assert_eq!(observation.matches.map(<[_]>::len), Some(case.matches.len()));
    /// ```
    pub fn new(frame: &'a Frame, camera: &'a CameraModel) -> Self {
        let tone = &ToneCurve::Srgb;
        let (light, vignetting) = (None, None);
        Self {
            frame,
            camera,
            tone,
            light,
            vignetting,
            matches: None,
            instrument: None,
            organ: None,
        }
    }

    /// With another tone curve than sRGB.
    pub fn tone(self, tone: &'a ToneCurve) -> Self {
        Self { tone, ..self }
    }

    /// With the light that counts where the template knows none (a bare mesh).
    pub fn light(self, light: impl Into<Option<&'a LightModel>>) -> Self {
        Self { light: light.into(), ..self }
    }

    /// With the known fall-off of this frame's lens towards the border
    /// ([`crate::light::vignetting`]).
    pub fn vignetting(self, vignetting: impl Into<Option<f64>>) -> Self {
        Self { vignetting: vignetting.into(), ..self }
    }

    /// With given matches; none are looked for.
    pub fn matches(self, matches: &'a [Match]) -> Self {
        Self { matches: Some(matches), ..self }
    }

    /// With a mask that is `true` where an instrument covers the organ.
    pub fn instrument(self, instrument: impl Into<Option<&'a Mask>>) -> Self {
        Self { instrument: instrument.into(), ..self }
    }

    /// With a mask that is `true` where the organ is the first surface hit.
    pub fn organ(self, organ: impl Into<Option<&'a Mask>>) -> Self {
        Self { organ: organ.into(), ..self }
    }
}

/// The surface of one frame.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// Whether it can be believed; [`crate::verdict::Level::Lost`] within
    /// [`ReconstructError::Refused`] alone.
    pub verdict: Verdict,
    /// The figures it rests on.
    pub evidence: Evidence,
    /// Vertices in camera axes, template's unit and vertex order.
    pub vertices: Vec<Point3>,
    /// Rigid part: `camera_from_template`.
    pub pose: Isometry,
    /// Seen by the camera (z-buffer, instruments and organ mask applied).
    pub visible: Vec<bool>,
    /// Expected error per vertex, length units, where the method gives one.
    pub expected_error: Option<Vec<f64>>,
    /// Nine vertices of ten are off by less than this multiple of their expected error.
    pub error_bound: Option<f64>,
    /// `false` where nothing in the frame spoke of a vertex; as
    /// [`crate::expected_error::ExpectedErrors::observed`].
    pub observed: Option<Vec<bool>>,
    /// What is known of every vertex.
    pub regions: Vec<Region>,
    /// Exposure gain relative to the template's albedo; 1 for methods without shading.
    pub gain: f64,
    /// Ambient light, linear; 0 for methods without shading.
    pub ambient: f64,
    /// Matches used: all given or found, with `true` for those that were kept.
    pub matches: Vec<(Match, bool)>,
    /// Vertices or samples that shading was read from, where the method reads any.
    pub shaded: Option<usize>,
    /// The organ's outline in the frame (px) as its colours show it: method joint, where no organ
    /// mask is given and colours tell it.
    pub outline: Option<Outline>,
    /// Name, wall time in seconds and solver report of every stage, in order.
    pub stages: Vec<StageReport>,
}

impl Reconstruction {
    /// The surface whatever is thought of it, for experiments: one that left out what is refused
    /// would flatter its method.
    ///
    /// # Errors
    /// No surface at all.
    pub fn even_refused(found: Result<Self, ReconstructError>) -> Result<Self, ReconstructError> {
        match found {
            Err(ReconstructError::Refused(found)) => Ok(*found),
            found => found,
        }
    }
}

/// One stage of a reconstruction.
#[derive(Clone, Debug, Serialize)]
pub struct StageReport {
    /// `mesh`, `prepare`, `matching`, `pose`, `register (eq. 3)`, `refine (eq. 4)`, `outline`,
    /// `joint`, `matching again`, `sfs`, `visibility`, `expected error`, `verdict`: all that a
    /// reconstruction does. A name may come twice.
    pub name: String,
    /// Wall time, seconds.
    pub seconds: f64,
    /// The solve, where the stage has one.
    pub summary: Option<Summary>,
}

/// Why a frame gave no surface.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReconstructError {
    /// No rigid pose: too few matches, or none that they agree on.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// Shape from shading alone found nothing to shade.
    #[error(transparent)]
    Sfs(#[from] SfsError),
    /// The template has no descriptors and no matches were given.
    #[error(
        "the template holds no descriptors, so matches cannot be found automatically; give them with the frame"
    )]
    NoDescriptors,
    /// A shading method without albedo.
    #[error(
        "method {0:?} needs an albedo, and the template has none; build it from frames, or give its mesh one"
    )]
    NoAlbedo(Method),
    /// Image and camera disagree.
    #[error(
        "the frame is {found:?} px but the camera file says {expected:?}; use the camera file of this resolution"
    )]
    SizeMismatch {
        /// Size of the frame.
        found: [usize; 2],
        /// Size in the camera file.
        expected: [usize; 2],
    },
    /// A mask of the frame has another size.
    #[error(
        "the {what} is {found:?} px but the frame {expected:?}; give a mask of this very frame"
    )]
    MaskSize {
        /// Which mask.
        what: &'static str,
        /// Its size.
        found: [usize; 2],
        /// Size of the frame.
        expected: [usize; 2],
    },
    /// A given match of another template.
    #[error(
        "match {index} names face {face}, but the template has {faces}; give matches of this template"
    )]
    MatchFace {
        /// Place in the list, from 0.
        index: usize,
        /// The face.
        face: u32,
        /// Faces of the template.
        faces: usize,
    },
    /// A surface that must not be shown; experiments measure it all the same.
    #[error("the surface cannot be believed: {}", .0.verdict)]
    Refused(Box<Reconstruction>),
    /// Nothing visible in the frame.
    #[error("the frame is black (brightest pixel {0} of 255); nothing can be reconstructed")]
    Black(u8),
}
