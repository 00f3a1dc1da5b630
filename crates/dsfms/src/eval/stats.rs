//! Statistics of a list of errors.

use serde::{Deserialize, Serialize};

/// Statistics of absolute errors, in the unit of the errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorStats {
    /// Number of errors.
    pub count: usize,
    /// Root mean square.
    pub rms: f64,
    /// Mean of absolute values.
    pub mean: f64,
    /// The middle value (the mean of the middle two for an even count).
    pub median: f64,
    /// Nine of ten absolute values are at most this (nearest rank).
    pub p90: f64,
    /// Largest absolute value.
    pub max: f64,
}

impl ErrorStats {
    /// Statistics of the absolute values; `None` for an empty list.
    pub fn of(errors: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = errors.into_iter().map(f64::abs).collect();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        let max = *sorted.last()?;
        Some(Self {
            count: n,
            rms: (sorted.iter().map(|e| e * e).sum::<f64>() / n as f64).sqrt(),
            mean: sorted.iter().sum::<f64>() / n as f64,
            median: 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
            p90: sorted[(n * 9).div_ceil(10) - 1],
            max,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let s = ErrorStats::of([3.0, -1.0, 2.0, 4.0]).unwrap();
        assert_eq!((s.count, s.mean, s.median, s.p90, s.max), (4, 2.5, 2.5, 4.0, 4.0));
        assert!((s.rms - 7.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(ErrorStats::of((1..=10).map(f64::from)).unwrap().p90, 9.0);
        assert_eq!(ErrorStats::of([]), None);
    }
}
