//! Descriptor matching: all similarities as one matrix product, mutual nearest, ratio test.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// A pair of features that look alike.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DescriptorMatch {
    /// Index into the first set.
    pub a: u32,
    /// Index into the second set.
    pub b: u32,
    /// Euclidean distance of the unit descriptors, 0 to √2.
    pub distance: f32,
}

/// Descriptors of a frame as unit rows, ready to be multiplied.
#[derive(Clone, Debug)]
pub struct UnitDescriptors {
    rows: Vec<f32>,
}

impl UnitDescriptors {
    /// Normalise RootSIFT bytes.
    pub fn new(descriptors: &[[u8; 128]]) -> Self {
        let mut rows = Vec::with_capacity(descriptors.len() * 128);
        for descriptor in descriptors {
            let norm = descriptor.iter().map(|&v| (v as f32).powi(2)).sum::<f32>().sqrt();
            rows.extend(descriptor.iter().map(|&v| v as f32 / norm.max(1.0)));
        }
        Self { rows }
    }

    /// Number of descriptors.
    pub fn len(&self) -> usize {
        self.rows.len() / 128
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Row `i`, 128 values of unit norm.
    pub fn row(&self, i: usize) -> &[f32] {
        &self.rows[i * 128..][..128]
    }

    /// `count` rows from row `start`, 128 values each.
    pub(super) fn rows(&self, start: usize, count: usize) -> &[f32] {
        &self.rows[start * 128..][..count * 128]
    }

    /// The first `n` rows (all, if there are fewer).
    pub fn head(&self, n: usize) -> Self {
        Self { rows: self.rows[..(n * 128).min(self.rows.len())].to_vec() }
    }
}

/// Distance of two unit vectors from their scalar product.
pub(crate) fn distance(dot: f32) -> f32 {
    (2.0 - 2.0 * dot.min(1.0)).max(0.0).sqrt()
}

/// Rows or columns compared at once: fixed-size arrays that the compiler turns into registers.
pub(super) const LANES: usize = 16;

/// Scalar product of two unit descriptors, summed in a fixed order.
pub(crate) fn product(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        (0..LANES).for_each(|l| sums[l] += a[l] * b[l]);
    }
    sums.iter().sum()
}

/// Largest and second largest product so far, and where the largest is, of [`LANES`] rows or
/// columns.
#[derive(Clone, Copy)]
struct TwoBest {
    index: [u32; LANES],
    best: [f32; LANES],
    second: [f32; LANES],
}

impl TwoBest {
    const EMPTY: Self =
        Self { index: [0; LANES], best: [f32::MIN; LANES], second: [f32::MIN; LANES] };

    /// Of equal products the first stays the largest, and the other is the second largest.
    #[inline]
    fn offer(&mut self, index: u32, values: &[f32; LANES]) {
        if !(0..LANES).fold(false, |any, l| any | (values[l] > self.second[l])) {
            return;
        }
        #[allow(clippy::needless_range_loop, reason = "one lane of every array")]
        for l in 0..LANES {
            let (v, best) = (values[l], self.best[l]);
            let less = if v > best { best } else { v };
            self.second[l] = if less > self.second[l] { less } else { self.second[l] };
            self.index[l] = if v > best { index } else { self.index[l] };
            self.best[l] = if v > best { v } else { best };
        }
    }

    fn at(&self, l: usize) -> (usize, f32, f32) {
        (self.index[l] as usize, self.best[l], self.second[l])
    }
}

/// Nearest and second nearest column of one row: `(index, product)` and the second's product. Of
/// equal products the first is the nearest.
fn two_best(row: &[f32]) -> (usize, f32, f32) {
    let (mut index, mut best, mut second) = (usize::MAX, f32::MIN, f32::MIN);
    for (block, values) in row.chunks(LANES).enumerate() {
        // Hardly any block holds one of the two.
        if values.iter().fold(false, |any, &v| any | (v > second)) {
            for (l, &v) in values.iter().enumerate() {
                if v > best {
                    (index, best, second) = (block * LANES + l, v, best);
                } else if v > second {
                    second = v;
                }
            }
        }
    }
    (index, best, second)
}

