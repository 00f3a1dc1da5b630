//! What the views say of one spot, linearised, its own albedo eliminated.

use crate::geometry::Vector3;
use crate::geometry::robust::{robust_scale, tukey_mean, tukey_weight, weighted_median};
use nalgebra::{Matrix4, Vector4};

/// Spots that share one albedo, of the 6000 that are spread over the surface.
const PATCH: f64 = 20.0;
/// Least noise of a brightness, and least spread of albedos.
const NOISE_FLOOR: f64 = 0.005;
const SPREAD_FLOOR: f64 = 0.02;

/// Brightness at a spot less the model's, and the slope with the spot's summed vertex normals.
pub(super) struct ReliefRow {
    pub residual: f64,
    pub slope: Vector3,
    pub trust: f64,
}

/// A linearised spot: over (change of the normal, mean albedo) `½ xᵀKx − gᵀx`, its own albedo
/// eliminated.
pub(super) struct SpotBlock {
    pub matrix: Matrix4<f64>,
    pub right: Vector4<f64>,
}

/// Noise and albedos as the last round found them.
pub(super) struct Scales {
    pub noise: f64,
    pub mean: f64,
    pub spread: f64,
}

/// Robust albedo of a spot from its rows alone, and their weights.
fn own_albedo(rows: &[ReliefRow], noise: f64) -> (f64, Vec<f64>) {
    let mut samples: Vec<_> = rows.iter().map(|r| (r.residual, r.trust)).collect();
    let centre = tukey_mean(&mut samples, noise);
    let weight =
        |r: &ReliefRow| r.trust * tukey_weight(r.residual - centre, noise) / (noise * noise);
    (centre, rows.iter().map(weight).collect())
}

/// `None` where no spot has two views: nothing to compare.
pub(super) fn scales(rows: &[Vec<ReliefRow>], noise: f64) -> Option<Scales> {
    let noise = noise.max(NOISE_FLOOR);
    let repeated: Vec<(f64, &Vec<ReliefRow>)> = rows
        .iter()
        .filter(|rows| rows.len() > 1)
        .map(|rows| (own_albedo(rows, noise).0, rows))
        .collect();
    let mut albedos: Vec<(f64, f64)> = repeated.iter().map(|(a, _)| (*a, 1.0)).collect();
    let mean = weighted_median(&mut albedos);
    let spread = robust_scale(albedos.iter().map(|a| a.0 - mean)).max(SPREAD_FLOOR);
    let residuals = repeated.iter().flat_map(|(albedo, rows)| {
        let unbias = (rows.len() as f64 / (rows.len() as f64 - 1.0)).sqrt();
        rows.iter().map(move |r| (r.residual - albedo) * unbias)
    });
    let noise = robust_scale(residuals).max(NOISE_FLOOR);
    (mean.is_finite() && noise.is_finite()).then_some(Scales { noise, mean, spread })
}

/// The mean albedo is one more observation of the spot's; together they lose their weighted mean.
/// `change`: of the normal so far, about which the rows are linear.
pub(super) fn block(rows: &[ReliefRow], change: &Vector3, scales: &Scales) -> SpotBlock {
    let (albedo, mut weights) = own_albedo(rows, scales.noise);
    let mut lines: Vec<(Vector4<f64>, f64)> =
        rows.iter().map(|r| (r.slope.push(0.0), r.residual + r.slope.dot(change))).collect();
    if albedo.is_finite() {
        lines.push((Vector4::new(0.0, 0.0, 0.0, -1.0), 0.0));
        let likely = tukey_weight(albedo - scales.mean, scales.spread);
        weights.push(likely / (PATCH * scales.spread * scales.spread));
    }
    let total: f64 = weights.iter().sum();
    let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
    if total > 0.0 {
        let all = || lines.iter().zip(&weights);
        let slope = all().map(|(l, w)| l.0 * *w).sum::<Vector4<f64>>() / total;
        let value = all().map(|(l, w)| l.1 * w).sum::<f64>() / total;
        for ((s, y), w) in all() {
            let s = s - slope;
            matrix += s * s.transpose() * *w;
            right += s * ((y - value) * w);
        }
    }
    SpotBlock { matrix, right }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_by_hand() {
        let row = |residual, trust| ReliefRow { residual, slope: Vector3::x(), trust };
        // Equal residuals 0.1 about a mean albedo of 0: noise 0.1, spread 0.1.
        let rows = [row(0.1, 1.0), row(0.1, 1.0)];
        let scales = Scales { noise: 0.1, mean: 0.1, spread: 0.1 };
        let block = block(&rows, &Vector3::zeros(), &scales);
        // Weights 100, 100 and 100/P: of z = (y − x, y − x, μ) about its mean.
        let (own, prior) = (200.0, 100.0 / PATCH);
        let harmonic = own * prior / (own + prior);
        assert!((block.matrix.m11 - harmonic).abs() < 1e-9 * harmonic);
        assert!((block.matrix.m44 - harmonic).abs() < 1e-9 * harmonic);
        assert!((block.matrix.m14 - harmonic).abs() < 1e-9 * harmonic);
        assert!((block.right.x - 0.1 * harmonic).abs() < 1e-9);
    }
}
