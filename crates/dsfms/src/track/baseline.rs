//! What the light usually leaves unexplained: the measure for smoke, blur and glare.

use crate::geometry::median;
use std::collections::VecDeque;

/// Good frames that are remembered: four seconds, so that smoke which thickens slowly is not taken
/// for the new usual.
const REMEMBERED: usize = 100;

/// Fewer tell nothing: from the fourth good frame on the median of a clip stays within a fifth.
const ENOUGH: usize = 4;

/// Photometric residuals of the last good frames.
#[derive(Default)]
pub(super) struct BaselineResidual {
    residuals: VecDeque<f64>,
}

impl BaselineResidual {
    /// Remember a good frame.
    pub(super) fn add(&mut self, residual: f64) {
        if self.residuals.len() == REMEMBERED {
            self.residuals.pop_front();
        }
        self.residuals.push_back(residual);
    }

    /// Their median; `None` where there are too few.
    pub(super) fn median(&self) -> Option<f64> {
        if self.residuals.len() < ENOUGH {
            return None;
        }
        median(&mut self.residuals.iter().copied().collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_tell_nothing_and_the_oldest_are_forgotten() {
        let mut usual = BaselineResidual::default();
        (0..ENOUGH - 1).for_each(|_| usual.add(1.0));
        assert_eq!(usual.median(), None);
        usual.add(1.0);
        assert_eq!(usual.median(), Some(1.0));
        (0..REMEMBERED - ENOUGH).for_each(|_| usual.add(2.0));
        (0..ENOUGH).for_each(|_| usual.add(3.0));
        assert_eq!(usual.residuals.len(), REMEMBERED);
        assert_eq!(usual.residuals[0], 2.0);
    }
}
