//! A frame as the photometric code sees it.

use super::distance::distance_to;
use super::exposure::SATURATED;
use super::frame::{Frame, LUMA};
use super::{ColorImage, Mask, ToneCurve, saturation};

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
    /// A grey recording: next to no pixel has a colour.
    pub grey: bool,
}

/// Largest difference of the channels of a pixel without colour, in roots of light (about encoded
/// values): lossy coding of a grey picture leaves a hundredth.
const GREY: f32 = 0.024;

/// Least part of a picture that has colour where its camera has: tissue is red, and instruments
/// and a dark surround never cover all of it.
const COLOURED: f64 = 0.01;

impl Picture {
    /// Of an encoded frame.
    pub fn of(frame: &Frame, tone: &ToneCurve) -> Self {
        let clipped = frame.rgb.iter().map(|p| p.map(|v| v >= SATURATED)).collect();
        let saturated = saturation(frame);
        let to_saturated = distance_to(&saturated).data;
        let linear = frame.linear(tone);
        let grey = is_grey(linear.data.iter());
        Self { linear, clipped, saturated, to_saturated, grey }
    }

    /// Tissue of this colour, linear light, as it looks in this picture: itself, or grey. Luma is
    /// of encoded values, which are about the roots of light.
    pub fn shown(&self, colour: [f32; 3]) -> [f32; 3] {
        if !self.grey {
            return colour;
        }
        let luma: f32 = (0..3).map(|c| LUMA[c] * colour[c].sqrt()).sum();
        [luma * luma; 3]
    }
}

/// Whether next to none of these, linear light or albedo, has a colour.
pub(crate) fn is_grey<'a>(of: impl Iterator<Item = &'a [f32; 3]>) -> bool {
    let (mut all, mut coloured) = (0_usize, 0_usize);
    for p in of {
        let (least, most) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
        all += 1;
        coloured += usize::from(most.sqrt() - least.sqrt() > GREY);
    }
    (coloured as f64) < COLOURED * all as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rgb: impl Fn(usize) -> [u8; 3]) -> Picture {
        let frame = Frame { name: "f".into(), size: [20, 20], rgb: (0..400).map(rgb).collect() };
        Picture::of(&frame, &ToneCurve::Srgb)
    }

    #[test]
    fn a_grey_recording_is_told_and_shows_the_luma_of_tissue() {
        let tissue = |i: usize| [120 + (i % 50) as u8, 60 + (i % 30) as u8, 50];
        let luma = |[r, g, b]: [u8; 3]| {
            (0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b)).round() as u8
        };
        let coloured = of(tissue);
        let grey = of(|i| [luma(tissue(i)); 3].map(|v| v + (i % 2) as u8));
        assert!(!coloured.grey && grey.grey);
        for i in 0..400 {
            let light = coloured.linear.data[i];
            assert_eq!(coloured.shown(light), light);
            let [shown, seen] = [grey.shown(light)[0], grey.linear.data[i][0]];
            // One level is 2 %, and sRGB's roots are 3 % from these; the mean of the light is 15 %.
            assert!((shown / seen).ln().abs() < 0.06, "{shown} {seen}");
        }
        // A round viewport on black, of which a tenth is tissue, and metal beside it.
        assert!(!of(|i| if i < 40 { tissue(i) } else { [(i % 3) as u8 * 50; 3] }).grey);
    }
}
