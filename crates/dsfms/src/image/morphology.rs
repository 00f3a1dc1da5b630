//! Masks grown and shrunk.

use super::Mask;
use super::distance::distance_to;

/// Pixels that a stamp fills in the time in which the distance transform sees one.
const TRANSFORM: usize = 20;

impl Mask {
    /// Grown by `radius` px: `true` within that Euclidean distance of a `true` pixel centre.
    pub fn dilate(&self, radius: f64) -> Self {
        if !self.data.contains(&true) {
            return self.clone();
        }
        let outline: Vec<usize> = (0..self.data.len()).filter(|&i| self.on_outline(i)).collect();
        let stamp = (std::f64::consts::PI * radius * radius) as usize;
        if outline.len().saturating_mul(stamp) < TRANSFORM * self.data.len() {
            return self.stamped(&outline, radius);
        }
        let distance = distance_to(self);
        let near = |(&d, &own): (&f32, &bool)| own || d as f64 <= radius;
        let data = distance.data.iter().zip(&self.data).map(near).collect();
        Self { size: self.size, data }
    }

    /// `true` next to a pixel that is not, or to the border of the image.
    fn on_outline(&self, i: usize) -> bool {
        if !self.data[i] {
            return false;
        }
        let [w, h] = self.size;
        let (x, y) = (i % w, i / w);
        let inner = || x > 0 && y > 0 && x + 1 < w && y + 1 < h;
        let alone = |i: &usize| !self.data[*i];
        !inner() || [i - 1, i + 1, i - w, i + w].iter().any(alone)
    }

    /// With a disc about every pixel of the outline.
    fn stamped(&self, outline: &[usize], radius: f64) -> Self {
        let mut grown = self.clone();
        let [w, h] = self.size;
        let reach = radius.floor() as usize;
        let half = |dy: usize| (radius * radius - (dy * dy) as f64).sqrt() as usize;
        let halves: Vec<usize> = (0..=reach).map(half).collect();
        for &i in outline {
            let (x, y) = (i % w, i / w);
            for row in y.saturating_sub(reach)..(y + reach + 1).min(h) {
                let half = halves[row.abs_diff(y)];
                grown.data[row * w..][x.saturating_sub(half)..(x + half + 1).min(w)].fill(true);
            }
        }
        grown
    }

    /// Shrunk by `radius` px; the border of the image takes nothing away.
    pub fn erode(&self, radius: f64) -> Self {
        self.complement().dilate(radius).complement()
    }
}

#[cfg(test)]
mod tests {
    use super::super::mask::tests::disc;
    use super::*;

    #[test]
    fn dilation_of_a_point_is_a_disc() {
        let point = disc(0.0);
        assert_eq!(point.dilate(7.3), disc(7.3));
        assert_eq!(disc(3.0).dilate(f64::MAX).coverage(), 1.0);
        assert_eq!(disc(9.0).complement().erode(5.0), disc(9.0).dilate(5.0).complement());
        assert_eq!(Mask::filled([4, 4], false).dilate(100.0).coverage(), 0.0);
        assert_eq!(Mask::filled([4, 4], true).erode(100.0).coverage(), 1.0);
    }

    #[test]
    fn stamps_and_the_distance_transform_dilate_alike() {
        let data = (0..83 * 57).map(|i| i * 31 % 397 < 7).collect();
        let mask = Mask { size: [83, 57], data };
        let outline: Vec<usize> = (0..mask.data.len()).filter(|&i| mask.on_outline(i)).collect();
        let distance = distance_to(&mask);
        for radius in [0.0, 1.0, 1.5, 2.3, 5.0, 9.7] {
            let within = distance.data.iter().map(|&d| f64::from(d) <= radius).collect();
            let expected = Mask { size: mask.size, data: within };
            assert_eq!(mask.stamped(&outline, radius), expected, "{radius}");
            assert_eq!(mask.dilate(radius), expected, "{radius}");
        }
    }
}
