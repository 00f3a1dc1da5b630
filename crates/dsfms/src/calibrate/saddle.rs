//! Candidate corners: saddle points of the smoothed image around which it is bright, dark, bright,
//! dark.

use crate::geometry::{Point2, Vector2};
use crate::image::Plane;
use crate::image::filter::blur;
use std::f64::consts::{PI, TAU};

/// A saddle point of one pyramid level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Saddle {
    /// Position, px of the level.
    pub at: Point2,
    /// Amplitude of bright and dark around it, encoded grey.
    pub contrast: f64,
    /// Direction of the middle of the bright sectors, rad, modulo π. On a chessboard it turns by a
    /// right angle from corner to corner.
    pub bright: f64,
}

/// Blur before the derivatives, px.
const SIGMA: f64 = 1.5;
/// Radius of the ring on which bright and dark are judged, px. Squares must be larger than that.
const RING: f64 = 4.5;
/// Least contrast of a corner, encoded grey.
const MIN_CONTRAST: f64 = 0.02;
/// Least share of the second harmonic in the variance on the ring: 0.81 for square corners, 0.48
/// for corners sheared to 40°, little for noise and edges.
const MIN_SHARE: f64 = 0.4;
/// Candidates kept, strongest first.
const MAX_CANDIDATES: usize = 3000;

/// Saddle points, strongest contrast first.
pub(super) fn saddles(image: &Plane) -> Vec<Saddle> {
    let smooth = blur(image, SIGMA);
    let [w, h] = smooth.size;
    let margin = RING.ceil() as usize + 1;
    if w <= 2 * margin + 2 || h <= 2 * margin + 2 {
        return Vec::new();
    }
    let strength = saddle_strength(&smooth);
    let mut found = Vec::new();
    for y in margin..h - margin {
        for x in margin..w - margin {
            if strength.at(x, y) > 1e-7
                && is_peak(&strength, x, y)
                && let Some(saddle) = judge(&smooth, x, y)
            {
                found.push(saddle);
            }
        }
    }
    found.sort_by(|a, b| b.contrast.total_cmp(&a.contrast));
    found.truncate(MAX_CANDIDATES);
    found
}

/// `Ixy² − Ixx Iyy`: minus the determinant of the Hessian, positive at saddles.
fn saddle_strength(image: &Plane) -> Plane {
    let [w, h] = image.size;
    let mut out = Plane::filled(image.size, 0.0);
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let (_, [xx, xy, yy]) = derivatives(image, x, y);
            out.data[y * w + x] = (xy * xy - xx * yy) as f32;
        }
    }
    out
}

/// Gradient and second derivatives xx, xy, yy by central differences.
fn derivatives(image: &Plane, x: usize, y: usize) -> (Vector2, [f64; 3]) {
    let at = |dx: usize, dy: usize| f64::from(image.at(x + dx - 1, y + dy - 1));
    let centre = at(1, 1);
    let gradient = Vector2::new(0.5 * (at(2, 1) - at(0, 1)), 0.5 * (at(1, 2) - at(1, 0)));
    let xx = at(2, 1) - 2.0 * centre + at(0, 1);
    let yy = at(1, 2) - 2.0 * centre + at(1, 0);
    let xy = 0.25 * (at(2, 2) - at(0, 2) - at(2, 0) + at(0, 0));
    (gradient, [xx, xy, yy])
}

/// The largest of its 5x5 neighbourhood, the first of equals.
fn is_peak(strength: &Plane, x: usize, y: usize) -> bool {
    let own = strength.at(x, y);
    (y - 2..=y + 2).all(|v| {
        (x - 2..=x + 2).all(|u| {
            let other = strength.at(u, v);
            (u, v) == (x, y) || other < own || (other == own && (v, u) > (y, x))
        })
    })
}

fn judge(image: &Plane, x: usize, y: usize) -> Option<Saddle> {
    let (g, [xx, xy, yy]) = derivatives(image, x, y);
    // Where the gradient vanishes, by one Newton step.
    let det = xx * yy - xy * xy;
    let step = Vector2::new(xy * g.y - yy * g.x, xy * g.x - xx * g.y) / det;
    if step.iter().any(|s| s.is_nan()) || step.amax() >= 1.5 {
        return None;
    }
    let at = Point2::new(x as f64, y as f64) + step;
    ring(image, &at).map(|(contrast, bright)| Saddle { at, contrast, bright })
}

/// Amplitude and direction of the second harmonic around a point; `None` where another pattern
/// prevails.
fn ring(image: &Plane, at: &Point2) -> Option<(f64, f64)> {
    const SAMPLES: usize = 24;
    let (mut mean, mut squares) = (0.0, 0.0);
    let mut second = Vector2::zeros();
    for k in 0..SAMPLES {
        let angle = TAU * k as f64 / SAMPLES as f64;
        let p = at + Vector2::new(angle.cos(), angle.sin()) * RING;
        let value = image.sample(&p)?.0;
        mean += value / SAMPLES as f64;
        squares += value * value / SAMPLES as f64;
        second += Vector2::new((2.0 * angle).cos(), (2.0 * angle).sin()) * value;
    }
    let amplitude = 2.0 * second.norm() / SAMPLES as f64;
    let variance = squares - mean * mean;
    let share = 0.5 * amplitude * amplitude / variance.max(1e-12);
    let bright = (0.5 * second.y.atan2(second.x)).rem_euclid(PI);
    (amplitude > MIN_CONTRAST && share > MIN_SHARE).then_some((amplitude, bright))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crossing_is_found_with_its_bright_direction() {
        let size = [40, 40];
        // Bright where x and y have the same sign about (19.3, 20.4): the bright middle is at 45°.
        let value = |x: f64, y: f64| {
            let soft = |d: f64| (d / 1.2).tanh();
            0.5 + 0.4 * (soft(x - 19.3) * soft(y - 20.4))
        };
        let data = (0..1600).map(|i| value((i % 40) as f64, (i / 40) as f64) as f32).collect();
        let found = saddles(&Plane { size, data });
        assert_eq!(found.len(), 1);
        assert!((found[0].at - Point2::new(19.3, 20.4)).norm() < 0.1, "{:?}", found[0]);
        assert!((found[0].bright - PI / 4.0).abs() < 0.02);
    }

    #[test]
    fn edges_and_blobs_are_no_corners() {
        let size = [40, 40];
        let data = (0..1600)
            .map(|i| {
                let (x, y) = ((i % 40) as f64 - 20.0, (i / 40) as f64 - 20.0);
                let blob = (-(x * x + y * y) / 20.0).exp();
                (if x + 0.3 * y > 5.0 { 0.8 } else { 0.2 } + 0.2 * blob) as f32
            })
            .collect();
        assert!(saddles(&Plane { size, data }).is_empty());
    }
}
