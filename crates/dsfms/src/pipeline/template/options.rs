//! Options of template building.

use super::{Organ, OrganStroke, TemplateError};
use crate::dense::DenseOptions;
use crate::mesh::remesh::RemeshOptions;
use crate::options::{Documented, Moved, check, commented, from_zero, positive, read};
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
        let Self { vertices, remesh, flatten, light, albedo, anchor, .. } = self;
        let strokes = self.organ.strokes();
        let anchoring = [anchor.merge_px, anchor.merge_deg, anchor.contour_px, anchor.grazing_cos];
        check(&[
            ("organ.strokes", strokes.iter().all(OrganStroke::is_sound), "places near the frames"),
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
            ("albedo.max_texels", (1..=1 << 28).contains(&albedo.max_texels), "from 1 to 2^28"),
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

/// Where the fields of earlier versions stand.
const MOVED: [Moved; 4] = [
    Moved::To("outlines", "organ.outlines"),
    Moved::To("click", "organ.click"),
    Moved::To("strokes", "organ.strokes"),
    Moved::To("whole", "organ.whole"),
];

/// Where the fields of the options are documented.
const TABLES: [Documented; 12] = [
    ("", include_str!("options.rs"), "TemplateOptions"),
    ("organ", include_str!("organ.rs"), "OrganOptions"),
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
