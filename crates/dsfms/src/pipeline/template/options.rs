//! Options of template building.

use super::error::TemplateError;
use super::organ::Organ;
use super::strokes::OrganStroke;
use crate::dense::DenseOptions;
use crate::mesh::remesh::RemeshOptions;
use crate::options::{Documented, Moved, check, commented, read};
use crate::sfm::SfmOptions;
use crate::template::albedo::AlbedoOptions;
use crate::template::anchor::AnchorOptions;
use crate::template::flatten::FlattenOptions;
use crate::template::light_fit::LightFitOptions;
use crate::template::scale::ScaleReference;
use crate::video::SelectOptions;
use serde::{Deserialize, Serialize};

/// Options of template building, one field per stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemplateOptions {
    /// Vertices of the template mesh, 100 to 50,000; a given mesh keeps its own.
    pub vertices: usize,
    /// Which frames of a video are taken.
    pub video: SelectOptions,
    /// Structure from motion.
    pub sfm: SfmOptions,
    /// Multi-view stereo.
    pub dense: DenseOptions,
    /// Remeshing to `vertices`.
    pub remesh: RemeshOptions,
    /// Flip edges of the remeshed surface where the other diagonal of their two faces lies closer
    /// to what stereo saw ([`crate::mesh::remesh::fit_diagonals`]).
    pub fit_diagonals: bool,
    /// Conformal flattening.
    pub flatten: FlattenOptions,
    /// Which part of the frames is the organ.
    pub organ: Organ,
    /// Refine the surface of stereo by the shading of all views.
    pub refine_by_shading: bool,
    /// Known distances; without any the unit of a template from frames is not metric.
    pub scale: Vec<ScaleReference>,
    /// Light estimation.
    pub light: LightFitOptions,
    /// Albedo (eqs. 1, 2).
    pub albedo: AlbedoOptions,
    /// Descriptors on the surface.
    pub anchor: AnchorOptions,
}

impl Default for TemplateOptions {
    fn default() -> Self {
        Self {
            vertices: 1000,
            video: SelectOptions::default(),
            sfm: SfmOptions::default(),
            dense: DenseOptions::default(),
            remesh: RemeshOptions::default(),
            fit_diagonals: true,
            flatten: FlattenOptions::default(),
            organ: Organ::default(),
            refine_by_shading: true,
            scale: Vec::new(),
            light: LightFitOptions::default(),
            albedo: AlbedoOptions::default(),
            anchor: AnchorOptions::default(),
        }
    }
}

impl TemplateOptions {
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
        commented(&Self::default(), &TABLES)
    }

    /// Check every field against its bounds; outlines, clicks and distances are checked against the
    /// frames.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), TemplateError> {
        let strokes = self.organ.strokes();
        check(&[
            ("organ.strokes", strokes.iter().all(OrganStroke::is_sound), "places near the frames"),
            ("vertices", (100..=50_000).contains(&self.vertices), "100 to 50,000"),
        ])?;
        self.video.validate()?;
        self.sfm.validate()?;
        self.dense.validate()?;
        self.remesh.validate()?;
        self.flatten.validate()?;
        self.light.validate()?;
        self.albedo.validate()?;
        Ok(self.anchor.validate()?)
    }
}

/// Where the fields of earlier versions stand.
const MOVED: [Moved; 4] = [
    Moved::To("outlines", "organ.outlines"),
    Moved::To("click", "organ.click"),
    Moved::To("strokes", "organ.strokes"),
    Moved::To("whole", "organ.whole"),
];

/// Where the fields of the options are documented.
const TABLES: [Documented; 13] = [
    ("", include_str!("options.rs"), "TemplateOptions"),
    ("organ", include_str!("organ.rs"), "OrganOptions"),
    ("video", include_str!("../../video/options.rs"), "SelectOptions"),
    ("sfm", include_str!("../../sfm/options.rs"), "SfmOptions"),
    ("sfm.refine", include_str!("../../sfm/intrinsics.rs"), "RefineIntrinsics"),
    ("dense", include_str!("../../dense/options.rs"), "DenseOptions"),
    ("remesh", include_str!("../../mesh/remesh.rs"), "RemeshOptions"),
    ("flatten", include_str!("../../template/flatten.rs"), "FlattenOptions"),
    ("light", include_str!("../../template/light_fit/options.rs"), "LightFitOptions"),
    ("light.bounds", include_str!("../../template/photometric.rs"), "ObservationBounds"),
    ("albedo", include_str!("../../template/albedo_options.rs"), "AlbedoOptions"),
    ("albedo.bounds", include_str!("../../template/photometric.rs"), "ObservationBounds"),
    ("anchor", include_str!("../../template/anchor.rs"), "AnchorOptions"),
];
