//! Where a place lies among the pixels, for every kind of image alike.

use super::within_centres;
use crate::geometry::{Point2, Vector2};

/// The four pixels about a place.
pub(crate) struct Bilinear {
    /// Their indices, row by row.
    pub(crate) pixels: [usize; 4],
    /// From the first towards the others, px.
    between: [f64; 2],
}

impl Bilinear {
    /// `None` outside the pixel centres.
    #[inline]
    pub(crate) fn at(p: &Point2, size: [usize; 2]) -> Option<Self> {
        if !within_centres(p, size) {
            return None;
        }
        let [w, h] = size;
        let (x, y) =
            ((p.x as usize).min(w.saturating_sub(2)), (p.y as usize).min(h.saturating_sub(2)));
        let (right, below) = ((x + 1).min(w - 1), (y + 1).min(h - 1));
        let pixels = [y * w + x, y * w + right, below * w + x, below * w + right];
        Some(Self { pixels, between: [p.x - x as f64, p.y - y as f64] })
    }

    /// The value between the four.
    #[inline]
    pub(crate) fn value(&self, [a, b, c, d]: [f64; 4]) -> f64 {
        let [u, v] = self.between;
        (1.0 - v) * ((1.0 - u) * a + u * b) + v * ((1.0 - u) * c + u * d)
    }

    /// The slope between the four, per px.
    #[inline]
    pub(crate) fn slope(&self, [a, b, c, d]: [f64; 4]) -> Vector2 {
        let [u, v] = self.between;
        Vector2::new((1.0 - v) * (b - a) + v * (d - c), (1.0 - u) * (c - a) + u * (d - b))
    }

    /// The colour between the four, from that of a pixel.
    pub(crate) fn colour<T: Into<f64>>(&self, of: impl Fn(usize) -> [T; 3]) -> [f64; 3] {
        let four = self.pixels.map(|i| of(i).map(Into::into));
        [0, 1, 2].map(|c| self.value(four.map(|pixel| pixel[c])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_by_hand() {
        let rgb = [[0u8, 40, 80], [100, 40, 80], [200, 0, 80], [60, 0, 180]];
        let at = |x, y| Bilinear::at(&Point2::new(x, y), [2, 2]).map(|b| b.colour(|i| rgb[i]));
        assert_eq!(at(0.25, 0.0), Some([25.0, 40.0, 80.0]));
        assert_eq!(at(0.25, 0.75), Some([130.0, 10.0, 98.75]));
        assert_eq!(at(1.0, 1.0), Some([60.0, 0.0, 180.0]));
        assert_eq!(at(1.01, 1.0), None);
        assert_eq!(at(0.5, -0.01), None);
        assert_eq!(at(f64::NAN, 0.0), None);
    }

    #[test]
    fn a_row_and_a_column_of_one_pixel() {
        let row = Bilinear::at(&Point2::new(1.5, 0.0), [3, 1]).unwrap();
        assert_eq!((row.pixels, row.value([0.0, 4.0, 0.0, 4.0])), ([1, 2, 1, 2], 2.0));
        let column = Bilinear::at(&Point2::new(0.0, 2.0), [1, 3]).unwrap();
        assert_eq!((column.pixels, column.value([0.0, 0.0, 4.0, 4.0])), ([1, 1, 2, 2], 4.0));
    }
}
