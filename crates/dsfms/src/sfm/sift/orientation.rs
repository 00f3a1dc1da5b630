//! The dominant directions of the gradient around a keypoint, and the gradients themselves.

use super::extrema::Extremum;
use super::scale_space::Octave;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

const BINS: usize = 36;
/// Standard deviation of the window, over that of the keypoint.
const WINDOW: f32 = 1.5;
/// Height of a peak that counts, over the highest.
const PEAK: f32 = 0.8;
/// Samples of a row at a time.
pub(super) const ROW: usize = 96;

/// Magnitude and direction of the gradient along a part of a row.
pub(super) struct OctaveGradients {
    pub magnitude: [f32; ROW],
    /// Radians from +x towards +y (down), `-π` to `π`.
    pub angle: [f32; ROW],
}

impl OctaveGradients {
    pub(super) fn new() -> Self {
        Self { magnitude: [0.0; ROW], angle: [0.0; ROW] }
    }

    /// Pixels `x` to `x + count` of row `y`, all of them inside the border of one pixel.
    #[inline(always)]
    pub(super) fn fill(&mut self, image: &[f32], w: usize, [x, y]: [usize; 2], count: usize) {
        let (row, up, down) =
            (&image[y * w + x - 1..][..count + 2], &image[(y - 1) * w + x..][..count], {
                &image[(y + 1) * w + x..][..count]
            });
        let (magnitude, angle) = (&mut self.magnitude[..count], &mut self.angle[..count]);
        for i in 0..count {
            let (dx, dy) = (row[i + 2] - row[i], down[i] - up[i]);
            magnitude[i] = (dx * dx + dy * dy).sqrt();
            angle[i] = direction(dx, dy);
        }
    }
}

/// `atan2(y, x)` to 1e-4 rad, without a branch.
#[inline(always)]
fn direction(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (long, short) = if ax > ay { (ax, ay) } else { (ay, ax) };
    let t = short / (long + f32::MIN_POSITIVE);
    let s = t * t;
    let half =
        t * (0.999_866 + s * (-0.330_299_5 + s * (0.180_141 + s * (-0.085_133 + s * 0.020_835_1))));
    let quarter = if ax > ay { half } else { FRAC_PI_2 - half };
    let upper = if x < 0.0 { PI - quarter } else { quarter };
    if y < 0.0 { -upper } else { upper }
}

/// Weights of a Gaussian at `-reach ..= reach`.
pub(super) fn bell(reach: usize, sigma: f32) -> Vec<f32> {
    let scale = -0.5 / (sigma * sigma);
    let at = |i: usize| (i as f32 - reach as f32).powi(2);
    (0..=2 * reach).map(|i| (scale * at(i)).exp()).collect()
}

/// Directions in which the gradient around a keypoint mostly points, radians clockwise from +x in
/// `0..2π`.
pub(super) fn dominant(octave: &Octave, e: &Extremum) -> Vec<f32> {
    let [w, h] = octave.size;
    let [cx, cy, layer] = e.nearest;
    let sigma = WINDOW * e.sigma;
    let reach = (3.0 * sigma).round() as usize;
    let bell = bell(reach, sigma);
    let (left, right) = (cx.saturating_sub(reach).max(1), (cx + reach).min(w - 2));
    let (top, bottom) = (cy.saturating_sub(reach).max(1), (cy + reach).min(h - 2));
    let mut raw = [0.0f32; BINS];
    let mut gradients = OctaveGradients::new();
    for y in top..=bottom {
        let count = (right + 1 - left).min(ROW);
        gradients.fill(&octave.layers[layer], w, [left, y], count);
        let across = bell[y + reach - cy];
        for i in 0..count {
            let bin = (gradients.angle[i] * (BINS as f32 / TAU) + BINS as f32 + 0.5) as usize;
            raw[bin % BINS] += across * bell[left + i + reach - cx] * gradients.magnitude[i];
        }
    }

    peaks(&smoothed(&raw))
}

/// The histogram weighed with 1, 4, 6, 4, 1 around the circle.
fn smoothed(raw: &[f32; BINS]) -> [f32; BINS] {
    let at = |i: usize| raw[i % BINS];
    std::array::from_fn(|i| {
        let (one, two) = (at(i + BINS - 1) + at(i + 1), at(i + BINS - 2) + at(i + 2));
        (6.0 * raw[i] + 4.0 * one + two) / 16.0
    })
}

/// Tops of the parabolas through the highest bins.
fn peaks(histogram: &[f32; BINS]) -> Vec<f32> {
    let highest = histogram.iter().copied().fold(0.0, f32::max);
    let peak = |i: usize| {
        let (before, own) = (histogram[(i + BINS - 1) % BINS], histogram[i]);
        let after = histogram[(i + 1) % BINS];
        let top = own > before && own > after && own >= PEAK * highest;
        let shift = 0.5 * (before - after) / (before - 2.0 * own + after);
        top.then(|| ((i as f32 + shift) * (TAU / BINS as f32)).rem_euclid(TAU))
    };
    (0..BINS).filter_map(peak).collect()
}

#[cfg(test)]
mod tests {
    use super::super::scale_space::tests::noisy;
    use super::*;

    /// Against the definition, pixel by pixel.
    #[test]
    fn directions_are_those_of_the_window() {
        let octave = noisy([40, 33]);
        let layer = &octave.layers[2];
        let at = |x: usize, y: usize| layer[y * 80 + x];
        for [cx, cy] in [[40usize, 30usize], [6, 59]] {
            let (x, y) = (cx as f32, cy as f32);
            let e = Extremum { x, y, nearest: [cx, cy, 2], sigma: 2.0, response: 0.1 };
            let mut raw = [0.0f32; BINS];
            for y in cy.saturating_sub(9).max(1)..=(cy + 9).min(64) {
                for x in cx.saturating_sub(9).max(1)..=(cx + 9).min(78) {
                    let (dx, dy) = (x as f32 - cx as f32, y as f32 - cy as f32);
                    let gradient = [at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)];
                    let turns = gradient[1].atan2(gradient[0]) / TAU;
                    let bin = (turns * BINS as f32).round() as i32;
                    let bell = (-0.5 * (dx * dx + dy * dy) / 9.0).exp();
                    raw[bin.rem_euclid(BINS as i32) as usize] +=
                        bell * gradient[0].hypot(gradient[1]);
                }
            }
            let (found, by_hand) = (dominant(&octave, &e), peaks(&smoothed(&raw)));
            assert!(!by_hand.is_empty() && found.len() == by_hand.len(), "{found:?} {by_hand:?}");
            assert!(found.iter().zip(&by_hand).all(|(a, b)| (a - b).abs() < 0.01));
        }
    }

    #[test]
    fn directions_all_around() {
        for i in 0..720 {
            let angle = (i as f32 - 359.5) * PI / 360.0;
            let found = direction(3.0 * angle.cos(), 3.0 * angle.sin());
            assert!((found - angle).abs() < 1e-4, "{angle}: {found}");
        }
        assert!(direction(0.0, 0.0).is_finite());
    }

    #[test]
    fn peaks_by_hand() {
        let mut histogram = [0.0; BINS];
        histogram[3..6].copy_from_slice(&[0.5, 1.0, 0.5]);
        histogram[35] = 0.9;
        histogram[20] = 0.7;
        let found = peaks(&histogram);
        let degrees: Vec<f32> = found.iter().map(|a| a.to_degrees().round()).collect();
        assert_eq!(degrees, [40.0, 350.0]);
        let total: f32 = smoothed(&histogram).iter().sum();
        assert!((total - 3.6).abs() < 1e-5);
    }
}
