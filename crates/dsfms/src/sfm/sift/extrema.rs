//! Extrema of the differences of Gaussians over place and scale.

use super::scale_space::{LAYERS, Octave, SIGMA};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Margin without keypoints, px.
const BORDER: usize = 5;
/// Steps to the extremum of the quadratic, at most.
const STEPS: usize = 5;
/// Largest ratio of the principal curvatures: more is an edge.
const EDGE: f64 = 10.0;
/// Rows that one task searches.
const ROWS: usize = 32;

/// A blob, in pixels of its octave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extremum {
    pub x: f32,
    pub y: f32,
    /// Pixel and layer nearest to it.
    pub nearest: [usize; 3],
    /// Standard deviation of its Gaussian.
    pub sigma: f32,
    /// Contrast.
    pub response: f32,
}

/// All extrema of at least this contrast that are no edges, row by row; each once.
pub(super) fn find(octave: &Octave, contrast: f64) -> Vec<Extremum> {
    let [w, h] = octave.size;
    if w <= 2 * BORDER || h <= 2 * BORDER {
        return Vec::new();
    }
    let rows: Vec<usize> = (BORDER..h - BORDER).collect();
    let parts: Vec<Vec<[usize; 3]>> =
        rows.par_chunks(ROWS).map(|rows| candidates(octave, rows, contrast)).collect();
    let starts: Vec<[usize; 3]> = parts.into_iter().flatten().collect();
    let refined: Vec<Option<Extremum>> =
        starts.par_iter().with_min_len(256).map(|s| refine(octave, *s, contrast)).collect();
    let mut found: Vec<Extremum> = refined.into_iter().flatten().collect();
    // Neighbouring starts may end at the same place.
    let key = |e: &Extremum| [e.nearest[1], e.nearest[0], e.nearest[2]];
    found.sort_by_key(key);
    found.dedup_by_key(|e| key(e));
    found
}

