//! Textures of tissue over the x-y plane of the rest shape: mottled ground, branching vessels, and
//! a bumpiness that breaks up highlights.

use crate::geometry::Point2;
use crate::image::{ColorImage, Plane};
use crate::synth::random::{Random, normal, uniform};
use rayon::prelude::*;

/// Colours, linear.
#[derive(Clone, Copy, Debug)]
pub(super) struct Palette {
    ground: [[f64; 3]; 2],
    vessel: [f64; 3],
    /// Vessels that start a tree, per 1000 mm².
    trees: f64,
}

impl Palette {
    pub(super) const ORGAN: Self = Self {
        ground: [[0.62, 0.27, 0.22], [0.44, 0.15, 0.13]],
        vessel: [0.24, 0.045, 0.05],
        trees: 7.0,
    };
    pub(super) const WALL: Self = Self {
        ground: [[0.60, 0.38, 0.20], [0.50, 0.20, 0.15]],
        vessel: [0.33, 0.06, 0.06],
        trees: 0.5,
    };
}

/// A picture over `[-half, half]`, mm.
#[derive(Clone, Debug)]
pub(super) struct TissueTexture {
    half: [f64; 2],
    step: f64,
    albedo: ColorImage,
    /// Deviation of a highlight's angle, rad.
    bump: Plane,
}

impl TissueTexture {
    pub(super) fn new(half: [f64; 2], step: f64, palette: Palette, seed: u64) -> Self {
        let size = half.map(|h| (2.0 * h / step).ceil() as usize + 1);
        let place = |i: usize| {
            [(i % size[0]) as f64 * step - half[0], (i / size[0]) as f64 * step - half[1]]
        };
        let dark = vessels(half, step, size, palette.trees, seed);
        let count = size[0] * size[1];
        let albedo =
            (0..count).into_par_iter().map(|i| colour(place(i), dark[i], &palette, seed)).collect();
        let bump = |i: usize| {
            let [x, y] = place(i);
            (0.05 * noise(x / 0.9, y / 0.9, seed ^ 11)
                + 0.04 * noise(x / 0.35, y / 0.35, seed ^ 12)) as f32
        };
        let bump = (0..count).into_par_iter().map(bump).collect();
        Self {
            half,
            step,
            albedo: ColorImage { size, data: albedo },
            bump: Plane { size, data: bump },
        }
    }

    /// Albedo and bump at a place of the rest shape; the nearest there is outside.
    pub(super) fn at(&self, x: f64, y: f64) -> ([f64; 3], f64) {
        let [w, h] = self.albedo.size.map(|s| s as f64 - 1.001);
        let u = ((x + self.half[0]) / self.step).clamp(0.0, w);
        let v = ((y + self.half[1]) / self.step).clamp(0.0, h);
        let (i, j) = (u as usize, v as usize);
        let (a, b) = ((u - i as f64) as f32, (v - j as f64) as f32);
        let width = self.albedo.size[0];
        let k = j * width + i;
        let corners = [
            (k, (1.0 - a) * (1.0 - b)),
            (k + 1, a * (1.0 - b)),
            (k + width, (1.0 - a) * b),
            (k + width + 1, a * b),
        ];
        let mut sum = [0f32; 3];
        for (k, weight) in corners {
            let value = self.albedo.data[k];
            (0..3).for_each(|c| sum[c] += weight * value[c]);
        }
        let bump = self.bump.sample(&Point2::new(u, v)).map_or(0.0, |s| s.0);
        (sum.map(f64::from), bump)
    }
}

fn colour([x, y]: [f64; 2], dark: f32, palette: &Palette, seed: u64) -> [f32; 3] {
    let n = |scale: f64, task: u64| noise(x / scale, y / scale, seed ^ task);
    let mix = (0.5 + 0.45 * n(13.0, 1) + 0.3 * n(5.0, 2)).clamp(0.0, 1.0);
    let grain = 1.0 + 0.10 * n(2.2, 3) + 0.10 * n(0.9, 4) + 0.07 * n(0.4, 5);
    let pale = 0.12 * (n(3.1, 6) - 0.35).max(0.0);
    let dark = f64::from(dark);
    std::array::from_fn(|c| {
        let [a, b] = [palette.ground[0][c], palette.ground[1][c]];
        let ground = (a + (b - a) * mix) * grain + pale;
        (ground + (palette.vessel[c] * grain - ground) * dark).clamp(0.02, 0.95) as f32
    })
}

