//! The template's albedo at several resolutions: an image of few pixels sees means of texels.

use crate::image::LUMA;
use crate::template::SurfaceTexels;

/// Halvings of the texels' resolution.
const LEVELS: usize = 4;

/// The albedo, fine to coarse.
pub(super) struct Mips {
    levels: Vec<MipLevel>,
    /// Texels along an edge of a face at the finest level, on average.
    along_edge: f64,
}

/// One resolution.
pub(super) struct MipLevel {
    pub(super) texels: SurfaceTexels,
    /// Weighted sum of the square roots of the channels; NaN where never observed.
    pub(super) bright: Vec<f32>,
}

impl MipLevel {
    fn new(texels: SurfaceTexels) -> Self {
        let bright = |(rgb, &views): (&[f32; 3], &u16)| {
            let sum: f32 = (0..3).map(|c| LUMA[c] * rgb[c].max(0.0).sqrt()).sum();
            if views > 0 { sum } else { f32::NAN }
        };
        let bright = texels.value.iter().zip(&texels.views).map(bright).collect();
        Self { texels, bright }
    }
}

impl Mips {
    pub(super) fn new(albedo: &SurfaceTexels) -> Self {
        let mut levels = vec![MipLevel::new(albedo.clone())];
        while levels.len() < LEVELS {
            levels.push(MipLevel::new(halved(&levels[levels.len() - 1].texels)));
        }
        let faces = albedo.resolution.len().max(1);
        Self { levels, along_edge: (albedo.value.len() as f64 / faces as f64).sqrt() }
    }

    /// The level whose texels are about a pixel wide where an edge of a face has so many pixels.
    pub(super) fn for_edge(&self, px: f64) -> &MipLevel {
        let level = (self.along_edge / px.max(1e-3)).log2().round().max(0.0) as usize;
        &self.levels[level.min(self.levels.len() - 1)]
    }
}

/// Half the resolution, every texel the mean of those observed whose centres it holds.
fn halved(fine: &SurfaceTexels) -> SurfaceTexels {
    let mut coarse = SurfaceTexels::new(fine.resolution.iter().map(|r| r.div_ceil(2)).collect());
    let mut sums = vec![([0.0; 3], 0.0); coarse.value.len()];
    let mut filled = vec![([0.0; 3], 0.0); coarse.value.len()];
    for face in 0..fine.resolution.len() {
        for (at, b) in (fine.offset[face] as usize..).zip(fine.centres(face)) {
            let to = coarse.index(face, b);
            let sum = if fine.views[at] > 0 { &mut sums[to] } else { &mut filled[to] };
            (0..3).for_each(|c| sum.0[c] += fine.value[at][c]);
            sum.1 += 1.0;
            coarse.views[to] = coarse.views[to].max(fine.views[at]);
        }
    }
    for (to, (observed, filled)) in coarse.value.iter_mut().zip(sums.iter().zip(&filled)) {
        let (sum, count) = if observed.1 > 0.0 { *observed } else { *filled };
        *to = sum.map(|v| v / f32::max(count, 1.0));
    }
    coarse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_texels_are_means_of_what_was_observed() {
        let mut fine = SurfaceTexels::new(vec![4, 1]);
        for (k, value) in fine.value.iter_mut().enumerate() {
            *value = [k as f32, 1.0, 0.25];
        }
        fine.views.fill(2);
        fine.views[0] = 0;
        let mips = Mips::new(&fine);
        let coarse = &mips.levels[1].texels;
        assert_eq!(coarse.resolution, [2, 1]);
        // Without the first, the texels of the corner are 1, 2 and the first of the second row.
        let corner: Vec<f32> = (fine.centres(0).zip(&fine.value))
            .filter(|(b, _)| coarse.index(0, *b) == 0)
            .map(|(_, v)| v[0])
            .filter(|v| *v > 0.0)
            .collect();
        assert_eq!(corner.len(), 3);
        assert!((coarse.value[0][0] - corner.iter().sum::<f32>() / 3.0).abs() < 1e-6);
        assert!(coarse.value.iter().all(|v| (v[2] - 0.25).abs() < 1e-6));
        assert!(mips.levels[0].bright[0].is_nan() && mips.levels[1].bright[0] > 0.0);
        let texels = |px: f64| mips.for_edge(px).texels.resolution[0];
        assert_eq!((texels(10.0), texels(0.9)), (4, 1));
    }
}
