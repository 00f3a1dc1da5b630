//! Corners on a grid: where a patch has texture to be followed by (`flow`).

use super::flow::RADIUS;
use super::{Mask, Plane};
use rayon::prelude::*;

/// Where corners are looked for.
#[derive(Clone, Copy, Debug)]
pub struct CornerGrid {
    /// One corner is sought in every square of this side, px.
    pub cell: usize,
    /// Of every so-manieth pixel across and down.
    pub stride: usize,
    /// Corners at most.
    pub most: usize,
}

/// The place with the most texture in its weakest direction (smaller eigenvalue of the structure
/// tensor) of every cell whose whole patch is known, best first; `known` has the size of the plane.
pub fn corners(plane: &Plane, known: &Mask, grid: &CornerGrid) -> Vec<[usize; 2]> {
    let [w, h] = plane.size;
    let (cell, stride) = (grid.cell, grid.stride);
    let margin = RADIUS as usize + 2;
    let cells: Vec<[usize; 2]> = (margin..h.saturating_sub(margin))
        .step_by(cell)
        .flat_map(|y| (margin..w.saturating_sub(margin)).step_by(cell).map(move |x| [x, y]))
        .collect();
    let best_of = |&[x0, y0]: &[usize; 2]| -> Option<(f32, [usize; 2])> {
        let places = (y0..(y0 + cell).min(h - margin))
            .step_by(stride)
            .flat_map(|y| (x0..(x0 + cell).min(w - margin)).step_by(stride).map(move |x| [x, y]));
        const R: usize = RADIUS as usize;
        let line = |x: usize, y: usize| [x - R, x, x + R].into_iter().all(|x| known.at(x, y));
        let inside = |&[x, y]: &[usize; 2]| [y - R, y, y + R].into_iter().all(|y| line(x, y));
        let scored = places.filter(inside).map(|p| (texture(plane, p), p));
        // NaN, where part of the patch is, is the largest of all numbers.
        let scored = scored.filter(|(texture, _)| *texture > 1e-6);
        scored.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
    };
    let mut found: Vec<(f32, [usize; 2])> = cells.par_iter().filter_map(best_of).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.truncate(grid.most);
    found.into_iter().map(|c| c.1).collect()
}

/// Smaller eigenvalue of the structure tensor over half a patch.
fn texture(plane: &Plane, [x, y]: [usize; 2]) -> f32 {
    let reach = RADIUS as usize / 2;
    let row = |y: usize, margin: usize| {
        let side = 2 * (reach + margin) + 1;
        &plane.data[y * plane.size[0] + x - reach - margin..][..side]
    };
    let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
    for v in y - reach..=y + reach {
        let across = row(v, 1).windows(3).map(|w| w[2] - w[0]);
        let down = row(v + 1, 0).iter().zip(row(v - 1, 0)).map(|(below, above)| below - above);
        for (dx, dy) in across.zip(down) {
            (a, b, c) = (a + dx * dx, b + dx * dy, c + dy * dy);
        }
    }
    0.5 * (a + c - ((a - c).powi(2) + 4.0 * b * b).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_is_found_and_an_edge_is_not() {
        // Bright right of column 20 (an edge) above, and in a quarter plane (a corner) below.
        let value = |i: usize| {
            let (x, y) = (i % 64, i / 64);
            f32::from(u8::from(if y < 40 { x >= 20 } else { x >= 40 && y >= 60 }))
        };
        let plane = Plane { size: [64, 80], data: (0..64 * 80).map(value).collect() };
        let below = |i: usize| i / 64 >= 45;
        let known = |keep: &dyn Fn(usize) -> bool| Mask {
            size: plane.size,
            data: (0..64 * 80).map(keep).collect(),
        };
        let grid = CornerGrid { cell: 16, stride: 1, most: 1 };
        let [x, y] = corners(&plane, &known(&below), &grid)[0];
        assert!(x.abs_diff(40) <= 4 && y.abs_diff(60) <= 4, "{x}, {y}");
        assert!(corners(&plane, &known(&|i| i / 64 < 36), &grid).is_empty());
    }
}
