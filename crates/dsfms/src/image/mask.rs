//! Boolean images and their morphology.

use super::distance::distance_to;

/// Pixels that a stamp fills in the time in which the distance transform sees one.
const TRANSFORM: usize = 20;

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

    /// `true` where this mask is `false`.
    pub fn complement(&self) -> Self {
        Self { size: self.size, data: self.data.iter().map(|v| !v).collect() }
    }

    /// `true` where both are.
    ///
    /// # Panics
    /// If the sizes differ, as in the other operations on two masks.
    pub fn and(&self, other: &Self) -> Self {
        self.combine(other, |a, b| a && b)
    }

    /// `true` where either is.
    pub fn or(&self, other: &Self) -> Self {
        self.combine(other, |a, b| a || b)
    }

    /// `true` where this mask is and the other is not.
    pub fn minus(&self, other: &Self) -> Self {
        self.combine(other, |a, b| a && !b)
    }

    fn combine(&self, other: &Self, f: impl Fn(bool, bool) -> bool) -> Self {
        assert_eq!(self.size, other.size, "masks differ in size");
        let data = self.data.iter().zip(&other.data).map(|(&a, &b)| f(a, b)).collect();
        Self { size: self.size, data }
    }

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

    /// The largest 4-connected component; the first in row order when several are equal, empty
    /// when the mask is.
    pub fn largest_component(&self) -> Self {
        let mut seen = self.complement().data;
        let mut largest = Vec::new();
        for start in 0..seen.len() {
            if seen[start] {
                continue;
            }
            let component = self.flood(start, &mut seen);
            if component.len() > largest.len() {
                largest = component;
            }
        }
        let mut out = Self::filled(self.size, false);
        largest.into_iter().for_each(|i| out.data[i] = true);
        out
    }

    /// Unseen pixels 4-connected to `start`, marked as seen.
    fn flood(&self, start: usize, seen: &mut [bool]) -> Vec<usize> {
        let [w, h] = self.size;
        let mut component = vec![start];
        seen[start] = true;
        let mut next = 0;
        while let Some(&i) = component.get(next) {
            next += 1;
            let (x, y) = (i % w, i / w);
            let inside = [(x > 0, i.wrapping_sub(1)), (x + 1 < w, i + 1)];
            let around = [(y > 0, i.wrapping_sub(w)), (y + 1 < h, i + w)];
            for (_, j) in inside.into_iter().chain(around).filter(|(inside, _)| *inside) {
                if !seen[j] {
                    seen[j] = true;
                    component.push(j);
                }
            }
        }
        component
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(radius: f64) -> Mask {
        let inside = |i: usize| ((i % 41) as f64 - 20.0).hypot((i / 41) as f64 - 20.0) <= radius;
        Mask { size: [41, 41], data: (0..41 * 41).map(inside).collect() }
    }

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

    #[test]
    fn boolean_operations() {
        let (small, large) = (disc(5.0), disc(9.0));
        assert_eq!(small.and(&large), small);
        assert_eq!(small.or(&large), large);
        assert_eq!(small.minus(&large).coverage(), 0.0);
        assert_eq!(large.minus(&small).or(&small), large);
    }

    #[test]
    fn the_largest_component_wins() {
        let mut mask = disc(6.0);
        mask.data[0] = true;
        mask.data[1] = true;
        assert_eq!(mask.largest_component(), disc(6.0));
        assert_eq!(Mask::filled([3, 2], false).largest_component().coverage(), 0.0);
    }
}
