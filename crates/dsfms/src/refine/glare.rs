//! Brightness without glare: which weighted sum of the channels shows shading, and with what noise.
//!
//! Light mirrored by wet tissue is white while tissue is not (dichromatic reflection), so the
//! channels tell how much glare there is without knowing the shape. Where there is some, the sum
//! that cancels white is as good as ever; on pale tissue nothing can be told and what may be glare
//! is left out.

use crate::energy::Brightness;
use crate::geometry::{SIGMA_OVER_MAD, centre_and_spread, median};
use crate::image::ColorImage;

/// What the channels say of one surface point, linear light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Channels {
    pub(super) image: [f64; 3],
    pub(super) albedo: [f64; 3],
    /// Diffuse shading expected there.
    pub(super) shade: f64,
    /// What the blur adds to it, since shading varies within the blur.
    pub(super) added_shade: f64,
    /// Near a highlight, or turned so that it mirrors the light.
    pub(super) maybe_glare: bool,
}

impl Channels {
    /// Log ratio of image and prediction, of all channels together; not finite where either is
    /// dark.
    pub(super) fn log_ratio(&self) -> f64 {
        let (image, albedo): (f64, f64) = (self.image.iter().sum(), self.albedo.iter().sum());
        (image / (albedo * (self.shade + self.added_shade))).ln()
    }
}

/// Bounds and sources of the noise of the image model.
#[derive(Clone, Copy, Debug)]
pub(super) struct NoiseOptions {
    /// Bounds of the part proportional to brightness, which is measured.
    pub(super) relative: [f64; 2],
    /// Absolute part, linear light.
    pub(super) absolute: f64,
    /// Weigh the channels; else every one has a third.
    pub(super) colour: bool,
}

/// The points whose brightness can be used, by their place in `points`.
pub(super) struct Weighed {
    pub(super) brightness: Vec<(usize, Brightness)>,
    /// Robust ratio of image to prediction, the start of the gain.
    pub(super) log_gain: f64,
}

/// Of all constants here: `docs/results/choices.md`, glare. Tissue paler than this does not tell
/// glare from itself.
const PALE: f64 = 0.1;

/// Where glare of this part of the brightness could hide, colours do not tell.
const TOLD_APART: f64 = 0.15;

/// Noise of the white part counts this often where the question is whether glare could hide in it.
const CHANCE: f64 = 2.5;

/// Glare possible near a highlight or the mirror direction whatever the colours say, as a part of
/// the brightness.
const UNSEEN: f64 = 0.1;

/// Less glare than this, as a part of the brightness, leaves a point fit to measure noise on.
const CLEAN: f64 = 0.06;

/// Least relative noise of a single channel.
const CHANNEL_NOISE: f64 = 0.003;

/// Weigh the channels of every point.
pub(super) fn weigh(points: &[Channels], options: &NoiseOptions) -> Weighed {
    let mixes = if options.colour { coloured(points, options.absolute) } else { grey(points) };
    let predicted = |i: usize, mix: &Mix| mix.albedo * (points[i].shade + points[i].added_shade);
    let usable = mixes.iter().filter(|(i, m)| predicted(*i, m) > 1e-4 && m.image > 0.0);
    let mut ratios: Vec<f64> = usable.map(|(i, m)| (m.image / predicted(*i, m)).ln()).collect();
    let (log_gain, spread) = centre_and_spread(&mut ratios);
    let relative = spread.clamp(options.relative[0], options.relative[1]);
    let brightness = |(i, mix): (usize, Mix)| {
        let Mix { weights, image, albedo, white, noise } = mix;
        let sigma = (relative * image).hypot(options.absolute).hypot(noise);
        (i, Brightness { weights, albedo, added_shade: points[i].added_shade, white, sigma })
    };
    Weighed { brightness: mixes.into_iter().map(brightness).collect(), log_gain }
}

fn grey(points: &[Channels]) -> Vec<(usize, Mix)> {
    let plain = points.iter().enumerate().filter(|(_, p)| !p.maybe_glare);
    plain.map(|(i, p)| (i, Mix::grey(p))).collect()
}

fn coloured(points: &[Channels], absolute: f64) -> Vec<(usize, Mix)> {
    let glare = Glare::of(points);
    let noise = glare.channel_noise(points);
    let mix = |(i, p)| Some((i, Mix::against(p, glare.at(p)?, &noise, absolute)?));
    points.iter().enumerate().filter_map(mix).collect()
}

