//! Seeded random draws for the sampling loops.

/// SplitMix64 (Steele, Lea, Flood 2014): small, fast, the same on every machine.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// A generator for one task: `seed` from the options, `task` tells the tasks apart.
    pub fn new(seed: u64, task: u64) -> Self {
        let mut random = Self(seed ^ task.wrapping_mul(0xD1B5_4A32_D192_ED03));
        random.next();
        random
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// An index below `n`, `n > 0`.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.next() as u128 * n as u128) >> 64) as usize
    }

    /// `K` different indices below `n`; `n ≥ K` is required.
    pub fn sample<const K: usize>(&mut self, n: usize) -> [usize; K] {
        debug_assert!(n >= K);
        let mut drawn = [usize::MAX; K];
        for k in 0..K {
            drawn[k] = loop {
                let index = self.below(n);
                if !drawn[..k].contains(&index) {
                    break index;
                }
            };
        }
        drawn
    }
}

/// Draws after which an all-inlier sample of `size` has been seen with probability 0.9999.
pub(crate) fn draws_needed(inliers: usize, total: usize, size: i32) -> usize {
    let all_good = (inliers as f64 / total.max(1) as f64).powi(size);
    if all_good >= 1.0 - 1e-12 {
        return 1;
    }
    let needed = (1e-4_f64).ln() / (-all_good).ln_1p();
    if needed.is_finite() { needed.ceil() as usize } else { usize::MAX }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_differ_and_repeat_with_the_seed() {
        let (mut a, mut b) = (Random::new(7, 1), Random::new(7, 1));
        let (x, y) = (a.sample::<5>(6), b.sample::<5>(6));
        assert_eq!(x, y);
        let mut sorted = x;
        sorted.sort_unstable();
        assert!(sorted.windows(2).all(|w| w[0] < w[1]) && sorted[4] < 6);
    }

    #[test]
    fn half_inliers_need_about_300_draws_of_five() {
        assert_eq!(draws_needed(50, 100, 5), 291);
        assert_eq!(draws_needed(100, 100, 5), 1);
    }
}
