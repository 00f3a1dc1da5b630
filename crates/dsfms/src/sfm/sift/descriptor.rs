//! Histograms of gradients in 4 × 4 cells around a keypoint, turned with it.

use super::extrema::Extremum;
use super::orientation::{OctaveGradients, ROW, bell};
use super::scale_space::Octave;
use std::f32::consts::TAU;

/// Cells along a side, and directions in each.
const CELLS: usize = 4;
const DIRECTIONS: usize = 8;
/// Side of a cell, over the standard deviation of the keypoint.
const CELL: f32 = 3.0;
/// Largest share of one entry: a single strong edge shall not outvote the others.
const LARGEST: f32 = 0.2;

/// Cells with a rim that is thrown away.
type Histogram = [[[f32; DIRECTIONS]; CELLS + 2]; CELLS + 2];

/// 128 numbers, 0 to 255.
pub(super) fn describe(octave: &Octave, e: &Extremum, angle: f32) -> [f32; 128] {
    let cell = CELL * e.sigma;
    let reach = (cell * std::f32::consts::SQRT_2 * (CELLS as f32 + 1.0) * 0.5).round() as usize;
    let histogram = gather(octave, e, angle, cell, reach.min(ROW / 2 - 1));
    let mut out = [0.0; 128];
    for (i, out) in out.chunks_exact_mut(DIRECTIONS).enumerate() {
        out.copy_from_slice(&histogram[1 + i / CELLS][1 + i % CELLS]);
    }
    let norm = |v: &[f32; 128]| v.iter().map(|v| v * v).sum::<f32>().sqrt();
    let bound = LARGEST * norm(&out);
    out.iter_mut().for_each(|v| *v = v.min(bound));
    let scale = 512.0 / norm(&out).max(f32::MIN_POSITIVE);
    out.map(|v| (v * scale).round().min(255.0))
}

/// Every gradient shared among the nearest cells and directions.
#[inline(always)]
fn gather(octave: &Octave, e: &Extremum, angle: f32, cell: f32, reach: usize) -> Histogram {
    let [w, h] = octave.size;
    let [cx, cy] = [e.x.round() as usize, e.y.round() as usize];
    let (cos, sin) = (angle.cos() / cell, angle.sin() / cell);
    let bell = bell(reach, 0.5 * CELLS as f32 * cell);
    let mut histogram: Histogram = [[[0.0; DIRECTIONS]; CELLS + 2]; CELLS + 2];
    let mut gradients = OctaveGradients::new();
    let (top, bottom) = (cy.saturating_sub(reach).max(1), (cy + reach).min(h - 2));
    for y in top..=bottom {
        let dy = y as f32 - cy as f32;
        let Some([left, right]) = span([cos, sin], dy, cx, reach.min(w), w) else { continue };
        let count = right + 1 - left;
        gradients.fill(&octave.layers[e.nearest[2]], w, [left, y], count);
        let across = bell[y + reach - cy];
        for i in 0..count {
            let dx = (left + i) as f32 - cx as f32;
            // The middle of the first cell lies at 1: the rim is 0.
            let half = 0.5 * CELLS as f32 + 0.5;
            let (u, v) = (dx * cos + dy * sin + half, dy * cos - dx * sin + half);
            let inside = u > 0.0 && v > 0.0 && u < (CELLS + 1) as f32 && v < (CELLS + 1) as f32;
            if inside {
                let weight = across * bell[left + i + reach - cx] * gradients.magnitude[i];
                share(&mut histogram, [u, v], angle - gradients.angle[i], weight);
            }
        }
    }
    histogram
}

/// First and last column of a row that may lie in the turned square; `None` where none does.
fn span([cos, sin]: [f32; 2], dy: f32, cx: usize, reach: usize, w: usize) -> Option<[usize; 2]> {
    let half = 0.5 * (CELLS as f32 + 1.0);
    let (mut low, mut high) = (-(reach as f32), reach as f32);
    // |dx a + b| < half for both axes.
    for (a, b) in [(cos, dy * sin), (-sin, dy * cos)] {
        if a.abs() > 1e-6 {
            let ends = [(-half - b) / a, (half - b) / a];
            low = low.max(ends[0].min(ends[1]));
            high = high.min(ends[0].max(ends[1]));
        }
    }
    let left = (cx as f32 + low).floor().max(1.0) as usize;
    let right = (cx as f32 + high).ceil().clamp(0.0, (w - 2) as f32) as usize;
    (low <= high && left <= right).then_some([left, right.min(left + ROW - 1)])
}

