//! Polygons as masks.

use super::Mask;
use crate::geometry::Point2;

impl Mask {
    /// `true` at pixel centres inside a polygon (even-odd rule; px, pixel centres at integers). The
    /// last corner is joined to the first.
    pub fn polygon(size: [usize; 2], corners: &[Point2]) -> Self {
        let mut mask = Self::filled(size, false);
        for y in 0..size[1] {
            let crossings = crossings(corners, y as f64);
            for pair in crossings.chunks_exact(2) {
                let (from, to) = (pair[0].ceil().max(0.0), pair[1].min(size[0] as f64 - 1.0));
                for x in from as usize..=to.max(-1.0) as usize {
                    // An empty span casts to 0..=0.
                    mask.data[y * size[0] + x] |= (pair[0]..=pair[1]).contains(&(x as f64));
                }
            }
        }
        mask
    }
}

/// Where the outline crosses a row, ascending; an even number.
fn crossings(corners: &[Point2], y: f64) -> Vec<f64> {
    let next = corners.iter().cycle().skip(1);
    let crossing = |(a, b): (&Point2, &Point2)| {
        // Half open, so that a corner on the row counts once.
        let crosses = (a.y <= y) != (b.y <= y);
        crosses.then(|| a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x))
    };
    let mut out: Vec<f64> = corners.iter().zip(next).filter_map(crossing).collect();
    out.sort_by(f64::total_cmp);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_and_a_polygon_past_the_border() {
        let p = |x: f64, y: f64| Point2::new(x, y);
        let mask = Mask::polygon([6, 5], &[p(0.5, 0.5), p(4.5, 0.5), p(0.5, 4.5)]);
        // Rows 1 to 4: x + y < 5 inside the left and upper sides.
        let expected = |x: usize, y: usize| x >= 1 && y >= 1 && x + y <= 5;
        for i in 0..30 {
            assert_eq!(mask.data[i], expected(i % 6, i / 6), "{},{}", i % 6, i / 6);
        }
        let all =
            Mask::polygon([6, 5], &[p(-9.0, -9.0), p(99.0, -9.0), p(99.0, 99.0), p(-9.0, 99.0)]);
        assert_eq!(all.coverage(), 1.0);
        let beside = Mask::polygon([6, 5], &[p(-9.0, 0.0), p(-2.0, 0.0), p(-2.0, 4.0)]);
        assert_eq!(beside.coverage(), 0.0);
    }
}
