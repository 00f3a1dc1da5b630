//! How much likelier a value is among the organ's than among the wall's, by histograms of what is
//! labelled so far.

const BINS: usize = 40;
/// Standard deviation of the smoothing, bins, and the share of values that may be anything.
const SMOOTH: f64 = 1.5;
const ANYTHING: f64 = 0.02;
/// The histogram spans all values but this share at either end: a few outliers do not stretch it.
const TAIL: f64 = 0.01;

/// The logarithm of `p(value | organ) / p(value | wall)`, by bins.
pub(super) struct LogRatio {
    low: f64,
    high: f64,
    ratio: [f64; BINS],
}

impl LogRatio {
    /// Learned from values (NaN = unknown) and the labels that they have; `true` = organ.
    pub(super) fn of(values: &[f64], organ: &[bool]) -> Self {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied();
        let (low, high) = (at(TAIL).unwrap_or(0.0), at(1.0 - TAIL).unwrap_or(1.0));
        let mut table = Self { low, high, ratio: [0.0; BINS] };
        let mut counts = [[0.0; BINS]; 2];
        for (v, organ) in values.iter().zip(organ) {
            if let Some(bin) = table.bin(*v) {
                counts[usize::from(*organ)][bin] += 1.0;
            }
        }
        let [wall, organ] = counts.map(likelihoods);
        table.ratio = std::array::from_fn(|b| (organ[b] / wall[b]).ln());
        table
    }

    fn bin(&self, value: f64) -> Option<usize> {
        let along = (value - self.low) / (self.high - self.low).max(f64::MIN_POSITIVE);
        value.is_finite().then(|| ((along * BINS as f64) as usize).min(BINS - 1))
    }

    /// 0 where the value is unknown.
    pub(super) fn at(&self, value: f64) -> f64 {
        self.bin(value).map_or(0.0, |bin| self.ratio[bin])
    }
}

fn likelihoods(counts: [f64; BINS]) -> [f64; BINS] {
    let kernel = |d: usize| (-0.5 * (d as f64 / SMOOTH).powi(2)).exp();
    let smooth: [f64; BINS] =
        std::array::from_fn(|b| (0..BINS).map(|k| kernel(b.abs_diff(k)) * counts[k]).sum());
    let all = smooth.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    smooth.map(|s| (1.0 - ANYTHING) * s / all + ANYTHING / BINS as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_one_label_speak_for_it_and_unknown_ones_for_none() {
        // Organ from 0 to 1, wall from 1 to 3: between 0 and 1 only organ.
        let values: Vec<f64> = (0..3000).map(|i| f64::from(i) * 1e-3).collect();
        let organ: Vec<bool> = values.iter().map(|v| *v < 1.0).collect();
        let ratio = LogRatio::of(&values, &organ);
        assert!(ratio.at(0.4) > 3.0 && ratio.at(2.2) < -3.0, "{} {}", ratio.at(0.4), ratio.at(2.2));
        assert!(ratio.at(1.0).abs() < 1.5, "{}", ratio.at(1.0));
        assert_eq!(ratio.at(f64::NAN), 0.0);
    }

    #[test]
    fn labels_that_look_alike_say_nothing_and_neither_does_one_label_alone_far_away() {
        let values: Vec<f64> = (0..4000).map(|i| f64::from(i / 2)).collect();
        let ratio = LogRatio::of(&values, &(0..4000).map(|i| i % 2 == 0).collect::<Vec<_>>());
        assert!(values.iter().all(|v| ratio.at(*v).abs() < 1e-9));
        // No value at all is known: both likelihoods are those of anything.
        assert_eq!(LogRatio::of(&[f64::NAN; 4], &[true, false, true, false]).at(0.3), 0.0);
    }
}
