//! Options of template building.

use super::{OrganClick, OrganOutline, OrganStroke, TemplateError};
use crate::dense::DenseOptions;
use crate::mesh::remesh::RemeshOptions;
use crate::options::{Documented, check, commented, from_zero, positive};
use crate::sfm::SfmOptions;
use crate::template::albedo::AlbedoOptions;
use crate::template::anchor::AnchorOptions;
use crate::template::flatten::FlattenOptions;
use crate::template::light_fit::LightFitOptions;
use crate::template::scale::ScaleReference;
use serde::{Deserialize, Serialize};

/// Options of template building, one field per stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemplateOptions {
    /// Vertices of the template mesh, 100 to 50,000; a given mesh keeps its own.
    pub vertices: usize,
    /// Structure from motion.
    pub sfm: SfmOptions,
    /// Multi-view stereo.
    pub dense: DenseOptions,
    /// Remeshing to `vertices`.
    pub remesh: RemeshOptions,
    /// Flip edges of the remeshed surface where the other diagonal of their two faces lies closer to
    /// what stereo saw ([`crate::mesh::remesh::fit_diagonals`]).
    pub fit_diagonals: bool,
    /// Conformal flattening.
    pub flatten: FlattenOptions,
    /// The organ as outlined on frames; empty = masks alone say what is organ.
    pub outlines: Vec<OrganOutline>,
    /// A pixel that shows the organ: the connected surface there stays.
    pub click: Option<OrganClick>,
    /// Pixels that show the organ, and such that do not, as drawn on frames.
    pub strokes: Vec<OrganStroke>,
    /// Refine the surface of stereo by the shading of all views.
    pub refine_by_shading: bool,
    /// Keep what lies behind the organ too, where depth steps and no mask, outline or click tells them
    /// apart.
    pub whole: bool,
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
            sfm: SfmOptions::default(),
            dense: DenseOptions::default(),
            remesh: RemeshOptions::default(),
            fit_diagonals: true,
            flatten: FlattenOptions::default(),
            outlines: Vec::new(),
            click: None,
            strokes: Vec::new(),
            refine_by_shading: true,
            whole: false,
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
        let options: Self = toml::from_str(text)?;
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
        let Self { vertices, remesh, flatten, light, albedo, anchor, .. } = self;
        let anchoring = [anchor.merge_px, anchor.merge_deg, anchor.contour_px, anchor.grazing_cos];
        check(&[
            ("strokes", self.strokes.iter().all(OrganStroke::is_sound), "places near the frames"),
            ("vertices", (100..=50_000).contains(vertices), "100 to 50,000"),
            ("remesh.rounds", remesh.rounds >= 1, "at least 1"),
            (
                "remesh.corner_deg",
                remesh.corner_deg > 0.0 && remesh.corner_deg <= 180.0,
                "above 0 and at most 180",
            ),
            ("remesh.adaptive", (0.0..=1.0).contains(&remesh.adaptive), "from 0 to 1"),
            (
                "flatten.max_area_ratio",
                flatten.max_area_ratio > 1.0 && flatten.max_area_ratio.is_finite(),
                "a number above 1",
            ),
            ("light.spots", light.spots >= 100, "at least 100"),
            (
                "light.gain_sigma, offset_sigma",
                positive(&[light.gain_sigma, light.offset_sigma]),
                "positive",
            ),
            ("light.refractive_index", light.refractive_index >= 1.0, "at least 1"),
            ("albedo.texels_per_px", positive(&[albedo.texels_per_px]), "positive"),
            ("albedo.max_resolution", (1..=256).contains(&albedo.max_resolution), "from 1 to 256"),
            ("albedo.max_texels", albedo.max_texels >= 1, "at least 1"),
            ("albedo.gain_sigma", positive(&[albedo.gain_sigma]), "positive"),
            ("albedo.refractive_index", albedo.refractive_index >= 1.0, "at least 1"),
            (
                "anchor.merge_px, merge_deg, contour_px, grazing_cos",
                from_zero(&anchoring),
                "0 or more",
            ),
        ])?;
        self.sfm.validate()?;
        Ok(self.dense.validate()?)
    }
}

/// Where the fields of the options are documented.
const TABLES: [Documented; 11] = [
    ("", include_str!("options.rs"), "TemplateOptions"),
    ("sfm", include_str!("../../sfm/options.rs"), "SfmOptions"),
    ("sfm.refine", include_str!("../../sfm/intrinsics.rs"), "RefineIntrinsics"),
    ("dense", include_str!("../../dense/options.rs"), "DenseOptions"),
    ("remesh", include_str!("../../mesh/remesh.rs"), "RemeshOptions"),
    ("flatten", include_str!("../../template/flatten.rs"), "FlattenOptions"),
    ("light", include_str!("../../template/light_fit.rs"), "LightFitOptions"),
    ("light.bounds", include_str!("../../template/photometric.rs"), "ObservationBounds"),
    ("albedo", include_str!("../../template/albedo_options.rs"), "AlbedoOptions"),
    ("albedo.bounds", include_str!("../../template/photometric.rs"), "ObservationBounds"),
    ("anchor", include_str!("../../template/anchor.rs"), "AnchorOptions"),
];