/// Darkness in `[0, 1]` of trees of winding vessels that thin out as they branch.
fn vessels(half: [f64; 2], step: f64, size: [usize; 2], density: f64, seed: u64) -> Vec<f32> {
    let mut dark = vec![0f32; size[0] * size[1]];
    let mut random = Random::new(seed, 0x7E55);
    let trees = (density * 4.0 * half[0] * half[1] / 1000.0).ceil() as usize;
    // Place, heading, radius in mm.
    let mut open: Vec<([f64; 2], f64, f64)> = Vec::new();
    for _ in 0..trees {
        let mut at = |h: f64| h * (2.0 * uniform(&mut random) - 1.0);
        let place = [at(half[0]), at(half[1])];
        let heading = std::f64::consts::TAU * uniform(&mut random);
        open.push((place, heading, 0.18 + 0.22 * uniform(&mut random).powi(2)));
    }
    while let Some((mut place, mut heading, mut radius)) = open.pop() {
        let mut bend = 0.0;
        while radius > 0.05 && (0..2).all(|c| place[c].abs() < half[c]) {
            stamp(&mut dark, size, [0, 1].map(|c| (place[c] + half[c]) / step), radius / step);
            let stride = (0.5 * radius).max(0.5 * step);
            bend = 0.97 * bend + 0.05 * normal(&mut random);
            heading += 0.5 * bend * stride;
            place = [place[0] + stride * heading.cos(), place[1] + stride * heading.sin()];
            radius *= 1.0 - 0.006 * stride;
            if uniform(&mut random) < 0.07 * stride {
                let side = if uniform(&mut random) < 0.5 { -1.0 } else { 1.0 };
                open.push((
                    place,
                    heading + side * (0.4 + 0.6 * uniform(&mut random)),
                    0.68 * radius,
                ));
                radius *= 0.85;
            }
        }
    }
    dark
}

/// A soft disc, `centre` and `radius` in pixels.
fn stamp(dark: &mut [f32], size: [usize; 2], centre: [f64; 2], radius: f64) {
    let reach = 2.2 * radius + 1.0;
    let span = |c: usize| {
        let low = (centre[c] - reach).ceil().max(0.0) as usize;
        let high = (centre[c] + reach).floor().min(size[c] as f64 - 1.0) as usize;
        low..=high
    };
    // Thin vessels are faint.
    let depth = 0.45 + 0.45 * (radius / 5.0).min(1.0);
    for y in span(1) {
        for x in span(0) {
            let r = ((x as f64 - centre[0]).powi(2) + (y as f64 - centre[1]).powi(2))
                / (radius * radius);
            let value = (depth * (-0.7 * r * r.sqrt()).exp()) as f32;
            let pixel = &mut dark[y * size[0] + x];
            *pixel = pixel.max(value);
        }
    }
}

/// Value noise in `[-1, 1]` with a smooth derivative, one cell per unit.
pub(super) fn noise(x: f64, y: f64, seed: u64) -> f64 {
    let (i, j) = (x.floor(), y.floor());
    let ease = |t: f64| t * t * t * (t * (6.0 * t - 15.0) + 10.0);
    let (u, v) = (ease(x - i), ease(y - j));
    let at = |di: i64, dj: i64| lattice(i as i64 + di, j as i64 + dj, seed);
    let row = |dj: i64| at(0, dj) + u * (at(1, dj) - at(0, dj));
    let low = row(0);
    low + v * (row(1) - low)
}

/// A number in `[-1, 1]` per lattice point (the mixer of SplitMix64).
fn lattice(i: i64, j: i64, seed: u64) -> f64 {
    let mut z = seed
        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
        .wrapping_add((i as u64).wrapping_mul(0xD1B5_4A32_D192_ED03))
        .wrapping_add((j as u64).wrapping_mul(0x8CB9_2BA7_2F3D_8DD7));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_and_seeded() {
        for k in 0..50 {
            let (x, y) = (0.37 * k as f64 - 9.0, 0.21 * k as f64);
            let here = noise(x, y, 3);
            assert!(here.abs() <= 1.0 && (noise(x + 1e-6, y, 3) - here).abs() < 1e-4);
        }
        assert_ne!(noise(0.5, 0.5, 1), noise(0.5, 0.5, 2));
        // At a lattice point it is the lattice's own number.
        assert_eq!(noise(2.0, -3.0, 7), lattice(2, -3, 7));
    }
}
