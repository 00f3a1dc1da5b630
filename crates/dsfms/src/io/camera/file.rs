//! What a camera file says.

use crate::camera::CameraModel;
use crate::image::ToneCurve;
use crate::light::LightModel;

/// What a camera file says.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFile {
    /// Intrinsics and lens; pixel centres at integers whatever the file's convention.
    pub camera: CameraModel,
    /// Tone curve, where the file names one.
    pub tone: Option<ToneCurve>,
    /// Light, where the file names one.
    pub light: Option<LightModel>,
    /// Vignetting `a` of the lens, `1 + a r²` with r in focal lengths from the principal point,
    /// where the file names one; negative where corners are dark, at least -2.
    pub vignetting: Option<f64>,
}
