//! Gaussian blur with and without a mask, halving, and the variance of the Laplacian.
//!
//! Every output pixel is summed in a fixed order, so results do not depend on the thread count.

use super::reduced::ReducedGrid;
use super::{Mask, Plane};
use rayon::prelude::*;
use std::ops::Range;

/// Gaussian blur of standard deviation `sigma` px, cut off at 3 sigma. At the border the weights
/// inside the image are normalised to one; `sigma <= 0` returns a copy.
pub fn blur(plane: &Plane, sigma: f64) -> Plane {
    let Some(kernel) = half_kernel(sigma) else { return plane.clone() };
    blur_window(plane, &kernel, &plane.size.map(|n| 0..n))
}

/// [`blur`] of a plane that is 0, blurred or not, outside a window of columns and rows.
fn blur_window(plane: &Plane, kernel: &[f32], window: &[Range<usize>; 2]) -> Plane {
    let mut sums = convolve(plane, kernel, window);
    // The border's missing weight is separable too.
    let [wx, wy] = plane.size.map(|n| border_weights(n, kernel));
    for (row, wy) in sums.data.chunks_mut(plane.size[0].max(1)).zip(wy) {
        row.iter_mut().zip(&wx).for_each(|(v, wx)| *v /= wx * wy);
    }
    sums
}

/// Normalised blur `blur(v·m) / blur(m)`: pixels outside the mask contribute nothing, and values
/// spread a little way out of it. The second plane is the weight `blur(m)` in `[0, 1]`; where it
/// vanishes the value is 0. `sigma <= 0` keeps the masked values.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn blur_masked(plane: &Plane, mask: &Mask, sigma: f64) -> (Plane, Plane) {
    let (mut blurred, weight) = blur_masked_all(std::slice::from_ref(plane), mask, sigma);
    (blurred.remove(0), weight)
}

/// [`blur_masked`] of several planes with one mask. A wide blur is of blocks of pixels.
///
/// # Panics
/// If a plane differs from the mask in size.
pub(crate) fn blur_masked_all(planes: &[Plane], mask: &Mask, sigma: f64) -> (Vec<Plane>, Plane) {
    let blur = MaskedBlur::new(mask, sigma);
    let weight = blur.of(|_| 1.0);
    let blurred = planes.par_iter().map(|plane| {
        assert_eq!(plane.size, mask.size, "plane and mask differ in size");
        let mut value = blur.of(|i| plane.data[i]);
        for (v, w) in value.data.iter_mut().zip(&weight.data) {
            *v = if *w > 1e-6 { *v / w } else { 0.0 };
        }
        value
    });
    (blurred.collect(), weight)
}

/// A blur of what is 0 outside a mask.
struct MaskedBlur<'a> {
    mask: &'a Mask,
    sigma: f64,
    blocks: Option<ReducedGrid>,
    /// Columns and rows that pixels of the mask reach.
    window: [Range<usize>; 2],
}

impl<'a> MaskedBlur<'a> {
    fn new(mask: &'a Mask, sigma: f64) -> Self {
        let reach = half_kernel(sigma).map_or(0, |kernel| kernel.len());
        let blocks = ReducedGrid::of(mask.size, sigma);
        Self { mask, sigma, blocks, window: reached(mask, reach) }
    }

    fn of(&self, value: impl Fn(usize) -> f32 + Sync) -> Plane {
        let inside = |i: usize| if self.mask.data[i] { value(i) } else { 0.0 };
        if let Some(blocks) = &self.blocks {
            return blocks.expanded(&blur(&blocks.mean(inside), blocks.sigma(self.sigma)));
        }
        let data = (0..self.mask.data.len()).map(inside).collect();
        let plane = Plane { size: self.mask.size, data };
        match half_kernel(self.sigma) {
            Some(kernel) => blur_window(&plane, &kernel, &self.window),
            None => plane,
        }
    }
}

