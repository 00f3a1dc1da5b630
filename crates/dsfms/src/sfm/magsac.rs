//! Score of a sampled model without a chosen noise scale: MAGSAC++ (Barath, Noskova, Ivashechkin
//! and Matas, CVPR 2020).
//!
//! The deviation σ of the noise may be anything up to `σ_max`, all equally likely. At a given σ the
//! residual of an inlier is χ-distributed with `n` degrees of freedom, cut at its 0.99 quantile
//! `kσ`. Marginalised over σ, with `a = (n−1)/2`, `x = r²/(2σ_max²)` and `K = k²/2`, up to a
//! factor:
//!
//! ```text
//! w(r) = Γ(a, x) − Γ(a, K)                     weight of iteratively reweighted least squares
//! ρ(r) = ∫₀ʳ t·w(t) dt ∝ γ(a+1, x) + x·w(r)    loss;  from r = kσ_max on: w = 0, ρ = γ(a+1, K)
//! ```
//!
//! The threshold of the caller is `kσ_max`, the largest residual of an inlier. Small residuals
//! count for more than under a truncated quadratic, so a threshold that is too generous does little
//! harm.

use std::sync::LazyLock;

/// Cells of a table along the squared residual.
const CELLS: usize = 1024;

/// Loss and weight for one threshold.
#[derive(Clone, Copy, Debug)]
pub(super) struct Magsac {
    table: &'static LossTable,
    /// Cells per squared residual.
    cells_per_square: f64,
}

impl Magsac {
    /// For residuals of one degree of freedom: distances from an epipolar plane or line.
    pub(super) fn epipolar(threshold: f64) -> Self {
        static TABLE: LazyLock<LossTable> =
            LazyLock::new(|| LossTable::new(0.0, 6.634_896_601_021_214));
        Self::new(&TABLE, threshold)
    }

    /// For residuals of two degrees of freedom: distances of pixels from projections.
    pub(super) fn reprojection(threshold: f64) -> Self {
        static TABLE: LazyLock<LossTable> =
            LazyLock::new(|| LossTable::new(0.5, 9.210_340_371_976_184));
        Self::new(&TABLE, threshold)
    }

    /// The truncated quadratic, for comparison.
    #[cfg(test)]
    pub(super) fn truncated(threshold: f64) -> Self {
        static TABLE: LazyLock<LossTable> =
            LazyLock::new(|| LossTable::of_weights(vec![1.0; CELLS + 1]));
        Self::new(&TABLE, threshold)
    }

    fn new(table: &'static LossTable, threshold: f64) -> Self {
        Self { table, cells_per_square: CELLS as f64 / (threshold * threshold) }
    }

    /// `ρ(s)` in `[0, 1]` and `ρ′(s)` of a squared residual `s`; 1 and 0 beyond the threshold and
    /// where `s` is not a number.
    #[inline]
    pub(super) fn evaluate(&self, s: f64) -> (f64, f64) {
        let at = s * self.cells_per_square;
        let cell = at as usize;
        if cell >= CELLS || at.is_nan() {
            return (1.0, 0.0);
        }
        let rest = at - cell as f64;
        let ([loss, weight], [_, next]) = (self.table.0[cell], self.table.0[cell + 1]);
        let slope = next - weight;
        (
            loss + rest * (weight + 0.5 * slope * rest),
            (weight + slope * rest) * self.cells_per_square,
        )
    }
}

/// Loss and weight (per cell) at the rims of the cells; in between the weight is linear and the
/// loss its integral, so that one is exactly the derivative of the other.
#[derive(Debug)]
struct LossTable(Vec<[f64; 2]>);

impl LossTable {
    /// For `a` = (n−1)/2 and `k²`, the 0.99 quantile of χ²ₙ.
    fn new(a: f64, k_squared: f64) -> Self {
        let end = 0.5 * k_squared;
        let step = end / CELLS as f64;
        let mut weights: Vec<f64> =
            (0..=CELLS).map(|i| weight(a, step * i.max(1) as f64, end)).collect();
        // Without an end at zero (n = 1): what gives the first cell its integral.
        weights[0] = 2.0 * loss(a, step, end) / step - weights[1];
        Self::of_weights(weights)
    }

    /// Scaled such that the loss ends at 1.
    fn of_weights(weights: Vec<f64>) -> Self {
        let mean = |w: &[f64]| 0.5 * (w[0] + w[1]);
        let total: f64 = weights.windows(2).map(mean).sum();
        let mut sum = 0.0;
        let before = std::iter::once(0.0).chain(weights.windows(2).map(|w| {
            sum += mean(w) / total;
            sum
        }));
        Self(before.zip(&weights).map(|(loss, w)| [loss, w / total]).collect())
    }
}

/// `Γ(a, x) − Γ(a, K)`, 0 < x ≤ K.
fn weight(a: f64, x: f64, end: f64) -> f64 {
    minus_upper_gamma(a, end) - minus_upper_gamma(a, x)
}

