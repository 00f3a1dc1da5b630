//! Pixel regions derived from a raster: depth discontinuities, and distances to a region.

use super::Raster;
use crate::image::Mask;

impl Raster {
    /// `true` at surface pixels on a predicted contour: next to (4-neighbourhood) a pixel without
    /// surface, or next to one whose depth differs by more than `relative_jump` times their mean.
    ///
    /// A jump of 0.02 per pixel also marks surface seen at more than about 85 degrees.
    pub fn discontinuities(&self, relative_jump: f64) -> Mask {
        let [w, h] = self.size;
        let breaks = |a: f64, b: f64| {
            a.is_finite() && (!b.is_finite() || (a - b).abs() > relative_jump * 0.5 * (a + b))
        };
        let mut mask = Mask::filled(self.size, false);
        for y in 0..h {
            for x in 0..w {
                let i = y * w + x;
                let d = self.depth[i];
                mask.data[i] = (x > 0 && breaks(d, self.depth[i - 1]))
                    || (x + 1 < w && breaks(d, self.depth[i + 1]))
                    || (y > 0 && breaks(d, self.depth[i - w]))
                    || (y + 1 < h && breaks(d, self.depth[i + w]));
            }
        }
        mask
    }
}

/// Distance in px from every pixel to the nearest `true` pixel (0 there, infinity when there is
/// none), by the 3-4 chamfer transform: within 8 % of the Euclidean distance, linear time.
pub fn distance_to(mask: &Mask) -> Vec<f32> {
    let [w, h] = mask.size;
    let mut d: Vec<f32> = mask.data.iter().map(|&m| if m { 0.0 } else { f32::INFINITY }).collect();
    let (side, corner) = (1.0, 4.0 / 3.0);
    for i in 0..w * h {
        relax(&mut d, [w, h], i, [(-1, 0, side), (0, -1, side), (-1, -1, corner), (1, -1, corner)]);
    }
    for i in (0..w * h).rev() {
        relax(&mut d, [w, h], i, [(1, 0, side), (0, 1, side), (1, 1, corner), (-1, 1, corner)]);
    }
    d
}

fn relax(d: &mut [f32], [w, h]: [usize; 2], i: usize, steps: [(isize, isize, f32); 4]) {
    let (x, y) = ((i % w) as isize, (i / w) as isize);
    for (dx, dy, length) in steps {
        let (nx, ny) = (x + dx, y + dy);
        if nx >= 0 && ny >= 0 && nx < w as isize && ny < h as isize {
            d[i] = d[i].min(d[ny as usize * w + nx as usize] + length);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_by_hand() {
        let mut mask = Mask::filled([5, 4], false);
        assert!(distance_to(&mask).iter().all(|d| d.is_infinite()));
        mask.data[5] = true; // column 0, row 1
        let d = distance_to(&mask);
        assert_eq!([d[5], d[6], d[9], d[0]], [0.0, 1.0, 4.0, 1.0]);
        assert!((d[12] - (4.0 / 3.0 + 1.0)).abs() < 1e-6, "two right, one down");
    }

    #[test]
    fn contours_and_jumps_are_marked_on_the_surface_only() {
        let inf = f64::INFINITY;
        let depth = vec![inf, 10.0, 10.1, 20.0, 20.1, 20.2];
        let n = depth.len();
        let raster =
            Raster { size: [n, 1], face: vec![0; n], barycentric: vec![[1.0, 0.0, 0.0]; n], depth };
        let expected = [false, true, true, true, false, false];
        assert_eq!(raster.discontinuities(0.02).data, expected);
    }
}