/// Half the size: each pixel the mean of 2x2; an odd last row or column is dropped. Pixel `x` of
/// the result lies at `2x + ½` of the input (see [`crate::camera::CameraModel::halved`]).
pub(crate) fn halve(plane: &Plane) -> Plane {
    let size = plane.size.map(|n| n / 2);
    let mut data = Vec::with_capacity(size[0] * size[1]);
    for y in 0..size[1] {
        let row = |y: usize| plane.data[y * plane.size[0]..][..2 * size[0]].chunks_exact(2);
        let pairs = row(2 * y).zip(row(2 * y + 1));
        data.extend(pairs.map(|(a, b)| 0.25 * ((a[0] + a[1]) + (b[0] + b[1]))));
    }
    Plane { size, data }
}

/// Variance of the 4-neighbour Laplacian over the interior pixels whose neighbours lie in `mask`:
/// the usual measure of sharpness; 0 where there are none.
pub(crate) fn laplacian_variance(plane: &Plane, mask: Option<&Mask>) -> f64 {
    let [w, h] = plane.size;
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for y in 1..h.saturating_sub(1) {
        for x in 1..w.saturating_sub(1) {
            let around = [(x, y), (x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
            if mask.is_some_and(|m| around.iter().any(|&(x, y)| !m.at(x, y))) {
                continue;
            }
            let [centre, neighbours @ ..] = around.map(|(x, y)| plane.at(x, y) as f64);
            let value = neighbours.iter().sum::<f64>() - 4.0 * centre;
            count += 1.0;
            sum += value;
            squares += value * value;
        }
    }
    if count > 0.0 { squares / count - (sum / count).powi(2) } else { 0.0 }
}

/// Weights of a normalised Gaussian at 0, 1, … 3 sigma; `None` without a positive sigma.
fn half_kernel(sigma: f64) -> Option<Vec<f32>> {
    if sigma.is_nan() || sigma <= 0.0 {
        return None;
    }
    let reach = (3.0 * sigma).ceil() as usize;
    let raw: Vec<f64> = (0..=reach).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let total = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    Some(raw.iter().map(|v| (v / total) as f32).collect())
}

/// Weight of the kernel that falls inside `0..n`, by position.
fn border_weights(n: usize, kernel: &[f32]) -> Vec<f32> {
    let one = vec![1.0; n];
    let mut out = vec![0.0; n];
    convolve_row(&one, kernel, &mut out);
    out
}

/// Columns and rows within `reach` px of the pixels of a mask.
fn reached(mask: &Mask, reach: usize) -> [Range<usize>; 2] {
    let [w, h] = mask.size;
    let on = (0..w * h).filter(|&i| mask.data[i]).map(|i| [i % w, i / w]);
    let ends = on.fold([w..0, h..0], |[columns, rows], [x, y]| {
        [columns.start.min(x)..columns.end.max(x + 1), rows.start.min(y)..y + 1]
    });
    let [columns, rows] = ends.map(|r| r.start.saturating_sub(reach).min(r.end)..r.end + reach);
    [columns.start..columns.end.min(w), rows.start..rows.end.min(h)]
}

/// Rows, then columns; pixels outside the window of columns and rows count as zero.
fn convolve(plane: &Plane, kernel: &[f32], [columns, lines]: &[Range<usize>; 2]) -> Plane {
    let w = plane.size[0];
    let mut rows = vec![0.0; plane.data.len()];
    let inside = lines.start * w..lines.end * w;
    let pairs = rows[inside.clone()].par_chunks_mut(w.max(1));
    pairs.zip(plane.data[inside.clone()].par_chunks(w.max(1))).for_each(|(out, row)| {
        convolve_row(&row[columns.clone()], kernel, &mut out[columns.clone()]);
    });
    let mut data = vec![0.0; plane.data.len()];
    data[inside].par_chunks_mut(w.max(1)).enumerate().for_each(|(k, out)| {
        let (y, reach) = (lines.start + k, kernel.len() - 1);
        let out = &mut out[columns.clone()];
        for source in y.saturating_sub(reach).max(lines.start)..(y + reach + 1).min(lines.end) {
            let weight = kernel[source.abs_diff(y)];
            let row = &rows[source * w..][columns.clone()];
            out.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * v);
        }
    });
    Plane { size: plane.size, data }
}

fn convolve_row(row: &[f32], kernel: &[f32], out: &mut [f32]) {
    let n = row.len();
    for (offset, &weight) in kernel.iter().enumerate().take(n) {
        let shifted = n - offset;
        out[..shifted].iter_mut().zip(&row[offset..]).for_each(|(sum, v)| *sum += weight * v);
        if offset > 0 {
            out[offset..].iter_mut().zip(&row[..shifted]).for_each(|(sum, v)| *sum += weight * v);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spike(size: [usize; 2], at: usize) -> Plane {
        let mut plane = Plane::filled(size, 0.0);
        plane.data[at] = 1.0;
        plane
    }

    #[test]
    fn a_constant_stays_and_a_spike_keeps_its_mass() {
        let constant = blur(&Plane::filled([17, 9], 0.7), 2.5);
        assert!(constant.data.iter().all(|v| (v - 0.7).abs() < 1e-5));
        let blurred = blur(&spike([31, 31], 15 * 31 + 15), 2.0);
        assert!((blurred.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let ratio = blurred.at(17, 15) / blurred.at(15, 15);
        assert!((ratio - (-0.5_f32).exp()).abs() < 1e-5);
        assert_eq!(blurred.at(13, 15), blurred.at(17, 15));
    }

    #[test]
    fn masked_pixels_do_not_leak() {
        let size = [20, 20];
        let mut plane = Plane::filled(size, 0.25);
        let mut mask = Mask::filled(size, true);
        for y in 0..20 {
            for x in 10..20 {
                plane.data[y * 20 + x] = f32::MAX;
                mask.data[y * 20 + x] = false;
            }
        }
        let (value, weight) = blur_masked(&plane, &mask, 1.5);
        for y in 0..20 {
            for x in 0..12 {
                assert!((value.at(x, y) - 0.25).abs() < 1e-5);
            }
            assert_eq!(weight.at(19, y), 0.0);
            assert_eq!(value.at(19, y), 0.0);
        }
    }

    #[test]
    fn a_window_changes_no_bit() {
        let size = [40, 30];
        let values = (0..1200).map(|i| ((i * 37) % 101) as f32 * 0.01).collect();
        let plane = Plane { size, data: values };
        for place in [[12..20, 9..14], [0..3, 25..30], [0..40, 0..30], [7..7, 3..3]] {
            let on = |i: usize| place[0].contains(&(i % 40)) && place[1].contains(&(i / 40));
            let mask = Mask { size, data: (0..1200).map(on).collect() };
            let masked = |of: &dyn Fn(usize) -> f32| {
                let data = (0..1200).map(|i| if on(i) { of(i) } else { 0.0 }).collect();
                blur(&Plane { size, data }, 1.7)
            };
            let (whole, weight) = (masked(&|i| plane.data[i]), masked(&|_| 1.0));
            let (value, in_window) = blur_masked(&plane, &mask, 1.7);
            assert_eq!(in_window, weight);
            let ratio = whole.data.iter().zip(&weight.data);
            let ratio: Vec<f32> = ratio.map(|(v, w)| if *w > 1e-6 { v / w } else { 0.0 }).collect();
            assert_eq!(value.data, ratio);
        }
    }

    #[test]
    fn halving_averages_and_sharpness_falls_with_blur() {
        let data = (0..64).map(|i| ((i * 37) % 11) as f32).collect();
        let plane = Plane { size: [8, 8], data };
        let half = halve(&plane);
        assert_eq!(half.size, [4, 4]);
        let by_hand = (plane.at(2, 4) + plane.at(3, 4) + plane.at(2, 5) + plane.at(3, 5)) / 4.0;
        assert!((half.at(1, 2) - by_hand).abs() < 1e-6);
        assert!(laplacian_variance(&blur(&plane, 1.0), None) < laplacian_variance(&plane, None));
    }
}
