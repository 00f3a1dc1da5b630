//! A sparse triangular factor laid out for many solves in single precision.

use super::cholesky::Panel;

/// Values side by side, which the compiler makes vectors of; columns are padded with zeros to whole
/// ones.
const LANES: usize = 8;

/// `L` of `A = L Lᵀ`, panel by panel: a panel is adjacent columns with the same rows below them.
///
/// The diagonal blocks are inverted, so that a solve is nothing but products of dense matrices and
/// vectors, without a division or a value that waits for the one before.
#[derive(Clone, Debug, Default)]
pub(super) struct Panels {
    panels: Vec<PanelShape>,
    /// Rows below the diagonal blocks.
    below: Vec<u32>,
    /// Of every panel the inverse of its diagonal block, then what is below, both column by column.
    values: Vec<f32>,
}

/// Where a panel lies.
#[derive(Clone, Copy, Debug)]
struct PanelShape {
    /// First column.
    begin: usize,
    /// Columns.
    width: usize,
    /// First of the rows below, and their number.
    below: [usize; 2],
    /// First value.
    values: usize,
}

impl PanelShape {
    /// Padded heights of the diagonal block and of what is below.
    fn heights(&self) -> [usize; 2] {
        [self.width, self.below[1]].map(|n| n.next_multiple_of(LANES))
    }
}

impl Panels {
    /// Take the values of a factor.
    pub(super) fn set<'a>(&mut self, panels: impl Iterator<Item = Panel<'a>>) {
        self.panels.clear();
        self.below.clear();
        self.values.clear();
        let mut inverse = Vec::new();
        for panel in panels {
            let rows = [self.below.len(), panel.below.len()];
            let (begin, width) = (panel.begin, panel.width);
            let shape = PanelShape { begin, width, below: rows, values: self.values.len() };
            self.below.extend(panel.below.iter().map(|&row| row as u32));
            let [high, low] = shape.heights();
            self.values.resize(shape.values + (high + low) * width, 0.0);
            let (diagonal, below) = self.values[shape.values..].split_at_mut(high * width);
            invert(&panel, &mut inverse);
            for c in 0..width {
                let to = &mut diagonal[c * high..][..width];
                to.iter_mut().zip(&inverse[c * width..]).for_each(|(to, v)| *to = *v as f32);
                let to = below[c * low..].iter_mut();
                to.zip(panel.column(c).1).for_each(|(to, v)| *to = *v as f32);
            }
            self.panels.push(shape);
        }
    }

    /// Solve `A x = b` in place for `K` right-hand sides.
    pub(super) fn solve<const K: usize>(&self, x: &mut [Vec<f32>; K], memory: &mut [Vec<f32>; 2]) {
        let [inside, outside] = memory;
        for panel in &self.panels {
            let ([high, low], rows) = (panel.heights(), self.rows(panel));
            let (diagonal, below) = self.blocks(panel);
            for x in x.iter_mut() {
                let here = panel.begin..panel.begin + panel.width;
                times(diagonal, high, &x[here.clone()], inside);
                x[here].copy_from_slice(&inside[..panel.width]);
                times(below, low, &inside[..panel.width], outside);
                rows.iter().zip(outside.iter()).for_each(|(&row, v)| x[row as usize] -= v);
            }
        }
        for panel in self.panels.iter().rev() {
            let ([high, low], rows) = (panel.heights(), self.rows(panel));
            let (diagonal, below) = self.blocks(panel);
            for x in x.iter_mut() {
                outside.clear();
                outside.extend(rows.iter().map(|&row| x[row as usize]));
                outside.resize(low, 0.0);
                let here = &mut x[panel.begin..panel.begin + panel.width];
                inside.clear();
                inside.extend_from_slice(here);
                inside.resize(high, 0.0);
                times_transposed(below, low, outside, |c, product| inside[c] -= product);
                times_transposed(diagonal, high, inside, |c, product| here[c] = product);
            }
        }
    }

    fn rows(&self, panel: &PanelShape) -> &[u32] {
        &self.below[panel.below[0]..][..panel.below[1]]
    }

    fn blocks(&self, panel: &PanelShape) -> (&[f32], &[f32]) {
        let [high, low] = panel.heights();
        let values = &self.values[panel.values..][..(high + low) * panel.width];
        values.split_at(high * panel.width)
    }
}

