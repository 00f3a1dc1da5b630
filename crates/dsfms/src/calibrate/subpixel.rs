//! Corners to a fraction of a pixel: the point that every gradient around it looks past at a right
//! angle (Förstner and Gülch 1987).

use crate::geometry::{Point2, Vector2};
use crate::image::Plane;
use crate::image::filter::blur;
use nalgebra::Matrix2;

/// Blur before the gradient, px: enough for its central differences, little against the window.
const SIGMA: f64 = 1.0;
const ROUNDS: usize = 30;

/// An image whose gradients have been prepared.
pub(super) struct Gradients {
    x: Plane,
    y: Plane,
}

impl Gradients {
    pub(super) fn new(image: &Plane) -> Self {
        let smooth = blur(image, SIGMA);
        let [w, h] = smooth.size;
        let (mut x, mut y) = (Plane::filled([w, h], 0.0), Plane::filled([w, h], 0.0));
        for v in 1..h.saturating_sub(1) {
            for u in 1..w.saturating_sub(1) {
                x.data[v * w + u] = 0.5 * (smooth.at(u + 1, v) - smooth.at(u - 1, v));
                y.data[v * w + u] = 0.5 * (smooth.at(u, v + 1) - smooth.at(u, v - 1));
            }
        }
        Self { x, y }
    }

    /// The corner near `start`, from the gradients within `radius` px; `None` where the search runs
    /// away or out of the image.
    pub(super) fn corner(&self, start: Point2, radius: f64) -> Option<Point2> {
        let mut at = start;
        for _ in 0..ROUNDS {
            let step = self.step(&at, radius)?;
            at += step;
            if (at - start).norm() > 0.6 * radius.max(2.0) {
                return None;
            }
            if step.norm() < 1e-4 {
                break;
            }
        }
        Some(at)
    }

    /// Least squares of `g·(x − at − step) = 0` over the pixels of the window, which fades out
    /// towards its rim. Gradients are taken at pixel centres: interpolating them would draw the
    /// corner there.
    fn step(&self, at: &Point2, radius: f64) -> Option<Vector2> {
        let [w, h] = self.x.size;
        let low = at.map(|c| (c - radius).ceil());
        let high = at.map(|c| (c + radius).floor());
        let inside =
            low.x >= 1.0 && low.y >= 1.0 && high.x < w as f64 - 1.0 && high.y < h as f64 - 1.0;
        if !inside {
            return None;
        }
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for v in low.y as usize..=high.y as usize {
            for u in low.x as usize..=high.x as usize {
                let d = Point2::new(u as f64, v as f64) - at;
                let r2 = d.norm_squared() / (radius * radius);
                if r2 >= 1.0 {
                    continue;
                }
                let g = Vector2::new(f64::from(self.x.at(u, v)), f64::from(self.y.at(u, v)));
                let outer = g * g.transpose() * (1.0 - r2).powi(2);
                normal += outer;
                right += outer * d;
            }
        }
        // Along a single edge the corner is not fixed.
        let [small, large] = eigenvalues(&normal);
        (small > 0.02 * large).then(|| normal.try_inverse())?.map(|inverse| inverse * right)
    }
}

fn eigenvalues(m: &Matrix2<f64>) -> [f64; 2] {
    let (mean, half) = (0.5 * m.trace(), (0.25 * (m.m11 - m.m22).powi(2) + m.m12 * m.m12).sqrt());
    [mean - half, mean + half]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slanted_corner_to_a_hundredth_of_a_pixel() {
        let truth = Point2::new(20.37, 18.81);
        let soft = |d: f64| (d / 1.5).tanh();
        let data = (0..1600)
            .map(|i| {
                let d = Point2::new((i % 40) as f64, (i / 40) as f64) - truth;
                (0.5 + 0.3 * soft(d.x + 0.4 * d.y) * soft(d.y - 0.2 * d.x)) as f32
            })
            .collect();
        let gradients = Gradients::new(&Plane { size: [40, 40], data });
        let found = gradients.corner(Point2::new(21.5, 18.0), 7.0).unwrap();
        assert!((found - truth).norm() < 0.01, "{found}");
    }

    #[test]
    fn an_edge_has_no_corner() {
        let data = (0..1600).map(|i| if i % 40 > 20 { 0.8 } else { 0.2 }).collect();
        let gradients = Gradients::new(&Plane { size: [40, 40], data });
        assert!(gradients.corner(Point2::new(20.0, 20.0), 6.0).is_none());
    }
}
