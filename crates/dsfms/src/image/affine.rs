//! A patch of one image found in another under an affine map: Gauss-Newton steps on its place and
//! map, indifferent to brightness and contrast (Shi and Tomasi 1994).

use super::Plane;
use super::flow::RADIUS;
use crate::geometry::{Point2, Vector2};
use nalgebra::{Matrix2, SMatrix, SVector};

/// Side of a patch, and its pixels, in px of the first image.
const SIDE: usize = 2 * RADIUS as usize + 1;
const COUNT: usize = SIDE * SIDE;
/// Steps at most.
const STEPS: usize = 20;
/// A step that moves no pixel of the patch farther is the last, px.
const SETTLED: f64 = 0.02;
/// What comes farther from its start leads nowhere, px.
const LOST: f64 = 8.0;
/// Expected distance from where it starts along each axis, px.
const OFF: f64 = 1.5;
/// Pixels whose errors are alike, so that they count as one.
const ALIKE_PX: f64 = 20.0;
/// Expected change of each entry of the map from where it starts.
const CHANGE: f64 = 0.3;
/// Areas that a map may make of 1.
const AREA: std::ops::Range<f64> = 0.15..8.0;
/// What two images of the same differ by at least, of the brightness: shading that is another.
const MODEL: f64 = 0.02;
/// Least standard deviation of a patch with texture, in units of the image.
const FLAT: f64 = 1e-3;

/// Where and how an image shows a patch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacedPatch {
    /// Centre of the patch, px.
    pub(crate) at: Point2,
    /// Px of this image by px of the image that the patch is of.
    pub(crate) affine: Matrix2<f64>,
    /// Correlation of both, in `[-1, 1]`.
    pub(crate) alike: f64,
    /// Standard deviation of the place along its weakest direction, px.
    pub(crate) sigma: f64,
}

/// What the second image shows of a patch: its mean, values less that, and gradients, per px.
struct ShownPatch {
    mean: f64,
    values: [f64; COUNT],
    gradients: [Vector2; COUNT],
}

/// Place and columns of the map.
type AffineStep = SVector<f64, 6>;

/// Where `seen` shows the patch of `image` about `at`, from `start`; both are NaN where they do not
/// count. `None` where it leaves what counts, has no texture or does not settle.
pub(crate) fn align(
    image: &Plane,
    at: Point2,
    seen: &Plane,
    start: &PlacedPatch,
) -> Option<PlacedPatch> {
    let patch = patch(image, at)?;
    let own: f64 = patch.iter().map(|v| v * v).sum();
    if own.is_nan() || own < COUNT as f64 * FLAT * FLAT {
        return None;
    }
    let (mut found, mut moved) = (*start, f64::INFINITY);
    for _ in 0..STEPS {
        let shown = shown(seen, &found)?;
        let square: f64 = shown.values.iter().map(|v| v * v).sum();
        let cross: f64 = patch.iter().zip(&shown.values).map(|(a, b)| a * b).sum();
        found.alike = cross / (own * square).sqrt();
        if moved < SETTLED {
            return Some(found);
        }
        if found.alike.is_nan() || found.alike <= 0.0 {
            return None;
        }
        let (off, map) = (found.at - start.at, found.affine - start.affine);
        let change = AffineStep::from([off.x, off.y, map[0], map[1], map[2], map[3]]);
        let (step, sigma) = step(&patch, cross / own, &shown, &change)?;
        found.sigma = sigma;
        let turn = Matrix2::from_column_slice(&step.as_slice()[2..]);
        found.at -= step.fixed_rows::<2>(0);
        found.affine -= turn;
        moved = step.fixed_rows::<2>(0).norm() + f64::from(RADIUS) * turn.norm();
        let near = (found.at - start.at).norm() < LOST;
        if !near || !AREA.contains(&found.affine.determinant()) {
            return None;
        }
    }
    None
}

/// Pixels of a patch from its centre, in the order of [`patch`].
fn offsets() -> impl Iterator<Item = Vector2> {
    let all = (-RADIUS..=RADIUS).flat_map(|y| (-RADIUS..=RADIUS).map(move |x| (x, y)));
    all.map(|(x, y)| Vector2::new(f64::from(x), f64::from(y)))
}

/// Values of a patch less their mean.
fn patch(image: &Plane, at: Point2) -> Option<[f64; COUNT]> {
    let mut values = [0.0; COUNT];
    for (value, from) in values.iter_mut().zip(offsets()) {
        *value = image.sample(&(at + from))?.0;
    }
    centre(&mut values);
    Some(values)
}

