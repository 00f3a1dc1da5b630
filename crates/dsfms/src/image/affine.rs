//! A patch of one image found in another under an affine map: Gauss-Newton steps on its place and
//! map, indifferent to brightness and contrast (Shi and Tomasi 1994).

use super::Plane;
use super::flow::RADIUS;
use crate::geometry::{Point2, Vector2};
use nalgebra::{Matrix2, Matrix6, SVector, Vector6};

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

/// A patch of an image: its values less their mean, row by row, and the sum of their squares.
pub(crate) struct TexturePatch {
    values: [f64; COUNT],
    square: f64,
}

/// What another image shows of a patch: its mean, values less that, and gradients, per px.
struct ShownPatch {
    mean: f64,
    values: [f64; COUNT],
    gradients: [Vector2; COUNT],
}

impl TexturePatch {
    /// The patch about `at`; `None` beside the image, where a pixel does not count (NaN) and
    /// without texture.
    pub(crate) fn of(image: &Plane, at: Point2) -> Option<Self> {
        let mut values = [0.0; COUNT];
        for (value, from) in values.iter_mut().zip(offsets()) {
            *value = image.sample(&(at + from))?.0;
        }
        centre(&mut values);
        let square = values.iter().map(|v| v * v).sum::<f64>();
        (square >= COUNT as f64 * FLAT * FLAT).then_some(Self { values, square })
    }

    /// Where `seen`, NaN where it does not count, shows the patch, from `start`. `None` where it
    /// leaves what counts or does not settle.
    pub(crate) fn found(&self, seen: &Plane, start: &PlacedPatch) -> Option<PlacedPatch> {
        let (mut found, mut moved) = (*start, f64::INFINITY);
        for _ in 0..STEPS {
            let shown = shown(seen, &found)?;
            let square: f64 = shown.values.iter().map(|v| v * v).sum();
            let cross: f64 = self.values.iter().zip(&shown.values).map(|(a, b)| a * b).sum();
            found.alike = cross / (self.square * square).sqrt();
            if moved < SETTLED {
                return Some(found);
            }
            if found.alike.is_nan() || found.alike <= 0.0 {
                return None;
            }
            let (off, map) = (found.at - start.at, found.affine - start.affine);
            let change = Vector6::new(off.x, off.y, map[0], map[1], map[2], map[3]);
            let (step, sigma) = self.step(cross / self.square, &shown, &change)?;
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

    /// The step of place and columns of the map by which `gain` times the patch is shown better,
    /// and the standard deviation of the place; `change`: that of both since the start, which is
    /// held.
    fn step(
        &self,
        gain: f64,
        shown: &ShownPatch,
        change: &Vector6<f64>,
    ) -> Option<(Vector6<f64>, f64)> {
        let mut left = shown.values;
        left.iter_mut().zip(&self.values).for_each(|(left, own)| *left -= gain * own);
        let squares: f64 = left.iter().map(|v| v * v).sum();
        let noise = ALIKE_PX * (squares / COUNT as f64).max((MODEL * shown.mean).powi(2));
        let (mut normal, mut right) = normal_equations(&shown.gradients, &left);
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
}

/// Pixels of a patch from its centre, row by row.
fn offsets() -> impl Iterator<Item = Vector2> {
    let all = (-RADIUS..=RADIUS).flat_map(|y| (-RADIUS..=RADIUS).map(move |x| (x, y)));
    all.map(|(x, y)| Vector2::new(f64::from(x), f64::from(y)))
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
    }
    let mean = centre(&mut values);
    (!mean.is_nan()).then_some(ShownPatch { mean, values, gradients })
}

/// The normal matrix and right side of place and columns of the map: a pixel at `[x, y]` from the
/// centre has the Jacobian `(1, x, y)` ⊗ gradient, so that sums of seven products weighed by 1, x,
/// x², y, xy and y² hold all of both.
fn normal_equations(
    gradients: &[Vector2; COUNT],
    left: &[f64; COUNT],
) -> (Matrix6<f64>, Vector6<f64>) {
    const WEIGHTS: [[usize; 3]; 3] = [[0, 1, 3], [1, 2, 4], [3, 4, 5]];
    let mut sums = [SVector::<f64, 7>::zeros(); 6];
    for (y, (gradients, left)) in (-RADIUS..).zip(gradients.chunks(SIDE).zip(left.chunks(SIDE))) {
        let mut row = [SVector::<f64, 7>::zeros(); 3];
        for (x, (g, left)) in (-RADIUS..).map(f64::from).zip(gradients.iter().zip(left)) {
            let of =
                SVector::from([g.x * g.x, g.x * g.y, g.y * g.y, left * g.x, left * g.y, g.x, g.y]);
            row[0] += of;
            row[1] += of * x;
            row[2] += of * (x * x);
        }
        let y = f64::from(y);
        let [ones, xs, squares] = row;
        let weighed = [ones, xs, squares, ones * y, xs * y, ones * (y * y)];
        sums.iter_mut().zip(weighed).for_each(|(sum, row)| *sum += row);
    }
    let right = Vector6::from_fn(|k, _| sums[WEIGHTS[0][k / 2]][3 + k % 2]);
    let sum = Vector6::from_fn(|k, _| sums[WEIGHTS[0][k / 2]][5 + k % 2]);
    let products = Matrix6::from_fn(|a, b| sums[WEIGHTS[a / 2][b / 2]][a % 2 + b % 2]);
    // Values have lost their means, and so must the rows.
    (products - sum * sum.transpose() / COUNT as f64, right)
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
        let find = |of: &Plane, at, seen: &Plane, start: &PlacedPatch| {
            TexturePatch::of(of, at)?.found(seen, start)
        };
        let found = find(&of, at, &seen, &start).unwrap();
        assert!((found.at - place).norm() < 0.1, "{found:?}");
        assert!((found.affine - affine).norm() < 0.03 && found.alike > 0.99, "{found:?}");
        // Where a pixel does not count, beside the image, without texture: not found.
        let beside = Point2::new(3.0, 50.0);
        assert!(find(&of, beside, &seen, &PlacedPatch { at: beside, ..start }).is_none());
        let flat = Plane::filled(of.size, 0.4);
        assert!(find(&flat, at, &seen, &start).is_none());
        seen.data[45 * 120 + 66] = f32::NAN;
        assert!(find(&of, at, &seen, &start).is_none());
    }

    #[test]
    fn sums_of_products_are_the_normal_equations_of_the_pixels() {
        let placed = PlacedPatch {
            at: Point2::new(60.3, 50.8),
            affine: Matrix2::new(1.1, 0.2, -0.1, 0.9),
            alike: 0.0,
            sigma: 0.0,
        };
        let ShownPatch { values, gradients, .. } = shown(&waves(|p| p), &placed).unwrap();
        let rows: Vec<Vector6<f64>> = (gradients.iter().zip(offsets()))
            .map(|(g, p)| Vector6::new(g.x, g.y, g.x * p.x, g.y * p.x, g.x * p.y, g.y * p.y))
            .collect();
        let mean = rows.iter().sum::<Vector6<f64>>() / COUNT as f64;
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for (row, value) in rows.iter().zip(&values) {
            normal += (row - mean) * (row - mean).transpose();
            right += row * *value;
        }
        let found = normal_equations(&gradients, &values);
        assert!((found.0 - normal).norm() < 1e-9 * normal.norm(), "{} {normal}", found.0);
        assert!((found.1 - right).norm() < 1e-9 * right.norm(), "{} {right}", found.1);
    }
}
