//! The bright disc in which a laparoscope shows its image on a near-black surround.

use super::{Frame, Mask};

/// Encoded value up to which a pixel can be surround.
const DARK: u8 = 40;
/// At most this many frames are looked at, evenly spread.
const FRAMES: usize = 24;
/// The mask ends this many px inside the fitted circle: the rim is blurred and vignetted.
const MARGIN_PX: f64 = 4.0;

/// A circle in px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre, px.
    pub centre: [f64; 2],
    /// Radius, px.
    pub radius: f64,
}

/// The endoscope's viewport, eroded by a few px (`true` = image content); `None` where the frames
/// (all of one size) have no dark circular surround.
pub fn viewport(frames: &[Frame]) -> Option<Mask> {
    let circle = fit_viewport(frames)?;
    let radius = circle.radius - MARGIN_PX;
    let size = frames.first()?.size;
    let inside = |i: usize| distance(&circle, i % size[0], i / size[0]) <= radius;
    Some(Mask { size, data: (0..size[0] * size[1]).map(inside).collect() })
}

/// The circle of the viewport; it may reach beyond the image on some sides.
///
/// The brightest value of every pixel over the frames is cut into lit and dark; the outermost lit
/// pixels of every row and column give the rim, to which a circle is fitted robustly. The circle
/// is accepted when most of the rim lies on it, and what lies outside it is dark.
pub fn fit_viewport(frames: &[Frame]) -> Option<Circle> {
    let brightest = brightest(frames)?;
    let size = frames.first()?.size;
    let threshold = surround_level(&brightest, size)?;
    let data = brightest.iter().map(|&v| v > threshold).collect();
    let lit = Mask { size, data }.erode(1.0).largest_component().dilate(1.0);
    let rim = rim(&lit);
    let circle = fit_robustly(&rim)?;
    accepted(&circle, &rim, &brightest, size, threshold).then_some(circle)
}

/// Largest channel over a selection of the frames, by pixel; `None` when sizes differ.
fn brightest(frames: &[Frame]) -> Option<Vec<u8>> {
    let first = frames.first()?;
    let mut out = vec![0; first.rgb.len()];
    let stride = frames.len().div_ceil(FRAMES);
    for frame in frames.iter().step_by(stride) {
        if frame.size != first.size {
            return None;
        }
        for (out, p) in out.iter_mut().zip(&frame.rgb) {
            *out = (*out).max(p[0]).max(p[1]).max(p[2]);
        }
    }
    Some(out)
}

/// The value that parts surround from image: a little above the darkest corner's; `None` when no
/// corner is dark.
fn surround_level(brightest: &[u8], [w, h]: [usize; 2]) -> Option<u8> {
    let side = (w.min(h) / 40).max(2);
    if w < 4 * side || h < 4 * side {
        return None;
    }
    let corner = |x0: usize, y0: usize| {
        let mut values: Vec<u8> =
            (0..side * side).map(|i| brightest[(y0 + i / side) * w + x0 + i % side]).collect();
        values.sort_unstable();
        values[values.len() * 9 / 10]
    };
    let corners = [(0, 0), (w - side, 0), (0, h - side), (w - side, h - side)];
    let level = corners.into_iter().map(|(x, y)| corner(x, y)).min()?;
    (level <= DARK - 10).then_some((level + 10).max(24))
}

/// Outermost lit pixels of every row and column that do not lie on the border of the image.
fn rim(lit: &Mask) -> Vec<[f64; 2]> {
    let [w, h] = lit.size;
    let mut rim = Vec::new();
    for y in 0..h {
        let ends = ((0..w).find(|&x| lit.at(x, y)), (0..w).rev().find(|&x| lit.at(x, y)));
        let (Some(a), Some(b)) = ends else { continue };
        rim.extend((a > 1).then_some([a as f64 - 0.5, y as f64]));
        rim.extend((b + 2 < w).then_some([b as f64 + 0.5, y as f64]));
    }
    for x in 0..w {
        let ends = ((0..h).find(|&y| lit.at(x, y)), (0..h).rev().find(|&y| lit.at(x, y)));
        let (Some(a), Some(b)) = ends else { continue };
        rim.extend((a > 1).then_some([x as f64, a as f64 - 0.5]));
        rim.extend((b + 2 < h).then_some([x as f64, b as f64 + 0.5]));
    }
    rim
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
            (1.0 + (d / scale).powi(2)).powi(-2)
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
    brightest: &[u8],
    [w, h]: [usize; 2],
    threshold: u8,
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
    for (i, &v) in brightest.iter().enumerate() {
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
        && outside * 50 > brightest.len()
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
            assert!((circle.radius - radius).abs() < 1.0, "{circle:?}");
            assert!((circle.centre[0] - centre[0]).hypot(circle.centre[1] - centre[1]) < 1.0);
        }
        let frame = scene([320, 180], [160.0, 90.0], 80.0);
        let mask = viewport(&[frame.clone(), frame]).unwrap();
        assert!(mask.at(160, 90) && mask.at(235, 90));
        assert!(!mask.at(238, 90) && !mask.at(2, 2));
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
