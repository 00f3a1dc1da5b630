//! A frame made smaller in one pass, as the stages of tracking want it.

use crate::image::distance::distance_to;
use crate::image::exposure::SATURATED;
use crate::image::filter::halve;
use crate::image::picture::is_grey;
use crate::image::{ColorImage, Frame, LUMA, Mask, Picture, Plane, ToneCurve};
use rayon::prelude::*;
use std::borrow::Cow;

/// What encoded values mean.
#[derive(Clone, Debug)]
pub(super) struct Tables {
    linear: [f32; 256],
    /// Square root of linear light times the weight of the channel.
    bright: [[f32; 256]; 3],
}

impl Tables {
    pub(super) fn of(tone: &ToneCurve) -> Self {
        let linear = tone.table();
        Self { linear, bright: LUMA.map(|weight| linear.map(|v| weight * v.sqrt())) }
    }
}

/// A frame at a fraction of its size; every pixel stands for a square of the frame's.
pub(super) struct Reduced {
    /// Mean square root of linear light.
    pub(super) bright: Plane,
    /// Mean linear light.
    linear: Vec<[f32; 3]>,
    /// Which channels are clipped somewhere in the square, as bits; the fourth: all three in one
    /// pixel.
    clipped: Vec<u8>,
}

/// Bit of [`Reduced::clipped`].
const WHITE: u8 = 8;

impl Reduced {
    /// Halve a frame so many times.
    pub(super) fn of(frame: &Frame, tables: &Tables, halvings: u32) -> Self {
        let side = 1usize << halvings;
        let size = frame.size.map(|n| n >> halvings);
        let n = size[0] * size[1];
        let (mut bright, mut linear) = (vec![0.0; n], vec![[0.0; 3]; n]);
        let mut clipped = vec![0; n];
        let width = size[0].max(1);
        bright
            .par_chunks_mut(width)
            .zip(linear.par_chunks_mut(width))
            .zip(clipped.par_chunks_mut(width))
            .enumerate()
            .for_each(|(y, ((bright, linear), clipped))| {
                for row in y * side..(y + 1) * side {
                    let pixels = &frame.rgb[row * frame.size[0]..][..side * size[0]];
                    for (x, square) in pixels.chunks_exact(side).enumerate() {
                        add(square, tables, &mut bright[x], &mut linear[x], &mut clipped[x]);
                    }
                }
                let share = 1.0 / (side * side) as f32;
                bright.iter_mut().for_each(|v| *v *= share);
                linear.iter_mut().for_each(|v| *v = v.map(|c| c * share));
            });
        Self { bright: Plane { size, data: bright }, linear, clipped }
    }

    /// `true` where some pixel of the square is the white core of a highlight.
    pub(super) fn saturated(&self) -> Mask {
        let data = self.clipped.iter().map(|c| c & WHITE != 0).collect();
        Mask { size: self.bright.size, data }
    }

    /// What shading is read from, halved further.
    pub(super) fn picture(&self, halvings: u32) -> Picture {
        let mut size = self.bright.size;
        let mut linear = Cow::Borrowed(&self.linear);
        let mut clipped = Cow::Borrowed(&self.clipped);
        for _ in 0..halvings {
            linear = Cow::Owned(quarter(&linear, size, |p| {
                [0, 1, 2].map(|c| 0.25 * ((p[0][c] + p[1][c]) + (p[2][c] + p[3][c])))
            }));
            clipped = Cow::Owned(quarter(&clipped, size, |p| p[0] | p[1] | p[2] | p[3]));
            size = size.map(|n| n / 2);
        }
        let saturated = Mask { size, data: clipped.iter().map(|c| c & WHITE != 0).collect() };
        let to_saturated = distance_to(&saturated).data;
        let clipped = clipped.iter().map(|c| [1, 2, 4].map(|bit| c & bit != 0)).collect();
        let linear = ColorImage { size, data: linear.into_owned() };
        let grey = is_grey(linear.data.iter());
        Picture { linear, clipped, saturated, to_saturated, grey }
    }
}