/// White light on top of the tissue's colour, over the whole frame.
struct Glare {
    /// Its usual part of the brightness: ambient light and what the albedo is off.
    usual: f64,
    /// Relative noise of the white part of a pure colour.
    chance: f64,
}

impl Glare {
    fn of(points: &[Channels]) -> Self {
        let parts = || points.iter().filter_map(white_part);
        let mut all: Vec<f64> = parts().map(|(part, _)| part).collect();
        let usual = median_of(&mut all);
        let mut away: Vec<f64> = parts().map(|(p, purity)| (p - usual).abs() * purity).collect();
        Self { usual, chance: (SIGMA_OVER_MAD * median_of(&mut away)).max(CHANNEL_NOISE) }
    }

    /// Relative noise of every channel by itself (light that came by way of other tissue is full of
    /// red, and blue is where pixels are dark): from the spread of the log ratios of two channels,
    /// image over albedo, so that shading cancels, `σ₀² = (V₀₁ + V₀₂ − V₁₂)/2`, and no channel
    /// better than half their mean.
    fn channel_noise(&self, points: &[Channels]) -> [f64; 3] {
        let clean = |p: &&Channels| !p.maybe_glare && self.seen(p).is_some_and(|g| g < CLEAN);
        let clean: Vec<&Channels> = points.iter().filter(clean).collect();
        let variance = |a: usize, b: usize| {
            let ratio = |p: &&Channels| {
                let ratio = p.image[a] * p.albedo[b] / (p.image[b] * p.albedo[a]);
                (ratio > 0.0 && ratio.is_finite()).then(|| ratio.ln())
            };
            let mut ratios: Vec<f64> = clean.iter().filter_map(ratio).collect();
            centre_and_spread(&mut ratios).1.powi(2)
        };
        let [rg, rb, gb] = [variance(0, 1), variance(0, 2), variance(1, 2)];
        let least = (0.25 * (rg + rb + gb) / 6.0).max(CHANNEL_NOISE * CHANNEL_NOISE);
        [rg + rb - gb, rg + gb - rb, rb + gb - rg].map(|twice| (0.5 * twice).max(least).sqrt())
    }

    /// Glare at a point as a part of its brightness; `None` where the colours cannot tell.
    fn seen(&self, p: &Channels) -> Option<f64> {
        let (part, purity) = white_part(p)?;
        (CHANCE * self.chance < TOLD_APART * purity).then(|| (part - self.usual).max(0.0))
    }

    /// Standard deviation of the glare at a point, linear light; `None` where there may be some and
    /// the colours cannot tell.
    fn at(&self, p: &Channels) -> Option<f64> {
        let possible = if p.maybe_glare { UNSEEN } else { 0.0 };
        match self.seen(p) {
            Some(part) => Some((part + possible) * mean(&p.image)),
            None => (!p.maybe_glare).then_some(0.0),
        }
    }
}

/// The white part of the brightness that a point's colour cannot explain, and the purity of that
/// colour. `None` for white and for black.
fn white_part(p: &Channels) -> Option<(f64, f64)> {
    let (mean, image) = (mean(&p.albedo), mean(&p.image));
    let (mut cross, mut square) = (0.0, 0.0);
    for c in 0..3 {
        let away = p.albedo[c] - mean;
        cross += away * p.image[c];
        square += away * away;
    }
    let purity = purity(&p.albedo);
    (purity > 0.02 && image > 1e-3).then(|| (1.0 - cross / square * mean / image, purity))
}

/// Whether tissue is too pale, where it is `known`, for its colour to tell anything.
pub(super) fn pale(albedo: &ColorImage, known: &[bool]) -> bool {
    let mut sum = [0.0; 3];
    for (albedo, _) in albedo.data.iter().zip(known).filter(|(_, known)| **known) {
        (0..3).for_each(|c| sum[c] += f64::from(albedo[c]));
    }
    purity(&sum) <= PALE
}

/// Sine of the angle of a colour to white.
fn purity(colour: &[f64; 3]) -> f64 {
    let (mean, norm) = (mean(colour), colour.iter().map(|c| c * c).sum::<f64>());
    let away: f64 = colour.iter().map(|c| (c - mean).powi(2)).sum();
    (away / norm.max(f64::MIN_POSITIVE)).sqrt()
}

fn mean(c: &[f64; 3]) -> f64 {
    (c[0] + c[1] + c[2]) / 3.0
}

/// A weighted sum of the channels of one point.
struct Mix {
    weights: [f64; 3],
    image: f64,
    albedo: f64,
    white: f64,
    /// Noise of the sum from the channels and the glare, linear light.
    noise: f64,
}