/// The inverse of a panel's diagonal block, column by column.
fn invert(panel: &Panel, inverse: &mut Vec<f64>) {
    let n = panel.width;
    inverse.clear();
    inverse.resize(n * n, 0.0);
    for (c, column) in inverse.chunks_exact_mut(n).enumerate() {
        column[c] = 1.0;
        for k in c..n {
            let l = panel.column(k).0;
            column[k] /= l[k];
            let value = column[k];
            column[k + 1..].iter_mut().zip(&l[k + 1..]).for_each(|(x, l)| *x -= l * value);
        }
    }
}

/// `to = M x`, with the columns of `M` of `height` values each.
fn times(matrix: &[f32], height: usize, x: &[f32], to: &mut Vec<f32>) {
    to.clear();
    to.resize(height, 0.0);
    if height == 0 {
        return;
    }
    let mut columns = matrix.chunks_exact(4 * height);
    let fours = x.chunks_exact(4);
    let rest = fours.remainder();
    for (four, x) in (&mut columns).zip(fours) {
        let (ab, cd) = four.split_at(2 * height);
        let ((a, b), (c, d)) = (ab.split_at(height), cd.split_at(height));
        for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *to += (a * x[0] + b * x[1]) + (c * x[2] + d * x[3]);
        }
    }
    for (column, x) in columns.remainder().chunks_exact(height).zip(rest) {
        to.iter_mut().zip(column).for_each(|(to, v)| *to += v * x);
    }
}

/// Every component of `Mᵀ x`.
fn times_transposed(matrix: &[f32], height: usize, x: &[f32], mut take: impl FnMut(usize, f32)) {
    if height == 0 {
        return;
    }
    for (c, column) in matrix.chunks_exact(height).enumerate() {
        let mut sums = [0.0; LANES];
        for (v, x) in column.chunks_exact(LANES).zip(x.chunks_exact(LANES)) {
            (0..LANES).for_each(|k| sums[k] += v[k] * x[k]);
        }
        let half: [f32; 4] = std::array::from_fn(|k| sums[k] + sums[k + 4]);
        take(c, (half[0] + half[1]) + (half[2] + half[3]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::cholesky::{Cholesky, Factor};

    #[test]
    fn a_solve_is_that_of_the_factor_to_single_precision() {
        // Every entry within `BAND` of the diagonal: panels with and without rows below, and of
        // widths that are no multiple of anything.
        const BAND: usize = 11;
        let n = 47;
        let (mut col_ptr, mut row_idx, mut values) = (vec![0], Vec::new(), Vec::new());
        for column in 0..n {
            for row in column..n.min(column + 1 + column % BAND) {
                row_idx.push(row);
                values.push(if row == column { 20.0 } else { -1.0 / (1 + row - column) as f64 });
            }
            col_ptr.push(row_idx.len());
        }
        let cholesky = Cholesky::analyse(n, col_ptr, row_idx).unwrap();
        let mut factor = Factor::default();
        cholesky.factorise(&values, &mut factor).unwrap();
        let right = |i: usize| [((7 * i) % 11) as f64 - 5.0, ((5 * i) % 13) as f64];
        let mut expected: Vec<[f64; 2]> = (0..n).map(right).collect();
        cholesky.solve(&factor, &mut expected);
        let mut panels = Panels::default();
        // A second set finds the memory of the first.
        (0..2).for_each(|_| panels.set(cholesky.panels(&factor)));
        let mut x = [0, 1].map(|k| (0..n).map(|i| right(i)[k] as f32).collect::<Vec<_>>());
        panels.solve(&mut x, &mut Default::default());
        for (i, expected) in expected.iter().enumerate() {
            assert!((0..2).all(|k| (f64::from(x[k][i]) - expected[k]).abs() < 1e-5), "{i}");
        }
    }
}
