//! What a template is built from.

use crate::camera::CameraModel;
use crate::checkpoint::{Keep, Store};
use crate::image::{Frame, Mask, ToneCurve};
use crate::light::LightModel;
use crate::mesh::Mesh;

/// The exploration: frames of the organ at rest, one camera.
#[derive(Clone, Copy, Debug)]
pub struct Exploration<'a> {
    /// Frames of one size, that of the camera.
    pub frames: &'a [Frame],
    /// `true` where a pixel may be used (viewport, no instrument); one per frame, or empty.
    pub valid: &'a [Option<Mask>],
    /// `true` where the organ is the first surface hit; one per frame, or empty.
    pub organ: &'a [Option<Mask>],
    /// Intrinsics of all frames.
    pub camera: &'a CameraModel,
    /// Tone curve of all frames.
    pub tone: &'a ToneCurve,
    /// Light of the camera file, if it names one: the start of its estimation.
    pub light: Option<&'a LightModel>,
    /// Fall-off of the image towards its border, where the camera file names one: it is not
    /// estimated then.
    pub vignetting: Option<f64>,
    /// A surface of the organ in mm, in any place: it gives a template from frames its scale.
    pub metric: Option<&'a Mesh>,
    /// Frames of the deformed organ, by the same camera: what moves apart in them is apart.
    pub also: &'a [Frame],
    /// Where the values of finished stages (features, matches, poses, depth) are kept.
    pub keep: Keep<'a>,
}

impl<'a> Exploration<'a> {
    /// Frames of one camera: every pixel may be used and show the organ, sRGB, nothing known of
    /// light and scale.
    ///
    /// ```
    /// use dsfms::{Exploration, synth::Case};
    ///
    /// let case = Case::example(1);
    /// let (frames, _) = case.explore(2);
    /// let exploration = Exploration::new(&frames, &case.camera).light(case.template.light.as_ref());
    /// assert!(exploration.valid.is_empty() && exploration.light.is_some());
    /// ```
    pub fn new(frames: &'a [Frame], camera: &'a CameraModel) -> Self {
        let tone = &ToneCurve::Srgb;
        Self {
            frames,
            valid: &[],
            organ: &[],
            camera,
            tone,
            light: None,
            vignetting: None,
            metric: None,
            also: &[],
            keep: Keep::default(),
        }
    }

    /// With masks of the pixels that may be used; one per frame, or empty.
    pub fn valid(self, valid: &'a [Option<Mask>]) -> Self {
        Self { valid, ..self }
    }

    /// With masks of the organ; one per frame, or empty.
    pub fn organ(self, organ: &'a [Option<Mask>]) -> Self {
        Self { organ, ..self }
    }

    /// With another tone curve than sRGB.
    pub fn tone(self, tone: &'a ToneCurve) -> Self {
        Self { tone, ..self }
    }

    /// With the light that its estimation starts from.
    pub fn light(self, light: impl Into<Option<&'a LightModel>>) -> Self {
        Self { light: light.into(), ..self }
    }

    /// With the known fall-off of the image towards its border ([`crate::light::vignetting`]).
    pub fn vignetting(self, vignetting: impl Into<Option<f64>>) -> Self {
        Self { vignetting: vignetting.into(), ..self }
    }

    /// With frames of the deformed organ, which help to tell it from what stays.
    pub fn also(self, also: &'a [Frame]) -> Self {
        Self { also, ..self }
    }

    /// With a surface of the organ in mm, which tells the scale.
    pub fn metric(self, metric: impl Into<Option<&'a Mesh>>) -> Self {
        Self { metric: metric.into(), ..self }
    }

    /// With a store for the values of finished stages: a run begins behind the last that is there
    /// for the same frames and options. The template has the same bits either way.
    pub fn keep(self, store: &'a dyn Store) -> Self {
        Self { keep: Keep::new(store), ..self }
    }
}
