//! A frame as the photometric code sees it.

use super::distance::distance_to;
use super::exposure::SATURATED;
use super::{ColorImage, Frame, Mask, ToneCurve, saturation};

/// Linear light of a frame, and where it is not to be believed.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Linear light in `[0, 1]`.
    pub linear: ColorImage,
    /// Which channels of a pixel are clipped.
    pub clipped: Vec<[bool; 3]>,
    /// `true` where all channels are: the white core of a highlight.
    pub saturated: Mask,
    /// Distance of every pixel from the nearest such core, px, row major; the image diagonal
    /// everywhere where there is none.
    pub to_saturated: Vec<f32>,
}

impl Picture {
    /// Of an encoded frame.
    pub fn of(frame: &Frame, tone: &ToneCurve) -> Self {
        let clipped = frame.rgb.iter().map(|p| p.map(|v| v >= SATURATED)).collect();
        let saturated = saturation(frame);
        let to_saturated = distance_to(&saturated).data;
        Self { linear: frame.linear(tone), clipped, saturated, to_saturated }
    }
}
