//! A picture on a coarser grid and back: what a wide blur leaves has no finer detail.

use super::Plane;
use rayon::prelude::*;

/// Cells that a blur reaches with one standard deviation, at least: wide enough that straight lines
/// between the cells are the blur to a hundredth.
const CELLS: f64 = 3.5;

/// A grid whose cells are blocks of some pixels; those at the right and lower border may be cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReducedGrid {
    /// Pixels of a block along a side.
    factor: usize,
    size: [usize; 2],
}

impl ReducedGrid {
    /// The coarsest for a blur of standard deviation `sigma` px; `None` where the pixels
    /// themselves are.
    pub(super) fn of(size: [usize; 2], sigma: f64) -> Option<Self> {
        let halvings = (sigma / CELLS).log2().floor();
        // A block of 16 px is for a blur of 56 px: wider ones take no time worth saving.
        (halvings >= 1.0).then(|| Self { factor: 1 << (halvings as usize).min(4), size })
    }

    /// Number of cells along both sides.
    fn cells(&self) -> [usize; 2] {
        self.size.map(|n| n.div_ceil(self.factor))
    }

    /// Standard deviation, in cells, of the blur between [`mean`](Self::mean) and
    /// [`expanded`](Self::expanded), which are blurs themselves: a box of `f` px has the variance
    /// `(f² − 1)/12`, straight lines between cells `f²/6`.
    pub(super) fn sigma(&self, sigma: f64) -> f64 {
        let squared = (self.factor * self.factor) as f64;
        ((sigma * sigma - (squared - 1.0) / 12.0) / squared - 1.0 / 6.0).sqrt()
    }

    /// Mean of what `of` says of the pixels of every block.
    pub(super) fn mean(&self, of: impl Fn(usize) -> f32 + Sync) -> Plane {
        let ([w, h], size, f) = (self.size, self.cells(), self.factor);
        let mut data = vec![0.0; size[0] * size[1]];
        data.par_chunks_mut(size[0].max(1)).enumerate().for_each(|(k, cells)| {
            for y in k * f..((k + 1) * f).min(h) {
                for (block, cell) in cells.iter_mut().enumerate() {
                    let pixels = block * f..((block + 1) * f).min(w);
                    *cell += pixels.map(|x| of(y * w + x)).sum::<f32>();
                }
            }
            let pixels = |block: usize, n: usize| (n - block * f).min(f);
            let rows = pixels(k, h);
            cells.iter_mut().enumerate().for_each(|(k, v)| *v /= (rows * pixels(k, w)) as f32);
        });
        Plane { size, data }
    }

    /// Straight lines between the centres of the cells; beyond the last ones they go on level.
    pub(super) fn expanded(&self, cells: &Plane) -> Plane {
        let [columns, rows] = [0, 1].map(|c| self.between(self.size[c], cells.size[c]));
        let mut data = vec![0.0; self.size[0] * self.size[1]];
        data.par_chunks_mut(self.size[0].max(1)).zip(rows).for_each(|(out, (k, below))| {
            let row = |k: usize| &cells.data[k * cells.size[0]..][..cells.size[0]];
            let next = row((k + 1).min(cells.size[1] - 1));
            let row = row(k).iter().zip(next).map(|(a, b)| a + below * (b - a));
            let row: Vec<f32> = row.chain([0.0]).collect();
            out.iter_mut()
                .zip(&columns)
                .for_each(|(v, &(k, right))| *v = row[k] + right * (row[k + 1] - row[k]));
        });
        Plane { size: self.size, data }
    }

    /// Of `n` pixels the cell before each and the share of the one after.
    fn between(&self, n: usize, cells: usize) -> Vec<(usize, f32)> {
        let at = |x: usize| {
            let place = (x as f32 + 0.5) / self.factor as f32 - 0.5;
            let place = place.clamp(0.0, cells as f32 - 1.0);
            (place as usize, place.fract())
        };
        (0..n).map(at).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::filter::blur;

    const SIZE: [usize; 2] = [331, 297];

    /// Noise and steps, on a size that no block divides.
    fn picture() -> Plane {
        let value = |i: usize| ((i * 7919) % 1013) as f32 / 1013.0 + ((i % SIZE[0]) / 90) as f32;
        Plane { size: SIZE, data: (0..SIZE[0] * SIZE[1]).map(value).collect() }
    }

    #[test]
    fn a_wide_blur_by_blocks_is_the_blur() {
        let picture = picture();
        for (sigma, factor) in [(7.0, 2), (15.0, 4), (28.0, 8)] {
            let grid = ReducedGrid::of(SIZE, sigma).unwrap();
            assert_eq!(grid.factor, factor);
            let cells = grid.mean(|i| picture.data[i]);
            let found = grid.expanded(&blur(&cells, grid.sigma(sigma)));
            let whole = blur(&picture, sigma);
            // Farther from the border than either reaches: they treat it differently.
            let reach = 3 * sigma as usize + 3 * factor;
            let inner = |i: &usize| {
                let at = [i % SIZE[0], i / SIZE[0]];
                (0..2).all(|c| (reach..SIZE[c] - reach).contains(&at[c]))
            };
            let off = |i: usize| (found.data[i] - whole.data[i]).abs();
            let worst = (0..whole.data.len()).filter(inner).map(off).fold(0.0, f32::max);
            assert!(worst < 0.004, "{sigma}: {worst}");
        }
        assert_eq!(ReducedGrid::of([640, 480], 6.9), None);
    }

    #[test]
    fn cut_blocks_are_means_of_what_they_have() {
        let grid = ReducedGrid { factor: 4, size: [10, 5] };
        let columns = grid.mean(|i| (i % 10) as f32);
        assert_eq!(columns, Plane { size: [3, 2], data: vec![1.5, 5.5, 8.5, 1.5, 5.5, 8.5] });
        let ramp = Plane { size: [3, 2], data: vec![0.0, 4.0, 8.0, 0.0, 4.0, 8.0] };
        let fine = grid.expanded(&ramp);
        assert_eq!(fine.data[..10], [0.0, 0.0, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5]);
    }
}