/// Pixels (x, y, layer) that no neighbour in place and scale exceeds.
fn candidates(octave: &Octave, rows: &[usize], contrast: f64) -> Vec<[usize; 3]> {
    let w = octave.size[0];
    let threshold = (0.5 * contrast / LAYERS as f64) as f32;
    let row = |l: usize, y: usize| &octave.layers[l][y * w..][..w];
    let mut differences = vec![[vec![0.0; w], vec![0.0; w], vec![0.0; w]]; LAYERS + 2];
    let fill = |differences: &mut Vec<[Vec<f32>; 3]>, y: usize| {
        for (l, rows) in differences.iter_mut().enumerate() {
            let out = rows[y % 3].iter_mut();
            out.zip(row(l + 1, y).iter().zip(row(l, y))).for_each(|(d, (b, a))| *d = b - a);
        }
    };
    // Largest and smallest of three rows, for every layer, then of three layers.
    let mut columns = vec![[vec![0.0; w], vec![0.0; w]]; LAYERS + 2];
    let mut all = [vec![0.0; w], vec![0.0; w]];
    let mut extreme = vec![false; w];
    let mut found = Vec::new();
    let Some(&first) = rows.first() else { return found };
    fill(&mut differences, first - 1);
    fill(&mut differences, first);
    for &y in rows {
        fill(&mut differences, y + 1);
        for ([high, low], [a, b, c]) in columns.iter_mut().zip(&differences) {
            for x in 0..w {
                high[x] = max(max(a[x], b[x]), c[x]);
                low[x] = min(min(a[x], b[x]), c[x]);
            }
        }
        for l in 1..=LAYERS {
            let [[h0, l0], [h1, l1], [h2, l2]] = [&columns[l - 1], &columns[l], &columns[l + 1]];
            let [high, low] = &mut all;
            for x in 0..w {
                high[x] = max(max(h0[x], h1[x]), h2[x]);
                low[x] = min(min(l0[x], l1[x]), l2[x]);
            }
            let value = &differences[l][y % 3][..w];
            let (high, low, extreme) = (&high[..w], &low[..w], &mut extreme[..w]);
            for x in 1..w - 1 {
                let top = max(max(high[x - 1], high[x]), high[x + 1]);
                let bottom = min(min(low[x - 1], low[x]), low[x + 1]);
                let v = value[x];
                extreme[x] = (v > threshold) & (v >= top) | (v < -threshold) & (v <= bottom);
            }
            let inner = (BORDER..w - BORDER).filter(|x| extreme[*x]);
            found.extend(inner.map(|x| [x, y, l]));
        }
    }
    found
}

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The extremum of the quadratic through a pixel and its neighbours; `None` where it runs away, is
/// faint or lies on an edge.
fn refine(
    octave: &Octave,
    [mut x, mut y, mut layer]: [usize; 3],
    contrast: f64,
) -> Option<Extremum> {
    let [w, h] = octave.size;
    for _ in 0..STEPS {
        let at = |dx: isize, dy: isize, dl: isize| {
            let i = y.wrapping_add_signed(dy) * w + x.wrapping_add_signed(dx);
            let l = layer.wrapping_add_signed(dl);
            f64::from(octave.layers[l + 1][i] - octave.layers[l][i])
        };
        let centre = at(0, 0, 0);
        let gradient = 0.5
            * Vector3::new(
                at(1, 0, 0) - at(-1, 0, 0),
                at(0, 1, 0) - at(0, -1, 0),
                at(0, 0, 1) - at(0, 0, -1),
            );
        let xx = at(1, 0, 0) + at(-1, 0, 0) - 2.0 * centre;
        let yy = at(0, 1, 0) + at(0, -1, 0) - 2.0 * centre;
        let ll = at(0, 0, 1) + at(0, 0, -1) - 2.0 * centre;
        let xy = 0.25 * (at(1, 1, 0) - at(-1, 1, 0) - at(1, -1, 0) + at(-1, -1, 0));
        let xl = 0.25 * (at(1, 0, 1) - at(-1, 0, 1) - at(1, 0, -1) + at(-1, 0, -1));
        let yl = 0.25 * (at(0, 1, 1) - at(0, -1, 1) - at(0, 1, -1) + at(0, -1, -1));
        let curvature = Matrix3::new(xx, xy, xl, xy, yy, yl, xl, yl, ll);
        let step = -(curvature.try_inverse()? * gradient);
        if step.iter().all(|s| s.abs() < 0.5) {
            let response = (centre + 0.5 * gradient.dot(&step)).abs();
            let (trace, determinant) = (xx + yy, xx * yy - xy * xy);
            let edge = trace * trace * EDGE >= (EDGE + 1.0) * (EDGE + 1.0) * determinant;
            if response * (LAYERS as f64) < contrast || determinant <= 0.0 || edge {
                return None;
            }
            return Some(Extremum {
                x: (x as f64 + step.x) as f32,
                y: (y as f64 + step.y) as f32,
                nearest: [x, y, layer],
                sigma: (SIGMA * ((layer as f64 + step.z) / LAYERS as f64).exp2()) as f32,
                response: response as f32,
            });
        }
        // A step that is no number goes nowhere near the image either.
        let moved = |v: usize, s: f64, [low, high]: [usize; 2]| {
            let to = v as f64 + s.round();
            (to >= low as f64 && to < high as f64).then_some(to as usize)
        };
        x = moved(x, step.x, [BORDER, w - BORDER])?;
        y = moved(y, step.y, [BORDER, h - BORDER])?;
        layer = moved(layer, step.z, [1, LAYERS + 1])?;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sfm::random::Random;

    /// Against the definition: of 27 pixels of place and scale none is above the middle one, or
    /// none below.
    #[test]
    fn candidates_are_all_extrema_and_no_others() {
        let (size, contrast) = ([40, 37], 0.3);
        let mut random = Random::new(7, 0);
        let mut noise = || random.below(1000) as f32 / 1000.0;
        let layers = (0..LAYERS + 3).map(|_| (0..40 * 37).map(|_| noise()).collect()).collect();
        let octave = Octave { size, layers };
        let difference = |x: usize, y: usize, l: usize| {
            octave.layers[l + 1][y * 40 + x] - octave.layers[l][y * 40 + x]
        };
        let extreme = |x: usize, y: usize, l: usize| {
            let around = (0..27).map(|k| (x + k % 3 - 1, y + k / 3 % 3 - 1, l + k / 9 - 1));
            let around: Vec<f32> = around.map(|(x, y, l)| difference(x, y, l)).collect();
            let (v, least) = (difference(x, y, l), (0.5 * contrast / LAYERS as f64) as f32);
            v > least && around.iter().all(|a| v >= *a)
                || v < -least && around.iter().all(|a| v <= *a)
        };
        let rows: Vec<usize> = (BORDER..37 - BORDER).collect();
        let mut by_hand = Vec::new();
        for &y in &rows {
            for l in 1..=LAYERS {
                let columns = (BORDER..40 - BORDER).filter(|&x| extreme(x, y, l));
                by_hand.extend(columns.map(|x| [x, y, l]));
            }
        }
        assert!(by_hand.len() > 50);
        assert_eq!(candidates(&octave, &rows, contrast), by_hand);
    }
}
