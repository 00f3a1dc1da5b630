//! The bright disc in which a laparoscope shows its image on a near-black surround.

use super::filter::blur;
use super::frame::Frame;
use super::{Mask, Plane};
use crate::geometry::Loss;
use rayon::prelude::*;

/// Encoded value up to which a corner can be surround.
const DARK: f32 = 30.0;
/// Encoded value above the corners' at which the image begins; dim tissue at the rim is not far
/// above it.
const STEP: f32 = 6.0;
/// At most this many frames are looked at, evenly spread.
const FRAMES: usize = 24;
/// The mask ends this many px inside the fitted circle: the rim is blurred and vignetted, and the
/// circle lies up to 2 px outside it because any light counts.
const MARGIN_PX: f64 = 6.0;

/// A circle in px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre, px.
    pub centre: [f64; 2],
    /// Radius, px.
    pub radius: f64,
}

/// An instrument is wider than its mask by this, px: shadow, blur and lag.
pub(crate) const INSTRUMENT_MARGIN: f64 = 3.0;

/// Pixels where an organ may be seen: in the viewport (`None`: everywhere) and the organ mask, not
/// within 3 px of an instrument. All of `size`.
pub fn usable(
    size: [usize; 2],
    viewport: Option<Mask>,
    instrument: Option<&Mask>,
    organ: Option<&Mask>,
) -> Mask {
    let mut usable = viewport.unwrap_or_else(|| Mask::filled(size, true));
    if let Some(instrument) = instrument {
        usable = usable.minus(&instrument.dilate(INSTRUMENT_MARGIN));
    }
    if let Some(organ) = organ {
        usable = usable.and(organ);
    }
    usable
}

/// What all frames (of one size) show of the endoscope's viewport, a few px in from its rim
/// (`true` = image content); `None` where they have no dark circular surround.
///
/// The viewport drifts on the sensor when the camera head turns on the optics, so that the mask
/// is what the circles of the single frames have in common; frames whose own circle is not found
/// or far off (dark tissue at the rim) are left to the circle of all frames together.
pub fn viewport(frames: &[Frame]) -> Option<Mask> {
    let all = find(frames)?;
    let near = |c: &Circle| {
        let [dx, dy] = [0, 1].map(|k| c.centre[k] - all.circle.centre[k]);
        let ratio = c.radius / all.circle.radius;
        dx.hypot(dy) < 0.1 * all.circle.radius && (0.9..1.05).contains(&ratio)
    };
    let singles: Vec<Circle> = spread(frames)
        .collect::<Vec<_>>()
        .par_iter()
        .filter_map(|frame| fit_viewport(std::slice::from_ref(*frame)).filter(near))
        .collect();
    let circles = if singles.is_empty() { vec![all.circle] } else { singles };
    let size = frames.first()?.size;
    let inside = |i: usize| {
        let (x, y) = (i % size[0], i / size[0]);
        circles.iter().all(|circle| distance(circle, x, y) <= circle.radius - MARGIN_PX)
            && within(&all.bounds, size, x, y)
    };
    Some(Mask { size, data: (0..size[0] * size[1]).map(inside).collect() })
}

/// Inside the lit box, by the margin on the sides where it does not reach the image's border.
fn within(bounds: &Bounds, size: [usize; 2], x: usize, y: usize) -> bool {
    let margin = MARGIN_PX as usize;
    [x, y].into_iter().zip(bounds).zip(size).all(|((v, (first, last)), n)| {
        (*first <= 1 || v >= first + margin) && (last + 2 >= n || v + margin <= *last)
    })
}

/// At most [`FRAMES`] frames, evenly spread.
fn spread(frames: &[Frame]) -> impl Iterator<Item = &Frame> {
    frames.iter().step_by(frames.len().div_ceil(FRAMES).max(1))
}

/// First and last lit column, first and last lit row.
type Bounds = [(usize, usize); 2];

struct FoundCircle {
    circle: Circle,
    bounds: Bounds,
}

/// The circle of the viewport; it may reach beyond the image on some sides.
///
/// The brightest value of every pixel over the frames is cut into lit and dark; the outermost lit
/// pixels of every row and column give the rim, to which a circle is fitted robustly. The circle
/// is accepted when most of the rim lies on it, and what lies outside it is dark.
pub(crate) fn fit_viewport(frames: &[Frame]) -> Option<Circle> {
    find(frames).map(|found| found.circle)
}

fn find(frames: &[Frame]) -> Option<FoundCircle> {
    let brightest = brightest(frames)?;
    let size = frames.first()?.size;
    let threshold = surround_level(&brightest, size)?;
    let data = brightest.data.iter().map(|&v| v > threshold).collect();
    let lit = Mask { size, data }.erode(1.0).largest_component().dilate(1.0);
    let (rim, bounds) = rim(&lit);
    let circle = fit_robustly(&rim)?;
    accepted(&circle, &rim, &brightest, size, threshold).then_some(FoundCircle { circle, bounds })
}