/// Take the mean away; what it was.
fn centre(values: &mut [f64; COUNT]) -> f64 {
    let mean = values.iter().sum::<f64>() / COUNT as f64;
    values.iter_mut().for_each(|v| *v -= mean);
    mean
}

fn shown(seen: &Plane, placed: &PlacedPatch) -> Option<ShownPatch> {
    let (mut values, mut gradients) = ([0.0; COUNT], [Vector2::zeros(); COUNT]);
    for ((value, gradient), from) in values.iter_mut().zip(&mut gradients).zip(offsets()) {
        (*value, *gradient) = seen.sample(&(placed.at + placed.affine * from))?;
        if value.is_nan() {
            return None;
        }
    }
    Some(ShownPatch { mean: centre(&mut values), values, gradients })
}

/// The step of place and map by which `gain` times the patch is shown better, and the standard
/// deviation of the place; `change`: that of the map since the start, which is held.
fn step(
    patch: &[f64; COUNT],
    gain: f64,
    shown: &ShownPatch,
    change: &AffineStep,
) -> Option<(AffineStep, f64)> {
    let (mut normal, mut right) = (SMatrix::<f64, 6, 6>::zeros(), AffineStep::zeros());
    let (mut sum, mut squares) = (AffineStep::zeros(), 0.0);
    for (((from, g), value), own) in offsets().zip(&shown.gradients).zip(&shown.values).zip(patch) {
        let left = value - gain * own;
        let row =
            AffineStep::from([g.x, g.y, g.x * from.x, g.y * from.x, g.x * from.y, g.y * from.y]);
        normal.ger(1.0, &row, &row, 1.0);
        right.axpy(left, &row, 1.0);
        sum += row;
        squares += left * left;
    }
    // Values have lost their means, and so must the rows.
    normal.ger(-1.0 / COUNT as f64, &sum, &sum, 1.0);
    let noise = ALIKE_PX * (squares / COUNT as f64).max((MODEL * shown.mean).powi(2));
    for (k, change) in change.iter().enumerate() {
        let spread = if k < 2 { OFF } else { CHANGE };
        let hold = noise / (spread * spread);
        normal[(k, k)] += hold;
        right[k] += hold * change;
    }
    let normal = normal.cholesky()?;
    let place: Matrix2<f64> = normal.inverse().fixed_view::<2, 2>(0, 0).into();
    Some((normal.solve(&right), (noise * place.symmetric_eigenvalues().max()).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Waves without a period in the image, as an affine map of the image shows them.
    fn waves(map: impl Fn(Vector2) -> Vector2) -> Plane {
        let size = [120, 100];
        let value = |i: usize| {
            let p = map(Vector2::new((i % 120) as f64, (i / 120) as f64));
            let v =
                (0.41 * p.x).sin() * (0.33 * p.y + 0.15 * p.x).cos() + (0.005 * p.x * p.y).sin();
            (0.5 + 0.2 * v) as f32
        };
        Plane { size, data: (0..120 * 100).map(value).collect() }
    }

    #[test]
    fn a_patch_turned_and_stretched_is_found_under_another_brightness() {
        let at = Point2::new(60.0, 50.0);
        let affine = Matrix2::new(1.3, 0.2, -0.15, 0.9);
        let (inverse, place) = (affine.try_inverse().unwrap(), Point2::new(66.0, 45.5));
        let of = waves(|p| p);
        let mut seen = waves(|p| at.coords + inverse * (p - place.coords));
        seen.data.iter_mut().for_each(|v| *v = 0.1 + 0.6 * *v);
        let near = Matrix2::new(1.15, 0.1, 0.0, 1.0);
        let start =
            PlacedPatch { at: Point2::new(64.5, 46.5), affine: near, alike: 0.0, sigma: 0.0 };
        let found = align(&of, at, &seen, &start).unwrap();
        assert!((found.at - place).norm() < 0.1, "{found:?}");
        assert!((found.affine - affine).norm() < 0.03 && found.alike > 0.99, "{found:?}");
        // Where a pixel does not count, beside the image, without texture: not found.
        let beside = Point2::new(3.0, 50.0);
        assert!(align(&of, beside, &seen, &PlacedPatch { at: beside, ..start }).is_none());
        let flat = Plane::filled(of.size, 0.4);
        assert!(align(&flat, at, &seen, &start).is_none());
        seen.data[45 * 120 + 66] = f32::NAN;
        assert!(align(&of, at, &seen, &start).is_none());
    }
}
