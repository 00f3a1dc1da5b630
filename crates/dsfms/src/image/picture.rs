//! A frame as the photometric code sees it.

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
}

impl Picture {
    /// Of an encoded frame.
    pub fn of(frame: &Frame, tone: &ToneCurve) -> Self {
        let clipped = frame.rgb.iter().map(|p| p.map(|v| v >= SATURATED)).collect();
        Self { linear: frame.linear(tone), clipped, saturated: saturation(frame) }
    }
}
