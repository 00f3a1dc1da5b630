//! How far the image content moved between two frames: block matching on small grey images.

use crate::image::{Frame, Plane};

/// Width of the small images, px; blocks and search range are in these px.
const WIDTH: usize = 240;
const BLOCK: usize = 12;
const REACH: i64 = 8;
/// Standard deviation of grey below which a block is too plain to be followed.
const TEXTURE: f32 = 0.012;

/// A frame made small for [`displacement`].
#[derive(Clone, Debug)]
pub struct Thumbnail(Plane);

impl Thumbnail {
    /// The encoded grey of a frame, averaged over squares down to about 240 px of width.
    pub fn new(frame: &Frame) -> Self {
        let factor = (frame.size[0] / WIDTH).max(1);
        let size = frame.size.map(|n| n / factor);
        let mean = |i: usize| {
            let (x0, y0) = ((i % size[0]) * factor, (i / size[0]) * factor);
            let rows = (y0..y0 + factor).map(|y| y * frame.size[0] + x0);
            let pixels = rows.flat_map(|start| &frame.rgb[start..start + factor]);
            let sum: u32 = pixels.map(|p| p[0] as u32 + 2 * p[1] as u32 + p[2] as u32).sum();
            sum as f32 / (1020 * factor * factor) as f32
        };
        Self(Plane { size, data: (0..size[0] * size[1]).map(mean).collect() })
    }
}

/// Mean displacement of the textured blocks of `a` in `b` as a fraction of the image's width, the
/// largest fifth left out (instruments, highlights); blocks lost from the search range count with
/// its limit. 1 when no block can be followed or the sizes differ.
pub fn displacement(a: &Thumbnail, b: &Thumbnail) -> f64 {
    let [w, h] = a.0.size;
    if a.0.size != b.0.size {
        return 1.0;
    }
    let reach = REACH as usize;
    let mut lengths = Vec::new();
    for y in (reach..h.saturating_sub(BLOCK + reach)).step_by(BLOCK) {
        for x in (reach..w.saturating_sub(BLOCK + reach)).step_by(BLOCK) {
            lengths.extend(follow(&a.0, &b.0, x, y));
        }
    }
    if lengths.is_empty() {
        return 1.0;
    }
    lengths.sort_by(f64::total_cmp);
    lengths.truncate((lengths.len() * 4).div_ceil(5));
    lengths.iter().sum::<f64>() / (lengths.len() * w) as f64
}

/// Length of the shift with the least sum of absolute differences; the shorter of equal ones.
fn follow(a: &Plane, b: &Plane, x: usize, y: usize) -> Option<f64> {
    let block = |plane: &Plane, x: usize, y: usize| -> [f32; BLOCK * BLOCK] {
        std::array::from_fn(|i| plane.at(x + i % BLOCK, y + i / BLOCK))
    };
    let own = block(a, x, y);
    let mean = own.iter().sum::<f32>() / own.len() as f32;
    let variance = own.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / own.len() as f32;
    if variance < TEXTURE * TEXTURE {
        return None;
    }
    let cost = |dx: i64, dy: i64| {
        let (x, y) = ((x as i64 + dx) as usize, (y as i64 + dy) as usize);
        own.chunks_exact(BLOCK).enumerate().fold(0.0_f32, |sum, (row, own)| {
            let start = (y + row) * b.size[0] + x;
            let other = &b.data[start..start + BLOCK];
            sum + own.iter().zip(other).map(|(a, b)| (a - b).abs()).sum::<f32>()
        })
    };
    let mut best = (cost(0, 0), 0);
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let (cost, length) = (cost(dx, dy), dx * dx + dy * dy);
            if cost < best.0 || (cost == best.0 && length < best.1) {
                best = (cost, length);
            }
        }
    }
    Some((best.1 as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn textured(shift: usize) -> Frame {
        let size = [480, 320];
        let grey = |i: usize| {
            let (x, y) = ((i % 480 + shift) / 8, (i / 480) / 8);
            ((x * 7919 + y * 104_729) % 199) as u8
        };
        let rgb = (0..480 * 320).map(|i| [grey(i); 3]).collect();
        Frame { name: "t".into(), size, rgb }
    }

    #[test]
    fn measures_a_shift_and_ignores_a_moving_corner() {
        let still = Thumbnail::new(&textured(0));
        assert_eq!(displacement(&still, &still), 0.0);
        // 8 of 480 px.
        let moved = displacement(&still, &Thumbnail::new(&textured(8)));
        assert!((moved - 8.0 / 480.0).abs() < 2e-3, "{moved}");
        let mut tool = textured(0);
        let other = textured(8);
        for y in 0..100 {
            let row = y * 480..y * 480 + 200;
            tool.rgb[row.clone()].copy_from_slice(&other.rgb[row]);
        }
        assert!(displacement(&still, &Thumbnail::new(&tool)) < 1e-3);
    }

    #[test]
    fn a_plain_image_cannot_be_followed() {
        let plain = Frame { rgb: vec![[90; 3]; 480 * 320], ..textured(0) };
        let plain = Thumbnail::new(&plain);
        assert_eq!(displacement(&plain, &plain), 1.0);
    }
}