fn add(
    square: &[[u8; 3]],
    tables: &Tables,
    bright: &mut f32,
    linear: &mut [f32; 3],
    bits: &mut u8,
) {
    for p in square {
        let mut clipped = 0;
        for (c, &v) in p.iter().enumerate() {
            *bright += tables.bright[c][v as usize];
            linear[c] += tables.linear[v as usize];
            clipped |= u8::from(v >= SATURATED) << c;
        }
        *bits |= clipped | if clipped == 7 { WHITE } else { 0 };
    }
}

/// Half the size; an odd last row or column is dropped.
fn quarter<T: Copy>(from: &[T], [w, h]: [usize; 2], join: impl Fn([T; 4]) -> T) -> Vec<T> {
    let mut to = Vec::with_capacity((w / 2) * (h / 2));
    for y in 0..h / 2 {
        let (upper, lower) = (&from[2 * y * w..][..w], &from[(2 * y + 1) * w..][..w]);
        for (a, b) in upper.chunks_exact(2).zip(lower.chunks_exact(2)) {
            to.push(join([a[0], a[1], b[0], b[1]]));
        }
    }
    to
}

/// Half the size, `true` where all four pixels are.
pub(super) fn halve_mask(mask: &Mask) -> Mask {
    let data = quarter(&mask.data, mask.size, |p| p.iter().all(|&v| v));
    Mask { size: mask.size.map(|n| n / 2), data }
}

/// `true` where some pixel of the square of `2^halvings` px is.
pub(super) fn any(mask: &Mask, halvings: u32) -> Mask {
    let mut reduced = mask.clone();
    for _ in 0..halvings {
        let data = quarter(&reduced.data, reduced.size, |p| p.iter().any(|&v| v));
        reduced = Mask { size: reduced.size.map(|n| n / 2), data };
    }
    reduced
}

/// Another size, every pixel that of the nearest place.
pub(super) fn stretch(mask: &Mask, size: [usize; 2]) -> Mask {
    let [w, h] = mask.size;
    let column: Vec<usize> = (0..size[0]).map(|x| (x * w / size[0]).min(w - 1)).collect();
    let mut data = Vec::with_capacity(size[0] * size[1]);
    for y in 0..size[1] {
        let row = &mask.data[(y * h / size[1]).min(h - 1) * w..][..w];
        data.extend(column.iter().map(|&x| row[x]));
    }
    Mask { size, data }
}

/// Halve a plane so many times.
pub(super) fn halved(plane: &Plane, times: u32) -> Plane {
    (0..times).fold(plane.clone(), |plane, _| halve(&plane))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> Frame {
        let mut rgb: Vec<[u8; 3]> =
            (0..16 * 12).map(|i| [(i * 7 % 200) as u8, (i * 13 % 200) as u8, 40]).collect();
        rgb[5 * 16 + 6] = [255, 251, 250];
        rgb[9] = [255, 80, 80];
        Frame { name: "f".into(), size: [16, 12], rgb }
    }

    #[test]
    fn one_pass_equals_the_picture_halved() {
        let (frame, tone) = (frame(), ToneCurve::Srgb);
        let reduced = Reduced::of(&frame, &Tables::of(&tone), 1);
        let whole = Picture::of(&frame, &tone);
        let small = reduced.picture(1);
        assert_eq!(small.linear.size, [4, 3]);
        for c in 0..3 {
            let halved = halved(&whole.linear.channel(c), 2);
            for (a, b) in small.linear.data.iter().zip(&halved.data) {
                assert!((a[c] - b).abs() < 1e-6);
            }
        }
        let at = |x: usize, y: usize| y * 4 + x;
        assert!(small.saturated.data[at(1, 1)] && !small.saturated.data[at(2, 0)]);
        assert_eq!(small.clipped[at(2, 0)], [true, false, false]);
        assert_eq!(small.to_saturated[at(1, 1)], 0.0);
    }
}
