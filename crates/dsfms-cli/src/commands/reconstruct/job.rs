//! What a run of `reconstruct` holds.

use super::args::ReconstructArgs;
use crate::inputs::CameraInput;
use crate::progress::Reporter;
use crate::structures::Structures;
use crate::volume::CarriedVolume;
use dsfms::pipeline::{Method, ReconstructOptions};
use dsfms::register::Deformable;
use dsfms::template::Template;

/// Everything that the frames share.
pub struct Job<'a> {
    pub args: &'a ReconstructArgs,
    pub template: Template,
    pub deformable: Deformable,
    pub camera: CameraInput,
    pub method: Method,
    pub options: ReconstructOptions,
    pub structures: Option<Structures>,
    pub volume: Option<CarriedVolume>,
    pub reporter: &'a Reporter,
}
