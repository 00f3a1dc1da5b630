//! What lies in front of the organ, told from it by colour: instruments without a mask, gauze, deep
//! shadow.
//!
//! Of the brightness of tissue under white glare, `a·α + g`, the part `a` in the tissue's own colour
//! is exposure times shading. Metal has none of it, shadow little; where it is far from what the shape
//! predicts, the pixel shows something else, whether or not its brightness agrees.

use crate::geometry::centre_and_spread;
use crate::image::{ColorImage, Mask};

/// The shape predicts the coloured part at least to this fraction of it: shading differs by less
/// unless the surface is turned away.
const FRACTION: f64 = 0.5;

/// Or to so many standard deviations.
const DEVIATIONS: f64 = 4.0;

/// Less certain than this, a pixel tells nothing.
const UNCERTAIN: f64 = 0.9;

/// Noise of a channel, linear light.
const NOISE: f64 = 0.002;

/// Foreign pixels among the nine about one that make it foreign: single ones are noise.
const MAJORITY: usize = 5;

/// Margin about what is foreign, of the image diagonal.
const MARGIN: f64 = 0.004;

/// `true` where the image does not show the surface, of tissue that has some colour.
///
/// `albedo` and `shade` as the surface is expected at a pixel; `known`: `true` where they and the image
/// count.
pub(super) fn foreign(
    image: &ColorImage,
    albedo: &ColorImage,
    shade: &[f64],
    known: &[bool],
) -> Mask {
    let part = |i: usize| -> Option<[f64; 2]> {
        let (image, albedo) = (image.data[i], albedo.data[i]);
        let mean = albedo.iter().map(|&a| f64::from(a)).sum::<f64>() / 3.0;
        let (mut cross, mut square) = (0.0, 0.0);
        for (a, v) in albedo.into_iter().zip(image) {
            let away = f64::from(a) - mean;
            cross += away * f64::from(v);
            square += away * away;
        }
        let told = known[i] && square > 0.0 && shade[i] > 0.0;
        told.then(|| [cross / (square * shade[i]), NOISE / (square.sqrt() * shade[i])])
    };
    let parts: Vec<Option<[f64; 2]>> = (0..known.len()).map(part).collect();
    let mut all: Vec<f64> = parts.iter().flatten().map(|p| p[0]).collect();
    let (gain, spread) = centre_and_spread(&mut all);
    let spread = spread / gain;
    let strange = |part: &Option<[f64; 2]>| {
        part.is_some_and(|[a, noise]| {
            let limit = FRACTION.max(DEVIATIONS * spread.hypot(noise / gain));
            gain > 0.0 && limit < UNCERTAIN && (a / gain - 1.0).abs() > limit
        })
    };
    let strange: Vec<bool> = parts.iter().map(strange).collect();
    let size = image.size;
    let diagonal = (size[0] as f64).hypot(size[1] as f64);
    majority(&Mask { size, data: strange }).dilate(MARGIN * diagonal)
}

/// What most of the nine pixels about one say; `false` at the border of the image.
fn majority(mask: &Mask) -> Mask {
    let [w, h] = mask.size;
    let mut found = Mask::filled(mask.size, false);
    for y in 1..h.saturating_sub(1) {
        for x in 1..w.saturating_sub(1) {
            let rows = mask.data[(y - 1) * w..].chunks(w).take(3);
            let count = rows.flat_map(|row| &row[x - 1..=x + 1]).filter(|&&v| v).count();
            found.data[y * w + x] = count >= MAJORITY;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [60, 40];

    fn plane(value: impl Fn(usize, usize) -> [f32; 3]) -> ColorImage {
        let at = |i: usize| value(i % SIZE[0], i / SIZE[0]);
        ColorImage { size: SIZE, data: (0..SIZE[0] * SIZE[1]).map(at).collect() }
    }

    /// Tissue under an exposure of 0.8, a shading that varies, glare, and a bar.
    fn found(tissue: [f32; 3], bar: impl Fn(f32) -> [f32; 3]) -> Mask {
        let albedo = plane(|x, y| tissue.map(|a| a * (1.0 + 0.1 * ((x * y) % 3) as f32)));
        let shade: Vec<f64> =
            (0..SIZE[0] * SIZE[1]).map(|i| 0.5 + 0.005 * (i % 60) as f64).collect();
        let image = plane(|x, y| {
            let lit = 0.8 * shade[y * 60 + x] as f32;
            let glare = if y < 10 { 0.2 } else { 0.0 };
            let bar = bar(lit);
            let own = albedo.data[y * 60 + x].map(|a| lit * a + glare);
            if (20..30).contains(&x) { bar } else { own }
        });
        foreign(&image, &albedo, &shade, &vec![true; shade.len()])
    }

    #[test]
    fn metal_and_deep_shadow_are_foreign_and_glare_is_not() {
        let tissue = [0.6, 0.25, 0.2];
        // As bright as the tissue, and the tissue's colour at a third of its light.
        for mask in [
            found(tissue, |lit| [0.35 * lit; 3]),
            found(tissue, |lit| tissue.map(|a| 0.3 * lit * a)),
        ] {
            assert!((21..29).all(|x| mask.at(x, 20)), "the bar");
            let clear = |x: &usize| !(19..31).contains(x);
            assert!((0..60).filter(clear).all(|x| !mask.at(x, 20) && !mask.at(x, 5)));
        }
    }
}
