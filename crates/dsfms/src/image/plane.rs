//! One- and three-channel images of `f32` with bilinear sampling and its exact gradient.

use crate::geometry::{Point2, Vector2};

/// A one-channel image, row major.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Width and height in px.
    pub size: [usize; 2],
    /// `size[0] * size[1]` values.
    pub data: Vec<f32>,
}

/// A three-channel image in linear light, row major.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorImage {
    /// Width and height in px.
    pub size: [usize; 2],
    /// `size[0] * size[1]` pixels, RGB in `[0, 1]`.
    pub data: Vec<[f32; 3]>,
}

/// Where a place lies among the pixels.
struct FourPixels<'a> {
    /// The nearest place inside the image.
    inside: Point2,
    /// The four pixels about it, row by row.
    pixels: [&'a [f32; 3]; 4],
    /// From the first towards the others, px.
    between: [f64; 2],
}

impl ColorImage {
    /// Mean of the three channels: the grey of the photometric terms (linear light).
    pub fn grey(&self) -> Plane {
        let data = self.data.iter().map(|p| (p[0] + p[1] + p[2]) / 3.0).collect();
        Plane { size: self.size, data }
    }

    /// From its channels, all of one size.
    pub(crate) fn of_channels([r, g, b]: [&Plane; 3]) -> Self {
        let rest = g.data.iter().zip(&b.data);
        let data = r.data.iter().zip(rest).map(|(&r, (&g, &b))| [r, g, b]).collect();
        Self { size: r.size, data }
    }

    /// Bilinear value of a weighted sum of the channels at a sub-pixel position and its gradient (per
    /// px). Outside the image the edge goes on, without slope across it; `None` where `p` is not a
    /// number.
    pub fn mixed(&self, p: &Point2, weights: &[f64; 3]) -> Option<(f64, Vector2)> {
        let FourPixels { inside, pixels, between: [u, v] } = self.around(p)?;
        let at = |pixel: &[f32; 3]| -> f64 {
            weights.iter().zip(pixel).map(|(w, &c)| w * f64::from(c)).sum()
        };
        let [a, b, c, d] = pixels.map(at);
        let value = (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d);
        let slope = |outside: bool, slope: f64| if outside { 0.0 } else { slope };
        let gradient = Vector2::new(
            slope(p.x != inside.x, (1.0 - v) * (b - a) + v * (d - c)),
            slope(p.y != inside.y, (1.0 - u) * (c - a) + u * (d - b)),
        );
        Some((value, gradient))
    }

    /// Bilinear value of every channel; outside the image and for no number as [`mixed`](Self::mixed).
    pub fn sampled(&self, p: &Point2) -> Option<[f64; 3]> {
        let FourPixels { pixels: [a, b, c, d], between: [u, v], .. } = self.around(p)?;
        Some(std::array::from_fn(|k| {
            let [a, b, c, d] = [a, b, c, d].map(|pixel| f64::from(pixel[k]));
            (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d)
        }))
    }

    fn around(&self, p: &Point2) -> Option<FourPixels<'_>> {
        let [w, h] = self.size.map(|n| n as f64 - 1.0);
        let inside = Point2::new(p.x.clamp(0.0, w), p.y.clamp(0.0, h));
        if inside.x.is_nan() || inside.y.is_nan() {
            return None;
        }
        let [width, height] = self.size;
        let (x, y) = (inside.x as usize, inside.y as usize);
        let (x, y) = (x.min(width.saturating_sub(2)), y.min(height.saturating_sub(2)));
        let (right, below) = ((x + 1).min(width - 1), (y + 1).min(height - 1));
        let at = |x: usize, y: usize| &self.data[y * width + x];
        let pixels = [at(x, y), at(right, y), at(x, below), at(right, below)];
        Some(FourPixels { inside, pixels, between: [inside.x - x as f64, inside.y - y as f64] })
    }

    /// Channel `c` (0 red, 1 green, 2 blue).
    pub fn channel(&self, c: usize) -> Plane {
        Plane { size: self.size, data: self.data.iter().map(|p| p[c]).collect() }
    }
}

impl Plane {
    /// A plane of one value.
    pub fn filled(size: [usize; 2], value: f32) -> Self {
        Self { size, data: vec![value; size[0] * size[1]] }
    }

    /// Value at column `x`, row `y`.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.size[0] + x]
    }

    /// Bilinear value at a sub-pixel position and its gradient (per px), exact for the bilinear
    /// interpolant; `None` outside the rectangle of pixel centres.
    pub fn sample(&self, p: &Point2) -> Option<(f64, Vector2)> {
        let [w, h] = self.size;
        if !(p.x >= 0.0 && p.y >= 0.0 && p.x <= (w as f64 - 1.0) && p.y <= (h as f64 - 1.0)) {
            return None;
        }
        let (x0, y0) =
            ((p.x as usize).min(w.saturating_sub(2)), (p.y as usize).min(h.saturating_sub(2)));
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let (u, v) = (p.x - x0 as f64, p.y - y0 as f64);
        let (a, b) = (self.at(x0, y0) as f64, self.at(x1, y0) as f64);
        let (c, d) = (self.at(x0, y1) as f64, self.at(x1, y1) as f64);
        let value = (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d);
        let gradient =
            Vector2::new((1.0 - v) * (b - a) + v * (d - c), (1.0 - u) * (c - a) + u * (d - b));
        Some((value, gradient))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_reproduces_a_plane_and_its_slope() {
        let size = [5, 4];
        let data = (0..20).map(|i| 2.0 * (i % 5) as f32 - 3.0 * (i / 5) as f32).collect();
        let plane = Plane { size, data };
        let (value, gradient) = plane.sample(&Point2::new(1.25, 2.5)).unwrap();
        assert!((value - (2.5 - 7.5)).abs() < 1e-6);
        assert!((gradient - Vector2::new(2.0, -3.0)).norm() < 1e-6);
        assert!(plane.sample(&Point2::new(4.001, 0.0)).is_none());
        let data = plane.data.iter().map(|&v| [0.5 * v, 0.0, v]).collect();
        let image = ColorImage { size, data };
        let (value, gradient) = image.mixed(&Point2::new(7.0, 1.0), &[2.0, 9.0, -3.0]).unwrap();
        // The edge shows 5 in blue; there is no slope across it.
        assert!((value + 10.0).abs() < 1e-6 && (gradient - Vector2::new(0.0, 6.0)).norm() < 1e-6);
        assert!(image.mixed(&Point2::new(f64::NAN, 0.0), &[1.0; 3]).is_none());
        // 2.5 − 7.5 between pixels, and 5 at the edge.
        assert_eq!(image.sampled(&Point2::new(1.25, 2.5)), Some([-2.5, 0.0, -5.0]));
        assert_eq!(image.sampled(&Point2::new(7.0, 1.0)), Some([2.5, 0.0, 5.0]));
        assert!(image.sampled(&Point2::new(0.0, f64::NAN)).is_none());
        assert!(plane.sample(&Point2::new(f64::NAN, 0.0)).is_none());
    }
}