/// Largest channel over a selection of the frames, by pixel, with the noise of single pixels
/// blurred away; `None` when sizes differ.
fn brightest(frames: &[Frame]) -> Option<Plane> {
    let first = frames.first()?;
    let mut out = vec![0_u8; first.rgb.len()];
    for frame in spread(frames) {
        if frame.size != first.size {
            return None;
        }
        for (out, p) in out.iter_mut().zip(&frame.rgb) {
            *out = (*out).max(p[0]).max(p[1]).max(p[2]);
        }
    }
    let data = out.into_iter().map(f32::from).collect();
    Some(blur(&Plane { size: first.size, data }, 1.0))
}

/// The value that parts surround from image: a little above the darkest corner's; `None` when no
/// corner is dark.
fn surround_level(brightest: &Plane, [w, h]: [usize; 2]) -> Option<f32> {
    let side = (w.min(h) / 40).max(2);
    if w < 4 * side || h < 4 * side {
        return None;
    }
    let corner = |x0: usize, y0: usize| {
        let mut values: Vec<f32> =
            (0..side * side).map(|i| brightest.at(x0 + i % side, y0 + i / side)).collect();
        values.sort_by(f32::total_cmp);
        values[values.len() * 9 / 10]
    };
    let corners = [(0, 0), (w - side, 0), (0, h - side), (w - side, h - side)];
    let level = corners.into_iter().map(|(x, y)| corner(x, y)).min_by(f32::total_cmp)?;
    (level <= DARK).then_some(level + STEP)
}

/// Outermost lit pixels of every row and column, without those within 2 px of the box around all
/// of them: where the circle is cut off, by the image or by a black bar, they are no rim. The box
/// comes second.
fn rim(lit: &Mask) -> (Vec<[f64; 2]>, Bounds) {
    let [w, h] = lit.size;
    let ends = |n: usize, lit: &dyn Fn(usize) -> bool| {
        Some(((0..n).find(|&i| lit(i))?, (0..n).rev().find(|&i| lit(i))?))
    };
    let rows: Vec<_> = (0..h).map(|y| ends(w, &|x| lit.at(x, y))).collect();
    let columns: Vec<_> = (0..w).map(|x| ends(h, &|y| lit.at(x, y))).collect();
    let mut rim = Vec::new();
    let mut bounds = Bounds::default();
    for (lines, along_x) in [(rows, true), (columns, false)] {
        let found = || lines.iter().flatten();
        let first = found().map(|e| e.0).min().unwrap_or_default();
        let last = found().map(|e| e.1).max().unwrap_or_default();
        bounds[usize::from(!along_x)] = (first, last);
        for (i, ends) in lines.iter().enumerate() {
            let Some((a, b)) = *ends else { continue };
            let point = |along: f64| {
                if along_x { [along, i as f64] } else { [i as f64, along] }
            };
            rim.extend((a > first + 2).then_some(point(a as f64 - 0.5)));
            rim.extend((b + 2 < last).then_some(point(b as f64 + 0.5)));
        }
    }
    (rim, bounds)
}

/// Algebraic (Kåsa) fits, weighted by Geman-McClure of the distance to the circle before, with a
/// scale that shrinks from a quarter of the radius to 2 px.
fn fit_robustly(rim: &[[f64; 2]]) -> Option<Circle> {
    if rim.len() < 20 {
        return None;
    }
    let mut circle = fit_weighted(rim, |_| 1.0)?;
    let mut scale = 0.25 * circle.radius;
    for _ in 0..40 {
        let before = circle;
        circle = fit_weighted(rim, |p| {
            let d = (p[0] - before.centre[0]).hypot(p[1] - before.centre[1]) - before.radius;
            Loss::GemanMcClure(1.0).evaluate((d / scale).powi(2)).1
        })?;
        scale = (0.8 * scale).max(2.0);
    }
    Some(circle)
}

/// Least squares of `x² + y² + a x + b y + c = 0`.
fn fit_weighted(rim: &[[f64; 2]], weight: impl Fn(&[f64; 2]) -> f64) -> Option<Circle> {
    use nalgebra::{Matrix3, Vector3};
    // Centred and scaled for the sake of the normal equations.
    let n = rim.len() as f64;
    let mean = [0, 1].map(|k| rim.iter().map(|p| p[k]).sum::<f64>() / n);
    let unit = 100.0;
    let (mut matrix, mut rhs) = (Matrix3::zeros(), Vector3::zeros());
    for p in rim {
        let (x, y) = ((p[0] - mean[0]) / unit, (p[1] - mean[1]) / unit);
        let row = Vector3::new(x, y, 1.0);
        let w = weight(p);
        matrix += row * row.transpose() * w;
        rhs -= row * (w * (x * x + y * y));
    }
    let solution = matrix.cholesky()?.solve(&rhs);
    let (cx, cy) = (-0.5 * solution[0], -0.5 * solution[1]);
    let square = cx * cx + cy * cy - solution[2];
    let centre = [mean[0] + unit * cx, mean[1] + unit * cy];
    (square > 0.0 && square.is_finite()).then(|| Circle { centre, radius: unit * square.sqrt() })
}

