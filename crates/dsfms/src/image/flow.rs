//! Where patches of an image are in another (of the rendered template in a frame, of a frame in the
//! next): pyramidal Lucas-Kanade alignment by translation (inverse compositional, Baker and
//! Matthews 2004), indifferent to brightness and contrast of the patch, and normalised
//! cross-correlation to tell whether it worked.

use super::filter::halve;
use super::{Mask, Plane};
use crate::geometry::{Point2, Vector2};

/// Half the side of a patch less the centre, px of each level.
pub const RADIUS: i32 = 8;

/// Side of a patch, and its pixels.
const SIDE: usize = 2 * RADIUS as usize + 1;
const COUNT: usize = SIDE * SIDE;

/// Steps on a level at most.
const STEPS: usize = 12;

/// A shorter step is the last, px.
const SETTLED: f64 = 0.02;

/// An image and its halves, fine to coarse.
pub struct Pyramid {
    /// The levels; never empty.
    pub levels: Vec<Plane>,
}

impl Pyramid {
    /// `levels` sizes of a plane, at least one.
    pub fn new(plane: Plane, levels: usize) -> Self {
        let mut all = vec![plane];
        while all.len() < levels {
            all.push(halve(&all[all.len() - 1]));
        }
        Self { levels: all }
    }
}

/// [`follow`] on the finest level alone, from a start that is a few pixels off at most.
pub(crate) fn settle(
    render: &Pyramid,
    frame: &Pyramid,
    at: Point2,
    start: Point2,
) -> Option<Point2> {
    align(&render.levels[0], &frame.levels[0], at, start, SETTLED)
}

/// Position in `frame` (level 0) of the patch that `render` shows about `at`, searched from
/// `start`; `None` where it leaves the image, has no texture in some direction or does not settle.
#[doc(alias("optical flow", "Lucas-Kanade", "KLT"))]
pub fn follow(render: &Pyramid, frame: &Pyramid, at: Point2, start: Point2) -> Option<Point2> {
    let mut offset = start - at;
    for level in (0..render.levels.len().min(frame.levels.len())).rev() {
        let scale = 0.5_f64.powi(level as i32);
        let centre = Point2::from((at.coords.add_scalar(0.5)) * scale - Vector2::repeat(0.5));
        let settled = if level > 0 { 5.0 * SETTLED } else { SETTLED };
        let found = align(
            &render.levels[level],
            &frame.levels[level],
            centre,
            centre + offset * scale,
            settled,
        );
        match found {
            Some(found) => offset = (found - centre) / scale,
            // A coarse level may see beyond the border of what is known; the finest decides.
            None if level > 0 => {}
            None => return None,
        }
    }
    Some(at + offset)
}

/// One level: inverse compositional steps on the patch with its mean removed and its contrast
/// matched. Coarse levels only lead to the finest and need not settle as well.
fn align(render: &Plane, frame: &Plane, at: Point2, start: Point2, settled: f64) -> Option<Point2> {
    let value = patch(render, at)?;
    let [gx, gy] = gradients(render, at)?;
    let (xx, xy, yy) = (dot(&gx, &gx), dot(&gx, &gy), dot(&gy, &gy));
    let inverse = nalgebra::Matrix2::new(xx, xy, xy, yy).try_inverse()?;
    let spread = moments(&value).1;
    // The gradients' own means, so that those of the patches need not be taken away everywhere.
    let (sum_x, sum_y) = (total(&gx), total(&gy));
    let mean = total(&value) / COUNT as f64;
    let own = Vector2::new(dot(&gx, &value) - sum_x * mean, dot(&gy, &value) - sum_y * mean);
    let mut place = start;
    for _ in 0..STEPS {
        let seen = patch(frame, place)?;
        let (seen_mean, seen_spread) = moments(&seen);
        if seen_spread < 1e-6 {
            return None;
        }
        let contrast = spread / seen_spread;
        let other =
            Vector2::new(dot(&gx, &seen) - sum_x * seen_mean, dot(&gy, &seen) - sum_y * seen_mean);
        let step = inverse * (other * contrast - own);
        place -= step;
        if step.norm().is_nan() || step.norm() >= 2.0 * RADIUS as f64 {
            return None;
        }
        if step.norm() < settled {
            return Some(place);
        }
    }
    None
}

