//! Octaves of ever more blurred images.

use crate::image::Plane;
use rayon::prelude::*;

/// Layers of an octave that are searched.
pub(super) const LAYERS: usize = 3;
/// Standard deviation of the first layer, px of the octave.
pub(super) const SIGMA: f64 = 1.6;
/// Blur that the image itself is taken to have, px.
const CAMERA_BLUR: f64 = 0.5;
/// Smallest side of an octave, px.
const SMALLEST: usize = 16;
/// Rows that one task blurs.
const ROWS: usize = 32;
/// Pixels summed together: a few registers.
const STRIP: usize = 32;

/// Gaussian layers of one octave, each blurred `2^(1/3)` times as much as the one before.
pub(super) struct Octave {
    pub size: [usize; 2],
    pub layers: Vec<Vec<f32>>,
}

/// All octaves; the first is that of the doubled image.
pub(super) fn octaves(grey: &Plane) -> Vec<Octave> {
    let factor = 2f64.powf(1.0 / LAYERS as f64);
    let step = |i: i32| SIGMA * factor.powi(i - 1) * (factor * factor - 1.0).sqrt();
    let kernels: Vec<Vec<f32>> = (1..LAYERS as i32 + 3).map(|i| half_kernel(step(i))).collect();
    let mut size = grey.size.map(|n| 2 * n);
    if size.iter().any(|n| *n < SMALLEST) {
        return Vec::new();
    }
    let first = half_kernel((SIGMA * SIGMA - 4.0 * CAMERA_BLUR * CAMERA_BLUR).sqrt());
    let mut base = blur(&doubled(grey), size, &first);
    let mut octaves: Vec<Octave> = Vec::new();
    loop {
        let mut layers = vec![base];
        for (i, kernel) in kernels.iter().enumerate() {
            let next = blur(&layers[i], size, kernel);
            layers.push(next);
        }
        // The layer with twice the blur of the first starts the next octave.
        base = every_second(&layers[LAYERS], size);
        octaves.push(Octave { size, layers });
        size = size.map(|n| n / 2);
        if size.iter().any(|n| *n < SMALLEST) {
            return octaves;
        }
    }
}

/// Bilinear; pixel `X` of the result lies at `X/2 − 1/4` of the image.
fn doubled(grey: &Plane) -> Vec<f32> {
    let [w, h] = grey.size;
    let tap = |d: usize, n: usize| match d % 2 {
        0 => ((d / 2).saturating_sub(1), d / 2),
        _ => ((d / 2 + 1).min(n - 1), d / 2),
    };
    let mut out = vec![0.0; 4 * w * h];
    out.par_chunks_mut(2 * w).enumerate().for_each_init(
        || vec![0.0; w],
        |row, (y, out)| {
            let (far, near) = tap(y, h);
            let rows = grey.data[far * w..][..w].iter().zip(&grey.data[near * w..][..w]);
            row.iter_mut().zip(rows).for_each(|(v, (f, n))| *v = 0.25 * f + 0.75 * n);
            for (x, out) in out.iter_mut().enumerate() {
                let (far, near) = tap(x, w);
                *out = 0.25 * row[far] + 0.75 * row[near];
            }
        },
    );
    out
}

fn every_second(image: &[f32], [w, h]: [usize; 2]) -> Vec<f32> {
    let row = |y: usize| image[2 * y * w..].iter().step_by(2).take(w / 2).copied();
    (0..h / 2).flat_map(row).collect()
}

