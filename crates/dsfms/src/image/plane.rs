//! One- and three-channel images of `f32` with bilinear sampling and its exact gradient.

use super::Bilinear;
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

    /// Bilinear value of a weighted sum of the channels at a sub-pixel position and its gradient
    /// (per px). Outside the image the edge goes on, without slope across it; `None` where `p` is
    /// not a number.
    pub fn mixed(&self, p: &Point2, weights: &[f64; 3]) -> Option<(f64, Vector2)> {
        let (inside, four) = self.around(p)?;
        let at = |pixel: [f32; 3]| -> f64 {
            weights.iter().zip(pixel).map(|(w, c)| w * f64::from(c)).sum()
        };
        let values = four.pixels.map(|i| at(self.data[i]));
        let slope = four.slope(values);
        let within = |outside: bool, slope: f64| if outside { 0.0 } else { slope };
        let gradient =
            Vector2::new(within(p.x != inside.x, slope.x), within(p.y != inside.y, slope.y));
        Some((four.value(values), gradient))
    }

    /// Bilinear value of every channel; outside the image and for no number as
    /// [`mixed`](Self::mixed).
    pub fn sampled(&self, p: &Point2) -> Option<[f64; 3]> {
        Some(self.around(p)?.1.colour(|i| self.data[i]))
    }

    /// The nearest place inside the image, and the pixels about it.
    fn around(&self, p: &Point2) -> Option<(Point2, Bilinear)> {
        let [w, h] = self.size.map(|n| n as f64 - 1.0);
        let inside = Point2::new(p.x.clamp(0.0, w), p.y.clamp(0.0, h));
        Some((inside, Bilinear::at(&inside, self.size)?))
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
        let four = Bilinear::at(p, self.size)?;
        let values = four.pixels.map(|i| f64::from(self.data[i]));
        Some((four.value(values), four.slope(values)))
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
