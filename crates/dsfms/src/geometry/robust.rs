//! What one wrong measurement among many may weigh: losses ρ(s) of a squared residual norm s = ‖r‖²
//! for the solver and for reweighted fits, Tukey's biweight, weighted medians.

use super::statistics::SIGMA_OVER_MAD;
use serde::{Deserialize, Serialize};

/// How a residual block's squared norm `s` enters the cost.
#[doc(alias("M-estimator", "robust kernel"))]
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Loss {
    /// `ρ = s`: least squares.
    #[default]
    Squared,
    /// `ρ = 2√(s + ε²) − 2ε`, ε = 10⁻³: the unsquared norm of the paper, smooth at 0.
    Norm,
    /// Quadratic up to `√s = k`, linear beyond.
    Huber(f64),
    /// `ρ = s / (1 + s/k²)`: bounded by k².
    GemanMcClure(f64),
}

impl Loss {
    /// `ρ(s)` and `ρ′(s)`.
    pub fn evaluate(self, s: f64) -> (f64, f64) {
        match self {
            Self::Squared => (s, 1.0),
            Self::Norm => {
                const EPSILON: f64 = 1e-3;
                let root = (s + EPSILON * EPSILON).sqrt();
                (2.0 * (root - EPSILON), 1.0 / root)
            }
            Self::Huber(k) if s <= k * k => (s, 1.0),
            Self::Huber(k) => (2.0 * k * s.sqrt() - k * k, k / s.sqrt()),
            // A point that the camera does not see: infinitely far off.
            Self::GemanMcClure(k) if s == f64::INFINITY => (k * k, 0.0),
            Self::GemanMcClure(k) => {
                let d = 1.0 + s / (k * k);
                (s / d, 1.0 / (d * d))
            }
        }
    }

    /// `d(s·ρ′)/ds = ρ′ + s·ρ″`: curvature of `ρ/2`, mean over the two components of a residual in
    /// the plane. Negative where a bounded loss gives in.
    pub fn slope(self, s: f64) -> f64 {
        let weight = self.evaluate(s).1;
        match self {
            Self::Squared => 1.0,
            Self::Norm => weight - 0.5 * s * weight.powi(3),
            Self::Huber(k) if s <= k * k => 1.0,
            Self::Huber(_) => 0.5 * weight,
            Self::GemanMcClure(k) => weight * (k * k - s) / (k * k + s),
        }
    }
}

/// Tukey's constant: 95 % efficiency under Gaussian noise.
const TUKEY: f64 = 4.685;

/// Biweight of a residual, `(1 − (r/c)²)²` for `|r| < c = 4.685 scale`, else 0.
pub(crate) fn tukey_weight(residual: f64, scale: f64) -> f64 {
    let u = residual / (TUKEY * scale);
    if u.abs() < 1.0 { (1.0 - u * u).powi(2) } else { 0.0 }
}

/// Biweight loss in units of `scale²`: about `r²/scale²` for small residuals, at most `c²/3`.
pub(crate) fn tukey_loss(residual: f64, scale: f64) -> f64 {
    let u = (residual / (TUKEY * scale)).abs().min(1.0);
    TUKEY * TUKEY / 3.0 * (1.0 - (1.0 - u * u).powi(3))
}

/// Smallest value below which half of the weight lies; sorts `samples` (value, weight). NaN for
/// no weight.
pub(crate) fn weighted_median(samples: &mut [(f64, f64)]) -> f64 {
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
pub(crate) fn tukey_mean(samples: &mut [(f64, f64)], scale: f64) -> f64 {
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
pub(crate) fn robust_scale(residuals: impl Iterator<Item = f64>) -> f64 {
    let mut samples: Vec<_> = residuals.map(|r| (r.abs(), 1.0)).collect();
    SIGMA_OVER_MAD * weighted_median(&mut samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivative_matches_central_differences() {
        for loss in [Loss::Squared, Loss::Norm, Loss::Huber(1.5), Loss::GemanMcClure(2.0)] {
            for s in [0.01, 0.5, 2.0, 3.0, 40.0] {
                let h = 1e-6 * s;
                let numeric = (loss.evaluate(s + h).0 - loss.evaluate(s - h).0) / (2.0 * h);
                assert!((numeric - loss.evaluate(s).1).abs() < 1e-6, "{loss:?} at {s}");
                let pull = |s: f64| s * loss.evaluate(s).1;
                let numeric = (pull(s + h) - pull(s - h)) / (2.0 * h);
                assert!((numeric - loss.slope(s)).abs() < 1e-6, "slope of {loss:?} at {s}");
            }
        }
    }

    #[test]
    fn a_bounded_loss_of_what_is_infinitely_far_off() {
        assert_eq!(Loss::GemanMcClure(2.0).evaluate(f64::INFINITY), (4.0, 0.0));
        assert!((Loss::GemanMcClure(2.0).evaluate(1e30).0 - 4.0).abs() < 1e-12);
    }

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
