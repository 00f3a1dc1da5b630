//! Pixels in memory: encoded frames, linear colour, one-channel planes, masks, tone curves.

use crate::geometry::Point2;

pub(crate) mod affine;
mod bilinear;
pub mod clahe;
pub mod corners;
pub(crate) mod cut;
pub mod distance;
pub mod exposure;
pub mod filter;
pub mod flow;
pub mod mask;
mod morphology;
pub mod names;
pub mod outline;
pub mod picture;
pub mod plane;
mod polygon;
mod reduced;
pub(crate) mod segment;
pub mod tone;
pub mod viewport;

pub(crate) use bilinear::Bilinear;
pub(crate) use clahe::clahe;
pub use exposure::{halo, saturation};
pub use mask::Mask;
pub use outline::Outline;
pub use picture::Picture;
pub use plane::{ColorImage, Plane};
pub use tone::ToneCurve;
pub use viewport::{usable, viewport};

/// Diagonal of an image, px: the length that limits in the image are stated in.
pub fn diagonal([width, height]: [usize; 2]) -> f64 {
    (width as f64).hypot(height as f64)
}

/// Column and row of the pixel whose centre is nearest to a place, px; `None` beside the image.
pub(crate) fn nearest_pixel(p: &Point2, [w, h]: [usize; 2]) -> Option<[usize; 2]> {
    let (x, y) = (p.x.round(), p.y.round());
    let inside = x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64;
    inside.then_some([x as usize, y as usize])
}

/// Whether a place lies in the rectangle of the pixels' centres.
pub(crate) fn within_centres(p: &Point2, size: [usize; 2]) -> bool {
    let [w, h] = size.map(|n| n as f64 - 1.0);
    p.x >= 0.0 && p.y >= 0.0 && p.x <= w && p.y <= h
}

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