impl Mix {
    fn grey(p: &Channels) -> Self {
        let third = 1.0 / 3.0;
        let (image, albedo) = (mean(&p.image), mean(&p.albedo));
        Self { weights: [third; 3], image, albedo, white: 1.0, noise: 0.0 }
    }

    /// The best sum for noise of its own in every channel and glare `tau` common to all:
    /// `w ∝ Σ⁻¹ α` with `Σ = diag(σ²) + τ² 1 1ᵀ`, scaled to the grey albedo.
    fn against(p: &Channels, tau: f64, relative: &[f64; 3], absolute: f64) -> Option<Self> {
        let inverse = [0, 1, 2].map(|c| {
            let sigma = (relative[c] * p.image[c]).hypot(absolute);
            1.0 / (sigma * sigma)
        });
        let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (ones, grey) = ([1.0; 3], mean(&p.albedo));
        let common =
            tau * tau * dot(&inverse, &p.albedo) / (1.0 + tau * tau * dot(&inverse, &ones));
        let raw = [0, 1, 2].map(|c| inverse[c] * (p.albedo[c] - common));
        // wᵀ Σ w of the raw weights is their signal, so scaling makes it grey² / signal.
        let signal = dot(&raw, &p.albedo);
        if !(signal > 0.0 && grey > 1e-4) {
            return None;
        }
        let weights = raw.map(|w| w * grey / signal);
        Some(Self {
            image: dot(&weights, &p.image),
            albedo: grey,
            white: dot(&weights, &ones),
            noise: grey / signal.sqrt(),
            weights,
        })
    }
}

/// 0 of nothing.
fn median_of(values: &mut [f64]) -> f64 {
    median(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(glare: impl Fn(usize) -> f64, albedo: impl Fn(usize) -> [f64; 3]) -> Vec<Channels> {
        let shade = 0.8;
        let point = |k: usize| {
            let albedo = albedo(k);
            // A little noise of its own in every channel.
            let noise = |c: usize| 1.0 + 0.004 * ((7 * k + 3 * c) % 5) as f64 - 0.008;
            let image = [0, 1, 2].map(|c| 1.3 * shade * albedo[c] * noise(c) + 0.01 + glare(k));
            Channels { image, albedo, shade, added_shade: 0.0, maybe_glare: k < 10 }
        };
        (0..60).map(point).collect()
    }

    const OPTIONS: NoiseOptions =
        NoiseOptions { relative: [0.015, 0.1], absolute: 0.002, colour: true };

    #[test]
    fn glare_on_tissue_is_cancelled() {
        let tissue = |k: usize| [0.5 + 0.01 * (k % 7) as f64, 0.2, 0.15];
        let points = points(|k| if k < 10 { 0.3 } else { 0.0 }, tissue);
        let found = weigh(&points, &OPTIONS);
        assert_eq!(found.brightness.len(), 60);
        for (i, b) in &found.brightness {
            let sum: f64 = (0..3).map(|c| b.weights[c] * points[*i].image[c]).sum();
            let expected = 1.3 * b.albedo * 0.8 + 0.01 * b.white;
            assert!((sum - expected).abs() < 2.0 * b.sigma, "{i}: {sum} {expected} {b:?}");
            let blind = b.white.abs() * 0.3 < 2.0 * b.sigma;
            assert!(*i >= 10 || (blind && b.sigma < 0.1 * expected), "{i}: {b:?}");
        }
        assert!((found.log_gain - 1.3_f64.ln()).abs() < 0.08, "{}", found.log_gain.exp());
    }

    #[test]
    fn what_may_be_glare_is_left_out_on_white_tissue() {
        let points = points(|k| if k < 5 { 0.3 } else { 0.0 }, |_| [0.5, 0.5, 0.5]);
        let found = weigh(&points, &OPTIONS);
        assert_eq!(found.brightness.len(), 50);
        assert!(found.brightness.iter().all(|(i, b)| *i >= 10 && b.weights[0] > 0.3));
    }

    #[test]
    fn colours_that_are_white_or_black_tell_no_glare() {
        let tells = |image: f64, albedo: [f64; 3]| {
            let point = Channels {
                image: [image; 3],
                albedo,
                shade: 0.8,
                added_shade: 0.0,
                maybe_glare: false,
            };
            white_part(&point).is_some()
        };
        assert!(tells(0.4, [0.5, 0.2, 0.1]));
        assert!(!tells(0.4, [0.5; 3]) && !tells(0.0, [0.5, 0.2, 0.1]));
    }
}
