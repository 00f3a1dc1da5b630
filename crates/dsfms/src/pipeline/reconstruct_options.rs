//! Options of a reconstruction.

use super::moved::MOVED;
use crate::image::diagonal;
use crate::options::{Documented, OptionError, commented, read};
use crate::refine::{Comparison, JointOptions, Photograph, RefineOptions};
use crate::register::{Body, CameraMotion, Match, RegisterOptions};
use crate::sfs::SfsOptions;
use crate::verdict::Thresholds;
use serde::{Deserialize, Serialize};

/// Options of a reconstruction. Lengths in pixels are those of an image of 640×480 and scale with
/// the diagonal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReconstructOptions {
    /// Seed of every random draw.
    pub seed: u64,
    /// Solve eqs. 3 and 4 as printed in the paper instead of the repaired form.
    pub literal: bool,
    /// Method joint adds the matches that descriptors find to those that are given.
    pub find_beside_given: bool,
    /// Weights of the pose and of eq. 3.
    pub register: RegisterOptions,
    /// Weights of eq. 4.
    pub refine: RefineOptions,
    /// Weights of the joint solve.
    pub joint: JointOptions,
    /// Shape from shading alone.
    pub sfs: SfsOptions,
    /// When a surface is believed.
    pub verdict: Thresholds,
}

impl Default for ReconstructOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            literal: false,
            find_beside_given: true,
            register: RegisterOptions::default(),
            refine: RefineOptions::default(),
            joint: JointOptions::default(),
            sfs: SfsOptions::default(),
            verdict: Thresholds::default(),
        }
    }
}

impl ReconstructOptions {
    /// Options from TOML; what the text does not name keeps its default.
    ///
    /// # Errors
    /// Malformed TOML, a field that does not exist, or one out of its bounds.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        let options = read(&Self::default(), text, "", &MOVED)?;
        options.validate().map_err(serde::de::Error::custom)?;
        Ok(options)
    }

    /// The defaults as TOML, every field under its documentation.
    pub fn commented() -> String {
        commented(&Self::default(), &FRAME_TABLES)
    }

    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        self.register.validate()?;
        self.refine.validate()?;
        self.joint.validate()?;
        self.sfs.validate()?;
        self.verdict.validate()
    }

    /// What decides how much of a deformation stays.
    pub(crate) fn comparison<'a>(
        &'a self,
        body: &'a Body,
        matches: &'a [Match],
        photo: &'a Photograph,
    ) -> Comparison<'a> {
        let sigma_px = self.register.match_sigma_px;
        Comparison { body, matches, sigma_px, photo, options: &self.joint }
    }

    /// The same for frames of a size, px: lengths in pixels are stated for [`DIAGONAL`] and grow
    /// with the image.
    pub(super) fn at_size(mut self, size: [usize; 2]) -> Self {
        let scale = diagonal(size) / DIAGONAL;
        let (register, joint) = (&mut self.register, &mut self.joint);
        register.match_sigma_px *= scale;
        register.robust_px = register.robust_px.map(|px| scale * px);
        joint.match_px *= scale;
        joint.silhouette_px *= scale;
        self
    }

    /// The same for the form of eqs. 3 and 4 that is asked for: as printed they know the given
    /// matches alone, no camera but that of the matches, and no grazing or coloured light.
    pub(super) fn in_form(mut self) -> Self {
        if self.literal {
            self.find_beside_given = false;
            self.register.camera_motion = CameraMotion::Moving;
            self.refine = self.refine.as_printed();
        }
        self
    }
}

/// Image diagonal that lengths in pixels are stated for: 640×480.
const DIAGONAL: f64 = 800.0;

/// Where the fields of the options are documented.
pub(crate) const FRAME_TABLES: [Documented; 11] = [
    ("", include_str!("reconstruct_options.rs"), "ReconstructOptions"),
    ("register", include_str!("../register/options.rs"), "RegisterOptions"),
    ("register.prior", include_str!("../register/options.rs"), "PriorWeights"),
    ("refine", include_str!("../refine/options.rs"), "RefineOptions"),
    ("refine.image", include_str!("../refine/photometric_model.rs"), "PhotometricModel"),
    ("joint", include_str!("../refine/joint_options.rs"), "JointOptions"),
    ("joint.prior", include_str!("../register/options.rs"), "PriorWeights"),
    ("joint.image", include_str!("../refine/photometric_model.rs"), "PhotometricModel"),
    ("joint.exposure_unknown", include_str!("../refine/joint_options.rs"), "ExposureUnknown"),
    ("sfs", include_str!("../sfs/options.rs"), "SfsOptions"),
    ("verdict", include_str!("../verdict/thresholds.rs"), "Thresholds"),
];
