//! Pixel regions derived from a raster: predicted contours.

use super::Raster;
use crate::image::Mask;
use rayon::prelude::*;

impl Raster {
    /// `true` at surface pixels on a predicted contour: next to (4-neighbourhood) a pixel without
    /// surface, or next to one whose depth differs by more than `relative_jump` times their mean.
    ///
    /// A jump of 0.02 per pixel also marks surface seen at more than about 85 degrees.
    pub(crate) fn discontinuities(&self, relative_jump: f64) -> Mask {
        let [w, h] = self.size;
        let breaks = |a: f64, b: f64| {
            a.is_finite() && (!b.is_finite() || (a - b).abs() > relative_jump * 0.5 * (a + b))
        };
        let mut mask = Mask::filled(self.size, false);
        mask.data.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, row)| {
            for (x, here) in row.iter_mut().enumerate() {
                let i = y * w + x;
                let d = self.depth[i];
                *here = (x > 0 && breaks(d, self.depth[i - 1]))
                    || (x + 1 < w && breaks(d, self.depth[i + 1]))
                    || (y > 0 && breaks(d, self.depth[i - w]))
                    || (y + 1 < h && breaks(d, self.depth[i + w]));
            }
        });
        mask
    }
}

/// Distance in px from every pixel to the nearest `true` pixel, row major; see
/// [`crate::image::distance::distance_to`].
pub fn distance_to(mask: &Mask) -> Vec<f32> {
    crate::image::distance::distance_to(mask).data
}

#[cfg(test)]
mod tests {
    use super::*;

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