/// Normalised cross-correlation, in `[-1, 1]`, of the patches about a place of each image; `None`
/// outside, or where one of them is flat.
pub fn correlation(a: &Plane, at: Point2, b: &Plane, place: Point2) -> Option<f64> {
    let (left, right) = (patch(a, at)?, patch(b, place)?);
    let ((mean_a, spread_a), (mean_b, spread_b)) = (moments(&left), moments(&right));
    if spread_a < 1e-6 || spread_b < 1e-6 {
        return None;
    }
    let product = dot(&left, &right) / COUNT as f64 - mean_a * mean_b;
    Some(product / (spread_a * spread_b))
}

/// The place of `b`, a whole number of pixels and at most `reach` of them along each axis from
/// `start`, whose patch correlates best with that of `a` about `at`: where steps alone would not
/// get. `None` where there is no patch with any contrast.
pub(crate) fn most_alike(
    a: &Plane,
    at: Point2,
    b: &Plane,
    start: Point2,
    reach: i32,
) -> Option<Point2> {
    let left = patch(a, at)?;
    let mean = total(&left) / COUNT as f64;
    let mut best: Option<(f64, Point2)> = None;
    for (x, y) in (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))) {
        let place = start + Vector2::new(f64::from(x), f64::from(y));
        let Some(right) = patch(b, place) else { continue };
        let (right_mean, spread) = moments(&right);
        // The spread of the left patch is the same for all.
        let alike = (dot(&left, &right) / COUNT as f64 - mean * right_mean) / spread;
        if spread >= 1e-6 && best.is_none_or(|(most, _)| alike > most) {
            best = Some((alike, place));
        }
    }
    best.map(|(_, place)| place)
}

/// Whether the middle, the corners and the sides of a patch lie in a mask.
pub fn whole(mask: &Mask, at: Point2) -> bool {
    let r = f64::from(RADIUS);
    [-r, 0.0, r]
        .iter()
        .all(|dy| [-r, 0.0, r].iter().all(|dx| mask.at_pixel(&Point2::new(at.x + dx, at.y + dy))))
}

/// Values of a patch less that of its middle, so that single precision is enough for its spread;
/// `None` outside the image.
fn patch(plane: &Plane, at: Point2) -> Option<[f32; COUNT]> {
    let mut values = window::<SIDE, COUNT>(plane, at)?;
    let middle = values[COUNT / 2];
    values.iter_mut().for_each(|v| *v -= middle);
    Some(values)
}

/// Central differences of a patch, per px, by column and by row.
fn gradients(plane: &Plane, at: Point2) -> Option<[[f32; COUNT]; 2]> {
    const WIDE: usize = SIDE + 2;
    let values = window::<WIDE, { WIDE * WIDE }>(plane, at)?;
    let mut found = [[0.0; COUNT]; 2];
    for y in 0..SIDE {
        let row = &values[(y + 1) * WIDE..][..WIDE];
        let (above, below) = (&values[y * WIDE..][..WIDE], &values[(y + 2) * WIDE..][..WIDE]);
        for x in 0..SIDE {
            found[0][y * SIDE + x] = 0.5 * (row[x + 2] - row[x]);
            found[1][y * SIDE + x] = 0.5 * (below[x + 1] - above[x + 1]);
        }
    }
    Some(found)
}

/// Values of a square of `SIDE` px about a place, all with the same bilinear weights.
fn window<const SIDE: usize, const COUNT: usize>(
    plane: &Plane,
    at: Point2,
) -> Option<[f32; COUNT]> {
    let (x0, y0) = (at.x.floor(), at.y.floor());
    let (u, v) = ((at.x - x0) as f32, (at.y - y0) as f32);
    let reach = (SIDE / 2) as f64;
    let inside = |c: f64, n: usize| c - reach >= 0.0 && c + reach + 1.0 <= n as f64 - 1.0;
    if !(inside(x0, plane.size[0]) && inside(y0, plane.size[1])) {
        return None;
    }
    let (left, top) = (x0 as usize - SIDE / 2, y0 as usize - SIDE / 2);
    let [a, b, c, d] = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    let mut values = [0.0; COUNT];
    for (row, line) in values.chunks_exact_mut(SIDE).enumerate() {
        let start = (top + row) * plane.size[0] + left;
        let upper = &plane.data[start..=start + SIDE];
        let lower = &plane.data[start + plane.size[0]..=start + plane.size[0] + SIDE];
        for (x, value) in line.iter_mut().enumerate() {
            *value = (a * upper[x] + b * upper[x + 1]) + (c * lower[x] + d * lower[x + 1]);
        }
    }
    Some(values)
}

