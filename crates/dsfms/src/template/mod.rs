//! The template: rest surface, flattening, texture, albedo, descriptors (paper §4, §5).

pub mod albedo;
mod albedo_options;
pub mod anchor;
pub mod bake;
mod combine;
pub mod flatten;
mod known_light;
pub mod light_fit;
mod log_linear;
mod normal_map;
pub mod photometric;
mod relief;
pub mod scale;
mod spots;
pub mod statistics;
mod surroundings;
#[cfg(test)]
mod test_scene;
pub mod texel_fill;
pub mod texels;
pub mod texture;
pub mod usual;

use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3};
use crate::image::ToneCurve;
use crate::light::{Coat, Coated, LightModel};
use crate::mesh::Mesh;
use serde::{Deserialize, Serialize};
pub(crate) use spots::even_points;
pub use surroundings::Surroundings;
pub use texels::SurfaceTexels;

/// Unit of every length in a template and in what is reconstructed from it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LengthUnit {
    /// Metric: the scale came from a metric mesh, known poses or a reference length.
    Millimetre,
    /// SfM alone: similar to the true shape, of unknown scale.
    #[default]
    TemplateUnit,
}

impl LengthUnit {
    /// As written in file headers: `mm` or `template_units`.
    pub fn label(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::TemplateUnit => "template_units",
        }
    }
}

/// The organ at rest, with all that registration and shading need.
#[derive(Clone, Debug)]
pub struct Template {
    /// Unit of `mesh` and of every pose.
    pub unit: LengthUnit,
    /// Rest surface in the template frame; vertex order is that of the user's mesh if one was
    /// given.
    pub mesh: Mesh,
    /// Number of exploration frames that saw each vertex; empty when there were no frames.
    pub seen: Vec<u32>,
    /// Standard deviation expected of each vertex across the surface, from what the depth maps of
    /// the exploration say of it, in `unit`; infinity where none agrees (a closed hole). Empty
    /// where the mesh was given.
    pub sigma: Vec<f64>,
    /// Conformal flattening, where the topology allows it (cut automatically).
    pub flattening: Option<Flattening>,
    /// Albedo on the surface (eqs. 1, 2), linear units, up to one global factor shared with
    /// `light`.
    pub albedo: Option<SurfaceTexels>,
    /// Descriptors on the surface, for automatic matching.
    pub features: Option<Features>,
    /// Registered exploration frames.
    pub views: Vec<TemplateView>,
    /// Sparse points of structure from motion, by sightings in `views`; empty for given poses.
    pub points: Vec<SparsePoint>,
    /// Camera of the exploration.
    pub camera: Option<CameraModel>,
    /// Tone curve of the exploration frames.
    pub tone: ToneCurve,
    /// Light as calibrated on the exploration frames (or as given).
    pub light: Option<LightModel>,
    /// What the tissue made of that light.
    pub coat: Coat,
    /// How the exploration frames look beside this template; `None` without frames, and in older
    /// templates.
    pub usual: Option<usual::Usual>,
    /// What lies around the organ, where the frames themselves part it from that; `None` in older
    /// templates.
    pub surroundings: Option<Surroundings>,
}

/// What the exploration tells of the exposure of a frame taken with the same camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Expected log gain over the albedo.
    pub log_gain: f64,
    /// Spread of the log gain over the frames of the exploration; infinite of too few to tell.
    pub spread: f64,
}

/// Frames that tell how constant an exposure is.
const TELLING: usize = 4;

impl Template {
    /// What the exploration tells of the exposure; `None` without an exploration.
    pub fn exposure(&self) -> Option<Exposure> {
        let logs: Vec<f64> = self.views.iter().map(|v| v.gain.max(1e-6).ln()).collect();
        let count = logs.len() as f64;
        let mean = logs.iter().sum::<f64>() / count;
        let variance = logs.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let spread = if logs.len() < TELLING { f64::INFINITY } else { variance.sqrt() };
        (!logs.is_empty()).then_some(Exposure { log_gain: 0.0, spread })
    }

    /// The light of a frame and the tissue it falls on.
    pub fn lighting(&self) -> Coated {
        self.lighting_of(None, None)
    }

    /// The same of a frame of another camera file: its `light` where the template knows none, its
    /// own `vignetting`.
    pub(crate) fn lighting_of(
        &self,
        light: Option<&LightModel>,
        vignetting: Option<f64>,
    ) -> Coated {
        let light = self.light.as_ref().or(light).cloned().unwrap_or_default();
        let vignetting = vignetting.unwrap_or(self.coat.vignetting);
        Coated { light, coat: Coat { vignetting, ..self.coat } }
    }
}

/// A sparse point of the exploration.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsePoint {
    /// Position in the template frame.
    pub position: Point3,
    /// Mean encoded colour.
    pub rgb: [u8; 3],
    /// Mean distance of the sightings from the projection, px.
    pub error_px: f64,
    /// Index into [`Template::views`] and pixel of every sighting.
    pub sightings: Vec<(u32, Point2)>,
}

/// One registered exploration frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemplateView {
    /// Name of the frame.
    pub name: String,
    /// `camera_from_template * point_in_template` is in camera axes.
    pub camera_from_template: Isometry,
    /// Exposure gain of the frame relative to the albedo's unit.
    pub gain: f64,
    /// Root mean square reprojection error, px (0 for given poses).
    pub reprojection_px: f64,
}

impl TemplateView {
    /// Whether its figures can be those of a frame.
    pub(crate) fn is_plausible(&self) -> bool {
        let Isometry { rotation, translation } = &self.camera_from_template;
        (rotation.quaternion().norm() - 1.0).abs() < 1e-6
            && translation.vector.iter().all(|v| v.is_finite())
            && self.gain > 0.0
            && self.gain.is_finite()
            && self.reprojection_px.is_finite()
    }
}

/// A conformal flattening: one UV per face corner, so that a seam needs no duplicated vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct Flattening {
    /// UV of the three corners of each face, in `[0, 1]²`.
    pub corners: Vec<[Point2; 3]>,
    /// Edges (vertex pairs) along which the surface was cut open; empty for a disc.
    pub seam: Vec<[u32; 2]>,
    /// Per face: ratio of the singular values of the flattening, 1 = conformal.
    pub quasi_conformal: Vec<f64>,
    /// Per face: ln of (UV area / surface area), centred to mean 0 over the surface: 0 = equal
    /// area.
    pub log_area: Vec<f64>,
}

/// Descriptors anchored to the surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Features {
    /// 128 bytes (RootSIFT scaled to u8) per feature.
    pub descriptors: Vec<[u8; 128]>,
    /// Face of each feature.
    pub faces: Vec<u32>,
    /// Barycentrics of each feature on its face.
    pub barycentrics: Vec<[f64; 3]>,
}
