//! `template.toml`: what a template directory holds, readable by people and other programs.

use crate::camera::CameraModel;
use crate::image::ToneCurve;
use crate::light::{Coat, LightModel};
use crate::template::{LengthUnit, TemplateView};
use serde::{Deserialize, Serialize};

/// Version of the layout; raised when an older reader would misunderstand it.
pub(super) const VERSION: u32 = 1;
pub(super) const MANIFEST: &str = "template.toml";
/// Most bytes of it: a hundred thousand frames.
pub(super) const MOST_MANIFEST_BYTES: u64 = 32 << 20;

/// The manifest. Lengths are in `unit`, poses are `camera_from_template`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    pub version: u32,
    pub unit: LengthUnit,
    /// Program that wrote it.
    pub generator: String,
    pub counts: Counts,
    pub tone: ToneCurve,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraModel>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<LightModel>,
    #[serde(default)]
    pub coat: Coat,
    #[serde(default)]
    pub files: Vec<FileNote>,
    #[serde(default)]
    pub views: Vec<TemplateView>,
}

impl Manifest {
    /// Whether what it says can be, as far as no other file is needed; else what is wrong.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(camera) = &self.camera {
            camera.validate().map_err(|e| e.to_string())?;
        }
        if let Some(light) = &self.light {
            light.validate().map_err(|e| e.to_string())?;
        }
        let bounds = "a figure is not finite or out of its bounds";
        if !self.coat.is_plausible() {
            return Err(format!("coat: {bounds}"));
        }
        if !self.tone.is_plausible() {
            return Err("tone: expected a gamma above 0 or 256 values of at least 0".into());
        }
        match self.views.iter().find(|view| !view.is_plausible()) {
            Some(view) => Err(format!("view {:?}: {bounds}", view.name)),
            None => Ok(()),
        }
    }
}

/// Sizes that the other files must agree with.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Counts {
    pub vertices: usize,
    pub faces: usize,
    pub texels: usize,
    pub features: usize,
    pub flattened: bool,
    pub seen: bool,
}

/// One file of the directory.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileNote {
    pub name: String,
    pub content: String,
}

/// Enough to recognise a version we do not know before complaining about its fields.
#[derive(Deserialize)]
pub(super) struct VersionOnly {
    pub version: u32,
}