fn distance(circle: &Circle, x: usize, y: usize) -> f64 {
    (x as f64 - circle.centre[0]).hypot(y as f64 - circle.centre[1])
}

/// Most of the rim on the circle, the rim spread over at least a third of the full turn, a
/// sensible size, something outside, and that dark, while the inside is lit.
fn accepted(
    circle: &Circle,
    rim: &[[f64; 2]],
    brightest: &Plane,
    [w, h]: [usize; 2],
    threshold: f32,
) -> bool {
    let tolerance = (0.01 * circle.radius).max(3.0);
    let mut sectors = [false; 36];
    let mut on = 0;
    for p in rim {
        let (dx, dy) = (p[0] - circle.centre[0], p[1] - circle.centre[1]);
        if (dx.hypot(dy) - circle.radius).abs() <= tolerance {
            on += 1;
            let turn = dy.atan2(dx) / std::f64::consts::TAU + 0.5;
            sectors[((36.0 * turn) as usize).min(35)] = true;
        }
    }
    let spread = sectors.iter().filter(|v| **v).count();
    let (mut outside, mut dark_outside, mut inside, mut lit_inside) = (0, 0, 0, 0);
    for (i, &v) in brightest.data.iter().enumerate() {
        let d = distance(circle, i % w, i / w);
        if d > circle.radius + tolerance {
            outside += 1;
            dark_outside += usize::from(v <= threshold);
        } else if d < circle.radius - tolerance {
            inside += 1;
            lit_inside += usize::from(v > threshold);
        }
    }
    on * 10 >= rim.len() * 6
        && spread >= 12
        && circle.radius > 0.2 * w.min(h) as f64
        && outside * 50 > w * h
        // A logo or a line of text may stand in the surround.
        && dark_outside * 100 >= outside * 95
        && lit_inside * 10 >= inside * 7
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A textured disc on noise of up to 8, cut by the image's border where it reaches out.
    fn scene(size: [usize; 2], centre: [f64; 2], radius: f64) -> Frame {
        let pixel = |i: usize| {
            let (x, y) = (i % size[0], i / size[0]);
            let noise = ((x * 7919 + y * 104_729) % 9) as u8;
            let d = (x as f64 - centre[0]).hypot(y as f64 - centre[1]);
            if d <= radius { [120 + 9 * noise, 60, 50 + noise] } else { [noise, noise / 2, noise] }
        };
        Frame { name: "disc".into(), size, rgb: (0..size[0] * size[1]).map(pixel).collect() }
    }

    #[test]
    fn finds_a_whole_and_a_cut_disc() {
        for (centre, radius) in [([160.0, 90.0], 80.0), ([150.5, 95.0], 120.0)] {
            let circle = fit_viewport(&[scene([320, 180], centre, radius)]).unwrap();
            assert!((circle.radius - radius).abs() < 2.5, "{circle:?}");
            assert!((circle.centre[0] - centre[0]).hypot(circle.centre[1] - centre[1]) < 1.0);
        }
        let frame = scene([320, 180], [160.0, 90.0], 80.0);
        let mask = viewport(&[frame.clone(), frame]).unwrap();
        assert!(mask.at(160, 90) && mask.at(233, 90));
        assert!(!mask.at(238, 90) && !mask.at(2, 2));
    }

    #[test]
    fn a_drifting_disc_leaves_what_is_common() {
        let shifted = scene([320, 180], [168.0, 90.0], 80.0);
        let mask = viewport(&[scene([320, 180], [160.0, 90.0], 80.0), shifted]).unwrap();
        assert!(mask.at(96, 90) && mask.at(232, 90));
        assert!(!mask.at(86, 90) && !mask.at(242, 90));
    }

    #[test]
    fn none_without_a_dark_surround() {
        assert!(viewport(&[scene([160, 120], [80.0, 60.0], 400.0)]).is_none());
        assert!(viewport(&[scene([160, 120], [80.0, 60.0], 0.0)]).is_none());
        assert!(viewport(&[]).is_none());
        // Black bars left and right are no circle.
        let mut bars = scene([160, 120], [80.0, 60.0], 400.0);
        let black = |i: usize| (i % 160) < 20 || (i % 160) >= 140;
        (0..bars.rgb.len()).filter(|i| black(*i)).for_each(|i| bars.rgb[i] = [3, 3, 3]);
        assert!(viewport(&[bars]).is_none());
    }
}