/// Sums side by side, which the compiler makes vectors of; the same order everywhere.
const LANES: usize = 8;

fn dot(a: &[f32; COUNT], b: &[f32; COUNT]) -> f64 {
    let mut sums = [0.0_f32; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        (0..LANES).for_each(|k| sums[k] += a[k] * b[k]);
    }
    let rest = COUNT - COUNT % LANES..;
    let rest: f32 = a[rest.clone()].iter().zip(&b[rest]).map(|(a, b)| a * b).sum();
    sums.iter().map(|&s| f64::from(s)).sum::<f64>() + f64::from(rest)
}

fn total(values: &[f32; COUNT]) -> f64 {
    dot(values, &[1.0; COUNT])
}

/// Mean and standard deviation.
fn moments(values: &[f32; COUNT]) -> (f64, f64) {
    let mean = total(values) / COUNT as f64;
    let square = dot(values, values) / COUNT as f64 - mean * mean;
    (mean, square.max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A texture without period in the image, moved by `shift`.
    fn texture(shift: [f64; 2], gain: f64, lift: f64) -> Plane {
        let size = [120, 100];
        let value = |i: usize| {
            let (x, y) = ((i % 120) as f64 - shift[0], (i / 120) as f64 - shift[1]);
            let v = (0.21 * x).sin() * (0.17 * y + 0.05 * x).cos() + (0.011 * x * y / 3.0).sin();
            (lift + gain * (0.5 + 0.2 * v)) as f32
        };
        Plane { size, data: (0..120 * 100).map(value).collect() }
    }

    #[test]
    fn a_moved_patch_is_found_under_another_brightness() {
        let a = Pyramid::new(texture([0.0, 0.0], 1.0, 0.0), 3);
        let b = Pyramid::new(texture([5.3, -3.6], 0.6, 0.1), 3);
        let at = Point2::new(60.0, 50.0);
        let found = follow(&a, &b, at, at).unwrap();
        assert!((found - Point2::new(65.3, 46.4)).norm() < 0.05, "{found}");
        let settled = settle(&a, &b, at, Point2::new(64.0, 47.0)).unwrap();
        assert!((settled - found).norm() < 0.05, "{settled}");
        assert!(correlation(&a.levels[0], at, &b.levels[0], found).unwrap() > 0.99);
        assert!(correlation(&a.levels[0], at, &b.levels[0], at).unwrap() < 0.9);
    }

    #[test]
    fn the_most_alike_place_is_found_however_far() {
        let a = texture([0.0, 0.0], 1.0, 0.0);
        let b = texture([17.0, -14.0], 0.6, 0.1);
        let at = Point2::new(60.25, 50.0);
        assert_eq!(most_alike(&a, at, &b, at, 20), Some(Point2::new(77.25, 36.0)));
        assert_eq!(most_alike(&a, at, &Plane::filled([120, 100], 0.4), at, 20), None);
    }

    #[test]
    fn a_flat_patch_or_one_outside_is_not_followed() {
        let a = Pyramid::new(texture([0.0, 0.0], 1.0, 0.0), 1);
        let flat = Pyramid::new(Plane::filled([120, 100], 0.4), 1);
        let at = Point2::new(60.0, 50.0);
        assert_eq!(follow(&a, &flat, at, at), None);
        assert_eq!(follow(&a, &a, at, Point2::new(3.0, 50.0)), None);
        assert_eq!(correlation(&a.levels[0], at, &flat.levels[0], at), None);
    }
}
