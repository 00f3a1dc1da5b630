//! From the light in the image plane to the numbers of a picture: lens, noise, tone curve.

use super::random::{Random, normal};
use super::render::encoder;
use crate::image::filter::blur;
use crate::image::{ColorImage, Frame, ToneCurve};
use rayon::prelude::*;

/// Blur of lens and sensor, px.
const BLUR: f64 = 0.6;

/// Noise of the encoded values, of 255.
const NOISE: f64 = 1.5;

/// Normal deviates of a frame, of which every value draws one.
const DEVIATES: usize = 1 << 14;

/// Blur, encode, add noise row by row.
pub(super) fn develop(name: String, linear: &ColorImage, seed: u64) -> Frame {
    let size = linear.size;
    let planes: Vec<_> =
        (0..3usize).into_par_iter().map(|c| blur(&linear.channel(c), BLUR)).collect();
    let encode = encoder(&ToneCurve::Srgb);
    let mut random = Random::new(seed, 0x401);
    let deviates: Vec<f64> = (0..DEVIATES).map(|_| NOISE * normal(&mut random)).collect();
    let row = |y: usize| -> Vec<[u8; 3]> {
        let mut random = Random::new(seed, 0x401_0000 + y as u64);
        let value = |i: usize, c: usize, random: &mut Random| {
            let noisy = encode(f64::from(planes[c].data[i])) + deviates[random.below(DEVIATES)];
            noisy.round().clamp(0.0, 255.0) as u8
        };
        (y * size[0]..(y + 1) * size[0])
            .map(|i| [0, 1, 2].map(|c| value(i, c, &mut random)))
            .collect()
    };
    let rgb: Vec<Vec<[u8; 3]>> = (0..size[1]).into_par_iter().map(row).collect();
    Frame { name, size, rgb: rgb.concat() }
}
