//! Robust means: weighted median, Tukey's biweight.

/// Tukey's constant: 95 % efficiency under Gaussian noise.
const TUKEY: f64 = 4.685;

/// Biweight of a residual, `(1 − (r/c)²)²` for `|r| < c = 4.685 scale`, else 0.
pub(super) fn tukey_weight(residual: f64, scale: f64) -> f64 {
    let u = residual / (TUKEY * scale);
    if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 }
}

/// Biweight loss in units of `scale²`: about `r²/scale²` for small residuals, at most `c²/3`.
pub(super) fn tukey_loss(residual: f64, scale: f64) -> f64 {
    let u = (residual / (TUKEY * scale)).abs().min(1.0);
    TUKEY * TUKEY / 3.0 * (1.0 - (1.0 - u * u).powi(3))
}

/// Smallest value below which half of the weight lies; sorts `samples` (value, weight). NaN for
/// no weight.
pub(super) fn weighted_median(samples: &mut [(f64, f64)]) -> f64 {
    samples.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * samples.iter().map(|s| s.1).sum::<f64>();
    let mut sum = 0.0;
    for &(value, weight) in samples.iter() {
        sum += weight;
        if sum >= half && weight > 0.0 {
            return value;
        }
    }
    f64::NAN
}

/// Tukey mean from the weighted median on; sorts `samples` (value, weight). NaN for no weight.
pub(super) fn tukey_mean(samples: &mut [(f64, f64)], scale: f64) -> f64 {
    let mut centre = weighted_median(samples);
    for _ in 0..5 {
        let (mut sum, mut total) = (0.0, 0.0);
        for &(value, weight) in samples.iter() {
            let w = weight * tukey_weight(value - centre, scale);
            sum += w * value;
            total += w;
        }
        if total <= 0.0 {
            break;
        }
        centre = sum / total;
    }
    centre
}

/// Robust standard deviation about zero: 1.4826 times the median of the absolute values.
pub(super) fn robust_scale(residuals: impl Iterator<Item = f64>) -> f64 {
    let mut samples: Vec<_> = residuals.map(|r| (r.abs(), 1.0)).collect();
    1.4826 * weighted_median(&mut samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_and_mean_ignore_an_outlier() {
        let mut samples = [(1.0, 1.0), (1.1, 1.0), (0.9, 1.0), (9.0, 1.0)];
        assert_eq!(weighted_median(&mut samples), 1.0);
        assert!((tukey_mean(&mut samples, 0.1) - 1.0).abs() < 1e-12);
        assert_eq!(weighted_median(&mut [(1.0, 1.0), (5.0, 3.0)]), 5.0);
        assert!(weighted_median(&mut []).is_nan());
    }

    #[test]
    fn loss_has_the_weight_as_its_slope() {
        for r in [0.05, 0.3, 1.0, 3.0] {
            let slope = (tukey_loss(r + 1e-6, 0.5) - tukey_loss(r - 1e-6, 0.5)) / 2e-6;
            assert!((slope - 2.0 * r / 0.25 * tukey_weight(r, 0.5)).abs() < 1e-6);
        }
    }
}