#[inline(always)]
fn share(histogram: &mut Histogram, [u, v]: [f32; 2], angle: f32, weight: f32) {
    let (column, row) = (u as usize, v as usize);
    let (fu, fv) = (u - column as f32, v - row as f32);
    // The difference of two angles lies within ±2 turns.
    let o = angle * (DIRECTIONS as f32 / TAU) + 2.0 * DIRECTIONS as f32;
    let fo = o - (o as usize) as f32;
    let (first, second) = (o as usize % DIRECTIONS, (o as usize + 1) % DIRECTIONS);
    let rows = [(row, weight * (1.0 - fv)), (row + 1, weight * fv)];
    for (row, weight) in rows {
        let Some(cells) = histogram.get_mut(row) else { continue };
        for (column, weight) in [(column, weight * (1.0 - fu)), (column + 1, weight * fu)] {
            let Some(cell) = cells.get_mut(column) else { continue };
            cell[first] += weight * (1.0 - fo);
            cell[second] += weight * fo;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scale_space::tests::noisy;
    use super::*;

    /// Against the definition, pixel by pixel: a Gaussian of half the width of the cells weighs
    /// each.
    #[test]
    fn a_histogram_is_the_sum_over_its_pixels() {
        let octave = noisy([40, 33]);
        let layer = &octave.layers[2];
        let at = |x: usize, y: usize| layer[y * 80 + x];
        let (cell, reach, angle) = (3.0, 11, 0.7f32);
        // Amid the image, and where the window is cut off.
        for [cx, cy] in [[40usize, 30usize], [6, 59], [74, 20]] {
            let (x, y) = (cx as f32 + 0.25, cy as f32 - 0.25);
            let e = Extremum { x, y, nearest: [cx, cy, 2], sigma: 1.0, response: 0.1 };
            let found = gather(&octave, &e, angle, cell, reach);
            let mut by_hand: Histogram = [[[0.0; DIRECTIONS]; CELLS + 2]; CELLS + 2];
            for y in cy.saturating_sub(reach).max(1)..=(cy + reach).min(64) {
                for x in cx.saturating_sub(reach).max(1)..=(cx + reach).min(78) {
                    let (dx, dy) = (x as f32 - cx as f32, y as f32 - cy as f32);
                    let turned =
                        [dx * angle.cos() + dy * angle.sin(), dy * angle.cos() - dx * angle.sin()];
                    let [u, v] = turned.map(|d| d / cell + 2.5);
                    let gradient = [at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)];
                    let bell = (-0.5 * (dx * dx + dy * dy) / (2.0 * cell).powi(2)).exp();
                    let weight = bell * gradient[0].hypot(gradient[1]);
                    if [u, v].iter().all(|d| *d > 0.0 && *d < 5.0) {
                        share(&mut by_hand, [u, v], angle - gradient[1].atan2(gradient[0]), weight);
                    }
                }
            }
            let flat = |h: &Histogram| h.as_flattened().as_flattened().to_vec();
            let (found, by_hand) = (flat(&found), flat(&by_hand));
            let largest = by_hand.iter().copied().fold(0.0, f32::max);
            assert!(found.iter().zip(&by_hand).all(|(a, b)| (a - b).abs() < 1e-3 * largest));
        }
    }

    #[test]
    fn a_gradient_is_shared_by_hand() {
        let mut histogram: Histogram = [[[0.0; DIRECTIONS]; CELLS + 2]; CELLS + 2];
        share(&mut histogram, [1.25, 2.5], -TAU / 16.0, 8.0);
        // Half a direction below 0: the last and the first.
        assert!((histogram[2][1][7] - 8.0 * 0.5 * 0.75 * 0.5).abs() < 1e-5);
        assert!((histogram[3][2][0] - 8.0 * 0.5 * 0.25 * 0.5).abs() < 1e-5);
        let total: f32 = histogram.iter().flatten().flatten().sum();
        assert!((total - 8.0).abs() < 1e-5);
    }

    #[test]
    fn a_span_holds_the_square() {
        let (angle, cell) = (0.7f32, 4.0f32);
        let turned = [angle.cos() / cell, angle.sin() / cell];
        for dy in -15..=15 {
            let dy = dy as f32;
            let inside = |dx: i32| {
                let dx = dx as f32;
                let (u, v) = (dx * turned[0] + dy * turned[1], dy * turned[0] - dx * turned[1]);
                u.abs() < 2.5 && v.abs() < 2.5
            };
            let span = span(turned, dy, 40, 14, 100);
            for dx in (-14..=14).filter(|dx| inside(*dx)) {
                let column = (40 + dx) as usize;
                assert!(span.is_some_and(|[l, r]| (l..=r).contains(&column)), "{dx} {dy}");
            }
        }
    }
}
