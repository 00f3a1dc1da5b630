//! One frame as its file holds it.

use super::plane::{ColorImage, Plane};
use super::tone::ToneCurve;

/// Weights of red, green and blue in luma (Rec. 601).
pub(crate) const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// One decoded frame: 8-bit encoded RGB exactly as the file holds it, row major.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// File stem or `frame_NNN` for video; names outputs and error messages.
    pub name: String,
    /// Width and height in px.
    pub size: [usize; 2],
    /// Encoded (not linear) RGB, `size[0] * size[1]` pixels.
    pub rgb: Vec<[u8; 3]>,
}

impl Frame {
    /// Linear light in `[0, 1]` per channel: the only form photometric code may see.
    pub fn linear(&self, tone: &ToneCurve) -> ColorImage {
        let table = tone.table();
        let data = self.rgb.iter().map(|p| p.map(|v| table[v as usize])).collect();
        ColorImage { size: self.size, data }
    }

    /// Encoded grey in `[0, 1]` (Rec. 601 luma): for feature detection, never for photometry.
    pub(crate) fn luma(&self) -> Plane {
        let [r, g, b] = LUMA;
        let luma = |p: &[u8; 3]| (r * p[0] as f32 + g * p[1] as f32 + b * p[2] as f32) / 255.0;
        Plane { size: self.size, data: self.rgb.iter().map(luma).collect() }
    }
}
