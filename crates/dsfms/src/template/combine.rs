//! Albedo of one texel: from one view (eq. 1), and over views (eq. 2 or its robust substitute).

use crate::geometry::robust::{tukey_mean, tukey_weight};
use serde::{Deserialize, Serialize};

/// How the albedos of single views become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Combine {
    /// Tukey mean of the logarithms, weighted by cosines and inverse squared distance.
    #[default]
    Robust,
    /// The paper's eq. 2: the smallest value, per channel.
    Minimum,
}

/// Eq. 1 with a gain: `I / (gain · shade)` per channel; `None` where the light does not reach
/// (the paper sets a predefined maximum there, which eq. 2 then never picks).
#[doc(alias = "eq. 1")]
pub fn from_view(intensity: [f64; 3], shade: f64, gain: f64) -> Option<[f64; 3]> {
    let light = gain * shade;
    (light > 0.0).then(|| intensity.map(|i| i / light))
}

/// Albedo of one texel in one view, with its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewAlbedo {
    /// Linear RGB.
    pub value: [f64; 3],
    /// Relative weight, `> 0`.
    pub weight: f64,
}

/// Albedo of one texel over all views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CombinedAlbedo {
    /// Linear RGB.
    pub value: [f64; 3],
    /// Standard deviation of the grey value over the views that count (0 for one view).
    pub spread: f64,
    /// Views that count.
    pub views: usize,
}

/// Eq. 2 or its robust substitute; `noise` is the relative standard deviation expected of one
/// value (used by [`Combine::Robust`] only). `None` without a value.
#[doc(alias = "eq. 2")]
pub fn combine(albedos: &[ViewAlbedo], rule: Combine, noise: f64) -> Option<CombinedAlbedo> {
    match rule {
        Combine::Minimum => minimum(albedos),
        Combine::Robust => robust_mean(albedos, noise.max(0.02)),
    }
}

fn grey(value: [f64; 3]) -> f64 {
    (value[0] + value[1] + value[2]) / 3.0
}

fn minimum(albedos: &[ViewAlbedo]) -> Option<CombinedAlbedo> {
    let first = albedos.first()?.value;
    let lowest = |c: usize| albedos.iter().fold(first[c], |m, a| m.min(a.value[c]));
    let value = [lowest(0), lowest(1), lowest(2)];
    Some(summary(value, albedos, |_| 1.0))
}

fn robust_mean(albedos: &[ViewAlbedo], scale: f64) -> Option<CombinedAlbedo> {
    let log = |a: &ViewAlbedo| grey(a.value).max(1e-9).ln();
    let mut samples: Vec<_> = albedos.iter().map(|a| (log(a), a.weight)).collect();
    let centre = tukey_mean(&mut samples, scale);
    let weight = |a: &ViewAlbedo| a.weight * tukey_weight(log(a) - centre, scale);
    let total: f64 = albedos.iter().map(weight).sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let mut value = [0.0; 3];
    for a in albedos {
        (0..3).for_each(|c| value[c] += weight(a) * a.value[c] / total);
    }
    Some(summary(value, albedos, |a| weight(a) / a.weight))
}

fn summary(
    value: [f64; 3],
    albedos: &[ViewAlbedo],
    trust: impl Fn(&ViewAlbedo) -> f64,
) -> CombinedAlbedo {
    let (mut total, mut square) = (0.0, 0.0);
    for a in albedos {
        total += trust(a);
        square += trust(a) * (grey(a.value) - grey(value)).powi(2);
    }
    let views = albedos.iter().filter(|a| trust(a) > 0.1).count().max(1);
    CombinedAlbedo { value, spread: (square / total).sqrt(), views }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(value: f64) -> ViewAlbedo {
        ViewAlbedo { value: [value; 3], weight: 1.0 }
    }

    #[test]
    fn equations_1_and_2_by_hand() {
        assert_eq!(from_view([0.2, 0.1, 0.4], 0.5, 2.0), Some([0.2, 0.1, 0.4]));
        assert_eq!(from_view([0.2; 3], 0.0, 1.0), None);
        let views = [one(0.5), one(0.52), one(0.48), one(0.9)];
        assert_eq!(combine(&views, Combine::Minimum, 0.02).unwrap().value, [0.48; 3]);
        let robust = combine(&views, Combine::Robust, 0.03).unwrap();
        assert!((robust.value[0] - 0.5).abs() < 0.005, "the highlight is rejected");
        assert_eq!((robust.views, combine(&[], Combine::Robust, 0.1)), (3, None));
    }

    #[test]
    fn the_minimum_never_rises_with_a_view() {
        let views = [one(0.5), one(0.6), one(0.3), one(0.4)];
        let lowest = |n| combine(&views[..n], Combine::Minimum, 0.1).unwrap().value[0];
        assert!((2..=4).all(|n| lowest(n) <= lowest(n - 1)));
    }
}