/// Weights of a normalised Gaussian at 0, 1, … 4 sigma.
fn half_kernel(sigma: f64) -> Vec<f32> {
    let reach = (4.0 * sigma).round() as usize;
    let raw: Vec<f64> = (0..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let total = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    raw.iter().map(|v| (v / total) as f32).collect()
}

/// Separable blur of an image that is mirrored about its outermost pixels.
fn blur(image: &[f32], [w, h]: [usize; 2], kernel: &[f32]) -> Vec<f32> {
    let reach = kernel.len() - 1;
    let mut out = vec![0.0; w * h];
    out.par_chunks_mut(w * ROWS).enumerate().for_each(|(part, out)| {
        // A row blurred downwards, with its mirrored ends.
        let mut padded = vec![0.0; w + 2 * reach];
        for (i, out) in out.chunks_mut(w).enumerate() {
            let y = ROWS * part + i;
            let row = |d: isize| &image[mirror(y as isize + d, h) * w..][..w];
            let pairs: Vec<[&[f32]; 2]> = (0..=reach as isize).map(|d| [row(d), row(-d)]).collect();
            weigh(&mut padded[reach..][..w], kernel, |d| pairs[d]);
            for d in 1..=reach {
                padded[reach - d] = padded[reach + mirror(-(d as isize), w)];
                padded[reach + w - 1 + d] = padded[reach + mirror((w - 1 + d) as isize, w)];
            }
            weigh(out, kernel, |d| [&padded[reach + d..][..w], &padded[reach - d..][..w]]);
        }
    });
    out
}

/// `out = Σ kernel[d] (aᵈ + bᵈ)`, the first of them counted once.
#[inline(always)]
fn weigh<'a>(out: &mut [f32], kernel: &[f32], pair: impl Fn(usize) -> [&'a [f32]; 2]) {
    let whole = out.len() / STRIP * STRIP;
    for at in (0..whole).step_by(STRIP) {
        let mut sums = [0.0f32; STRIP];
        let strip = |row: &'a [f32]| -> &'a [f32] { &row[at..at + STRIP] };
        let centre = strip(pair(0)[0]);
        for l in 0..STRIP {
            sums[l] = kernel[0] * centre[l];
        }
        for (d, weight) in kernel.iter().enumerate().skip(1) {
            let [a, b] = pair(d).map(strip);
            for l in 0..STRIP {
                sums[l] += weight * (a[l] + b[l]);
            }
        }
        out[at..at + STRIP].copy_from_slice(&sums);
    }
    for at in whole..out.len() {
        let mut sum = kernel[0] * pair(0)[0][at];
        for (d, weight) in kernel.iter().enumerate().skip(1) {
            let [a, b] = pair(d);
            sum += weight * (a[at] + b[at]);
        }
        out[at] = sum;
    }
}

/// Index of the pixel that stands for `i`, mirrored about the outermost ones.
fn mirror(i: isize, n: usize) -> usize {
    let period = 2 * (n as isize - 1).max(1);
    let i = i.rem_euclid(period);
    i.min(period - i).min(n as isize - 1) as usize
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    #[test]
    fn mirrored_by_hand() {
        let found: Vec<usize> = (-4..8).map(|i| mirror(i, 4)).collect();
        assert_eq!(found, [2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!(mirror(-3, 1), 0);
    }

    #[test]
    fn a_spike_becomes_the_kernel_and_borders_keep_a_constant() {
        let (size, kernel) = ([71, 43], half_kernel(1.7));
        let mut spike = vec![0.0; 71 * 43];
        spike[20 * 71 + 33] = 1.0;
        let out = blur(&spike, size, &kernel);
        for (dx, dy) in [(0usize, 0usize), (3, 1), (6, 5)] {
            let by_hand = kernel[dx] * kernel[dy];
            assert!((out[(20 + dy) * 71 + 33 - dx] - by_hand).abs() < 1e-8);
        }
        assert!(blur(&vec![0.3; 71 * 43], size, &kernel).iter().all(|v| (v - 0.3).abs() < 1e-6));
    }

    /// The first octave of noise.
    pub(in crate::sfm::sift) fn noisy(size: [usize; 2]) -> Octave {
        let mut random = crate::sfm::random::Random::new(3, 0);
        let data = (0..size[0] * size[1]).map(|_| random.below(1000) as f32 / 1000.0).collect();
        octaves(&Plane { size, data }).remove(0)
    }

    #[test]
    fn doubling_puts_a_ramp_at_the_quarters() {
        let grey = Plane { size: [9, 8], data: (0..72).map(|i| (i % 9) as f32).collect() };
        let out = doubled(&grey);
        for x in 1..17 {
            assert!((out[3 * 18 + x] - (0.5 * x as f32 - 0.25)).abs() < 1e-6);
        }
        let first = &octaves(&Plane { size: [40, 24], ..Plane::filled([40, 24], 0.5) })[..];
        assert_eq!(first.iter().map(|o| o.size).collect::<Vec<_>>(), [[80, 48], [40, 24]]);
        assert!(first.iter().all(|o| o.layers.len() == LAYERS + 3));
    }
}
