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
        super::nearest_pixel(p, self.size).is_some_and(|[x, y]| self.at(x, y))
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
pub(super) mod tests {
    use super::*;

    pub(in crate::image) fn disc(radius: f64) -> Mask {
        let inside = |i: usize| ((i % 41) as f64 - 20.0).hypot((i / 41) as f64 - 20.0) <= radius;
        Mask { size: [41, 41], data: (0..41 * 41).map(inside).collect() }
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
