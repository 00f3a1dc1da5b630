//! What lies in front of the organ, told from it by colour: instruments without a mask, gauze, deep
//! shadow.
//!
//! Of the brightness of tissue under white glare, `a·α + g`, the part `a` in the tissue's own
//! colour is exposure times shading. Metal has little of it beside much white. Tissue has as much
//! as its shading says, which a shape yet to be found foretells poorly: only what is next to
//! nothing is shadow.

use crate::geometry::centre_and_spread;
use crate::image::{ColorImage, Mask, diagonal};
use rayon::prelude::*;

/// Of all constants here: `docs/results/choices.md`, instruments. Less than this fraction of the
/// coloured part that the shape predicts, beside more white than colour, is something else.
const LITTLE: f64 = 0.5;

/// Less than this fraction of it is nothing of the surface, whatever is beside it.
const NOTHING: f64 = 0.2;

/// Less by so many standard deviations.
const DEVIATIONS: f64 = 4.0;

/// Noise of a channel, linear light.
const NOISE: f64 = 0.002;

/// Foreign pixels among the nine about one that make it foreign: single ones are noise.
const MAJORITY: u8 = 5;

/// Pixels, about, whose median tells that of all.
const ENOUGH: usize = 20_000;

/// Margin about what is foreign, of the image diagonal.
const MARGIN: f64 = 0.004;

/// `true` where the image does not show the surface, of tissue that has some colour.
///
/// `albedo` and `shade` as the surface is expected at a pixel; `known`: `true` where they and the
/// image count.
pub(super) fn occluders(
    image: &ColorImage,
    albedo: &ColorImage,
    shade: &[f64],
    known: &[bool],
) -> Mask {
    let part = |i: usize| {
        known[i].then(|| ColouredPart::of(image.data[i], albedo.data[i], shade[i])).flatten()
    };
    let parts: Vec<Option<ColouredPart>> = (0..known.len()).into_par_iter().map(part).collect();
    let some = parts.iter().step_by(parts.len().div_ceil(ENOUGH).max(1));
    let mut all: Vec<f64> = some.flatten().map(|p| p.coloured).collect();
    let (gain, spread) = centre_and_spread(&mut all);
    let strange = |part: &Option<ColouredPart>| {
        part.as_ref().is_some_and(|&ColouredPart { coloured, white, noise }| {
            let limit = if white > 0.5 { LITTLE } else { NOTHING };
            let least = || gain - DEVIATIONS * (spread * spread + noise * noise).sqrt();
            coloured < limit * gain && coloured < least()
        })
    };
    let strange: Vec<bool> = parts.iter().map(strange).collect();
    let size = image.size;
    majority(&Mask { size, data: strange }).dilate(MARGIN * diagonal(size))
}

/// The coloured part of a pixel.
struct ColouredPart {
    /// Exposure times what the shading is of that expected.
    coloured: f64,
    /// The rest, as a part of the brightness.
    white: f64,
    /// Standard deviation of the coloured part.
    noise: f64,
}

impl ColouredPart {
    /// `None` where nothing coloured is expected.
    fn of(image: [f32; 3], albedo: [f32; 3], shade: f64) -> Option<Self> {
        let mean = |c: [f32; 3]| c.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
        let (own, seen) = (mean(albedo), mean(image));
        let (mut cross, mut square) = (0.0, 0.0);
        for (a, v) in albedo.into_iter().zip(image) {
            let away = f64::from(a) - own;
            cross += away * f64::from(v);
            square += away * away;
        }
        (square > 0.0 && shade > 0.0).then(|| Self {
            coloured: cross / (square * shade),
            white: 1.0 - cross / square * own / seen.max(NOISE),
            noise: NOISE / (square.sqrt() * shade),
        })
    }
}

/// What most of the nine pixels about one say; `false` at the border of the image.
fn majority(mask: &Mask) -> Mask {
    let [w, h] = mask.size;
    let inside = |i: &usize| {
        (1..w.saturating_sub(1)).contains(&(i % w)) && (1..h.saturating_sub(1)).contains(&(i / w))
    };
    let mut votes = vec![0u8; w * h];
    for i in (0..w * h).filter(|&i| mask.data[i]) {
        let (x, y) = (i % w, i / w);
        for row in y.saturating_sub(1)..(y + 2).min(h) {
            let around = &mut votes[row * w..][x.saturating_sub(1)..(x + 2).min(w)];
            around.iter_mut().for_each(|v| *v += 1);
        }
    }
    let most = (0..w * h).map(|i| votes[i] >= MAJORITY && inside(&i));
    Mask { size: mask.size, data: most.collect() }
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
        occluders(&image, &albedo, &shade, &vec![true; shade.len()])
    }

    #[test]
    fn metal_and_deep_shadow_are_foreign_and_glare_and_slopes_are_not() {
        let tissue = [0.6, 0.25, 0.2];
        // As bright as the tissue, and the tissue's colour at a tenth of its light.
        for mask in [
            found(tissue, |lit| [0.35 * lit; 3]),
            found(tissue, |lit| tissue.map(|a| 0.1 * lit * a)),
        ] {
            assert!((21..29).all(|x| mask.at(x, 20)), "the bar");
            let clear = |x: &usize| !(19..31).contains(x);
            assert!((0..60).filter(clear).all(|x| !mask.at(x, 20) && !mask.at(x, 5)));
        }
        // Turned away from the light as no shape foretold.
        let slope = found(tissue, |lit| tissue.map(|a| 0.3 * lit * a));
        assert!(!slope.data.contains(&true));
    }
}
