//! The median of the last values.

use crate::geometry::median;
use std::collections::VecDeque;

/// Good frames that are remembered: four seconds, so that smoke which thickens slowly is not taken
/// for the new usual.
const REMEMBERED: usize = 100;

/// Fewer tell nothing: from the fourth good frame on the median of a clip stays within a fifth.
const ENOUGH: usize = 4;

/// The photometric residual of the last good frames: the measure for smoke, blur and glare.
pub(super) type UsualResidual = RecentMedian<REMEMBERED, ENOUGH>;

/// The last `MOST` values; fewer than `ENOUGH` tell nothing.
#[derive(Clone, Debug, Default)]
pub(super) struct RecentMedian<const MOST: usize, const ENOUGH: usize>(VecDeque<f64>);

impl<const MOST: usize, const ENOUGH: usize> RecentMedian<MOST, ENOUGH> {
    /// Remember a value.
    pub(super) fn add(&mut self, value: f64) {
        if self.0.len() == MOST {
            self.0.pop_front();
        }
        self.0.push_back(value);
    }

    /// Their median; `None` where there are too few.
    pub(super) fn median(&self) -> Option<f64> {
        if self.0.len() < ENOUGH {
            return None;
        }
        median(&mut self.0.iter().copied().collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_tell_nothing_and_the_oldest_are_forgotten() {
        let mut recent = RecentMedian::<10, 4>::default();
        (0..3).for_each(|_| recent.add(1.0));
        assert_eq!(recent.median(), None);
        recent.add(1.0);
        assert_eq!(recent.median(), Some(1.0));
        (0..6).for_each(|_| recent.add(2.0));
        (0..4).for_each(|_| recent.add(3.0));
        assert_eq!((recent.0.len(), recent.0[0]), (10, 2.0));
    }
}
