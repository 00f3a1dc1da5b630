//! Boolean images.

/// A boolean image, row major; what `true` means is said where the mask is used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Width and height in px.
    pub size: [usize; 2],
    /// `size[0] * size[1]` values.
    pub data: Vec<bool>,
}

impl Mask {
    /// A mask of one value.
    pub fn filled(size: [usize; 2], value: bool) -> Self {
        Self { size, data: vec![value; size[0] * size[1]] }
    }

    /// Value at column `x`, row `y`.
    pub fn at(&self, x: usize, y: usize) -> bool {
        self.data[y * self.size[0] + x]
    }

    /// Value at the nearest pixel; `false` outside the image.
    pub fn at_pixel(&self, p: &crate::geometry::Point2) -> bool {
        let (x, y) = (p.x.round(), p.y.round());
        x >= 0.0
            && y >= 0.0
            && x < self.size[0] as f64
            && y < self.size[1] as f64
            && self.at(x as usize, y as usize)
    }

    /// Fraction of `true` pixels.
    pub fn coverage(&self) -> f64 {
        self.data.iter().filter(|&&v| v).count() as f64 / self.data.len().max(1) as f64
    }
}
