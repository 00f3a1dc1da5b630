//! Robust losses ρ(s) of a squared residual norm s = ‖r‖².

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
}