/// Mutual nearest neighbours whose distance is less than `ratio` times that to the second nearest
/// (both ways) and at most `max_distance`; ordered by `a`.
pub fn match_unit(
    a: &UnitDescriptors,
    b: &UnitDescriptors,
    ratio: f32,
    max_distance: f32,
) -> Vec<DescriptorMatch> {
    /// Rows per product: the block of similarities stays in the cache.
    const BLOCK: usize = 128;
    let (na, nb) = (a.len(), b.len());
    if na == 0 || nb == 0 {
        return Vec::new();
    }
    let mut block = vec![0.0f32; BLOCK.min(na) * nb];
    let mut forward = Vec::with_capacity(na);
    // Columns beyond the last one are never asked.
    let mut columns = vec![TwoBest::EMPTY; nb.div_ceil(LANES)];
    for start in (0..na).step_by(BLOCK) {
        let rows = BLOCK.min(na - start);
        matmul(
            MatMut::from_row_major_slice_mut(&mut block[..rows * nb], rows, nb),
            Accum::Replace,
            MatRef::from_row_major_slice(&a.rows[start * 128..][..rows * 128], rows, 128),
            MatRef::from_column_major_slice(&b.rows, 128, nb),
            1.0f32,
            Par::Seq,
        );
        for (i, row) in block[..rows * nb].chunks_exact(nb).enumerate() {
            forward.push(two_best(row));
            let (blocks, rest) = row.as_chunks::<LANES>();
            let mut last = [f32::MIN; LANES];
            last[..rest.len()].copy_from_slice(rest);
            for (column, values) in columns.iter_mut().zip(blocks.iter().chain([&last])) {
                column.offer((start + i) as u32, values);
            }
        }
    }
    let clear = |best: f32, second: f32| distance(best) < ratio * distance(second);
    let keep = |(i, &(j, best, second)): (usize, &(usize, f32, f32))| {
        let (back, _, column_second) = columns[j / LANES].at(j % LANES);
        let good = back == i
            && distance(best) <= max_distance
            && clear(best, second)
            && clear(best, column_second);
        good.then(|| DescriptorMatch { a: i as u32, b: j as u32, distance: distance(best) })
    };
    forward.iter().enumerate().filter_map(keep).collect()
}

/// [`match_unit`] on RootSIFT bytes, e.g. of a template and a frame.
pub fn match_descriptors(
    a: &[[u8; 128]],
    b: &[[u8; 128]],
    ratio: f32,
    max_distance: f32,
) -> Vec<DescriptorMatch> {
    match_unit(&UnitDescriptors::new(a), &UnitDescriptors::new(b), ratio, max_distance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sfm::random::Random;

    fn random_descriptors(n: usize, seed: u64) -> Vec<[u8; 128]> {
        let mut random = Random::new(seed, 0);
        (0..n).map(|_| std::array::from_fn(|_| random.below(90) as u8)).collect()
    }

    #[test]
    fn finds_a_permutation_and_nothing_else() {
        let a = random_descriptors(300, 1);
        let mut b: Vec<_> = a.iter().rev().copied().collect();
        b.iter_mut().for_each(|d| d[3] = d[3].saturating_add(9));
        b.extend(random_descriptors(50, 2));
        let found = match_descriptors(&a, &b, 0.8, 0.7);
        assert_eq!(found.len(), 300);
        assert!(found.iter().all(|m| m.a + m.b == 299 && m.distance < 0.05));
    }

    #[test]
    fn the_two_best_by_hand() {
        let mut row: Vec<f32> = (0..50).map(|i| (i % 7) as f32).collect();
        assert_eq!(two_best(&row), (6, 6.0, 6.0));
        row[49] = 8.0;
        assert_eq!(two_best(&row), (49, 8.0, 6.0));
        row[3] = 9.0;
        assert_eq!(two_best(&row), (3, 9.0, 8.0));
        let mut lanes = TwoBest::EMPTY;
        for (index, v) in [3.0, 5.0, 4.0, 5.0, 1.0].into_iter().enumerate() {
            lanes.offer(index as u32, &[v; LANES]);
        }
        assert_eq!(lanes.at(7), (1, 5.0, 5.0));
    }

    #[test]
    fn rows_are_those_of_their_numbers() {
        let unit = UnitDescriptors::new(&random_descriptors(300, 1));
        assert_eq!(unit.rows(130, 2), [unit.row(130), unit.row(131)].concat());
        assert_eq!(unit.head(3).row(2), unit.row(2));
        assert_eq!((unit.head(400).len(), unit.head(3).len()), (300, 3));
    }

    #[test]
    fn a_repeated_descriptor_is_ambiguous() {
        let a = random_descriptors(2, 3);
        let b = vec![a[0], a[0], a[1]];
        let found = match_descriptors(&a, &b, 0.8, 0.7);
        assert_eq!(found.iter().map(|m| (m.a, m.b)).collect::<Vec<_>>(), [(1, 2)]);
        assert!(match_descriptors(&a, &[], 0.8, 0.7).is_empty());
    }
}