/// `γ(a+1, x) + x·w`.
fn loss(a: f64, x: f64, end: f64) -> f64 {
    lower_gamma(a + 1.0, x) + x * weight(a, x, end)
}

/// `γ(a, x) = xᵃ e⁻ˣ Σ xᵏ/(a(a+1)…(a+k))`, a > 0; for the small `x` of a table.
fn lower_gamma(a: f64, x: f64) -> f64 {
    let (mut term, mut sum, mut k) = (1.0 / a, 1.0 / a, a);
    while term > 1e-17 * sum {
        k += 1.0;
        term *= x / k;
        sum += term;
    }
    sum * x.powf(a) * (-x).exp()
}

/// `−Γ(a, x)` up to a constant: `γ(a, x)`, and `ln x + Σ (−x)ᵏ/(k·k!)` for `a` = 0.
fn minus_upper_gamma(a: f64, x: f64) -> f64 {
    if a > 0.0 {
        return lower_gamma(a, x);
    }
    let (mut power, mut sum) = (1.0, x.ln());
    for k in 1..64 {
        power *= -x / k as f64;
        sum += power / k as f64;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both at threshold 3, with their degrees of freedom and `k²`.
    fn both() -> [(Magsac, i32, f64); 2] {
        [(Magsac::epipolar(3.0), 1, 6.634_896_6), (Magsac::reprojection(3.0), 2, 9.210_340_4)]
    }

    /// `w(r)` before its factor: the density of a residual of noise σ, `∝ σ⁻ⁿ rⁿ⁻¹ exp(−r²/2σ²)`,
    /// over `r ∝ rⁿ⁻¹`, averaged over the σ for which `r` is within its quantile (midpoint rule).
    fn marginal(r: f64, n: i32, k_squared: f64) -> f64 {
        let (low, high) = (r / k_squared.sqrt(), 3.0 / k_squared.sqrt());
        let steps = 4000;
        let width = (high - low) / steps as f64;
        let density = |s: f64| r.powi(n - 1) * s.powi(-n) * (-r * r / (2.0 * s * s)).exp();
        (0..steps).map(|i| density(low + (i as f64 + 0.5) * width) * width).sum()
    }

    #[test]
    fn loss_is_the_integral_of_the_marginalised_weight() {
        for (magsac, n, k_squared) in both() {
            let steps = 3000;
            let width = 3.0 / steps as f64;
            let part = |i: usize| {
                let r = (i as f64 + 0.5) * width;
                r * marginal(r, n, k_squared) * width
            };
            let total: f64 = (0..steps).map(part).sum();
            for share in [0.05, 0.1, 0.3, 0.5, 0.8] {
                let end = (share * steps as f64) as usize;
                let wanted = (0..end).map(part).sum::<f64>() / total;
                let found = magsac.evaluate((3.0 * share).powi(2)).0;
                assert!((found - wanted).abs() < 5e-4, "n {n}, at {share}: {found}, {wanted}");
            }
        }
    }

    #[test]
    fn loss_rises_and_weight_falls_to_the_threshold() {
        for (magsac, n, _) in both() {
            let at = |i: usize| magsac.evaluate((0.01 * i as f64).powi(2));
            assert_eq!(at(0).0, 0.0);
            assert!((at(299).0 - 1.0).abs() < 1e-4 && at(299).1 < 1e-3);
            assert_eq!([at(300), magsac.evaluate(f64::INFINITY)], [(1.0, 0.0); 2]);
            assert_eq!(magsac.evaluate(f64::NAN), (1.0, 0.0));
            for i in 1..300 {
                let (before, here) = (at(i - 1), at(i));
                assert!(here.0 > before.0 && here.1 < before.1 && here.1 > 0.0, "n {n}, {i}");
            }
        }
    }

    #[test]
    fn weight_is_the_derivative_of_the_loss() {
        for (magsac, n, _) in both() {
            for s in [1e-4, 0.02, 0.5, 2.0, 7.0] {
                let h = 1e-6 * s;
                let numeric = (magsac.evaluate(s + h).0 - magsac.evaluate(s - h).0) / (2.0 * h);
                let weight = magsac.evaluate(s).1;
                assert!((numeric / weight - 1.0).abs() < 1e-4, "n {n} at {s}: {numeric} {weight}");
            }
        }
    }

    #[test]
    fn incomplete_gamma_by_hand() {
        // γ(1, x) = 1 − e⁻ˣ; γ(½, x) = √π erf √x; Γ(0, 1) − Γ(0, 2) = E₁(1) − E₁(2) (tables).
        assert!((lower_gamma(1.0, 2.0) - (1.0 - (-2.0_f64).exp())).abs() < 1e-15);
        let erf_one = 0.842_700_792_949_714_9 * std::f64::consts::PI.sqrt();
        assert!((lower_gamma(0.5, 1.0) - erf_one).abs() < 1e-14);
        let difference = minus_upper_gamma(0.0, 2.0) - minus_upper_gamma(0.0, 1.0);
        assert!((difference - (0.219_383_934_395_520_3 - 0.048_900_510_708_061_1)).abs() < 1e-14);
    }
}
