//! Values stored on the surface itself: every face carries its own triangular lattice of texels,
//! so no UV chart, seam or cut stands between an image and the albedo (cf. Yuksel et al. 2010,
//! "Mesh colors").

/// RGB values on a lattice of `r²` equal sub-triangles per face.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceTexels {
    /// Subdivisions `r` of every face's edges, at least 1.
    pub resolution: Vec<u16>,
    /// Index of the first texel of every face, and the total count last.
    pub offset: Vec<u32>,
    /// Linear RGB per texel.
    pub value: Vec<[f32; 3]>,
    /// Standard deviation of the grey value across views, linear units; NaN where never observed.
    pub spread: Vec<f32>,
    /// Number of views that contributed; 0 = filled in from neighbours.
    pub views: Vec<u16>,
}

impl SurfaceTexels {
    /// Empty (black, never observed) texels for faces of the given resolutions.
    pub fn new(resolution: Vec<u16>) -> Self {
        let mut offset = vec![0u32];
        for &r in &resolution {
            offset.push(offset[offset.len() - 1] + r as u32 * r as u32);
        }
        let n = offset[resolution.len()] as usize;
        Self {
            resolution,
            offset,
            value: vec![[0.0; 3]; n],
            spread: vec![f32::NAN; n],
            views: vec![0; n],
        }
    }

    /// Texel that holds a point of a face.
    pub fn index(&self, face: usize, barycentric: [f64; 3]) -> usize {
        self.offset[face] as usize + place(self.resolution[face], barycentric)
    }

    /// Mean of what was observed at points of a face (nearest texels); NaN where nothing was.
    pub(crate) fn observed_mean(&self, face: usize, points: [[f64; 3]; 4]) -> [f32; 3] {
        let (first, resolution) = (self.offset[face] as usize, self.resolution[face]);
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for texel in points.map(|b| first + place(resolution, b)) {
            if self.views[texel] > 0 {
                sum.iter_mut().zip(self.value[texel]).for_each(|(sum, v)| *sum += v);
                count += 1.0;
            }
        }
        sum.map(|sum| sum / count)
    }

    /// Barycentrics of the centre of every texel of a face, in storage order.
    pub fn centres(&self, face: usize) -> impl Iterator<Item = [f64; 3]> + use<> {
        let r = self.resolution[face] as usize;
        (0..r).flat_map(move |i| {
            (0..2 * (r - i) - 1).map(move |k| {
                let (j, third) = (k / 2, if k % 2 == 0 { 1.0 } else { 2.0 } / 3.0);
                let (b1, b2) = ((i as f64 + third) / r as f64, (j as f64 + third) / r as f64);
                [1.0 - b1 - b2, b1, b2]
            })
        })
    }

    /// Value at a point of a face (nearest texel).
    pub fn at(&self, face: usize, barycentric: [f64; 3]) -> [f32; 3] {
        self.value[self.index(face, barycentric)]
    }
}

/// Which of its face's texels holds a point.
fn place(resolution: u16, barycentric: [f64; 3]) -> usize {
    let r = u32::from(resolution);
    let [x, y] = [1, 2].map(|k| barycentric[k].max(0.0) * f64::from(r));
    let i = (x as u32).min(r - 1);
    let j = (y as u32).min(r - 1 - i);
    let upper = (x - f64::from(i)) + (y - f64::from(j)) > 1.0 && i + j + 1 < r;
    // Row i holds 2(r−i)−1 sub-triangles: upright at even, inverted at odd places.
    (2 * r * i - i * i + 2 * j + u32::from(upper)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_centre_maps_to_its_own_texel() {
        let texels = SurfaceTexels::new(vec![1, 4, 7]);
        let mut next = 0;
        for face in 0..3 {
            for b in texels.centres(face) {
                assert_eq!(texels.index(face, b), next);
                assert!(b.iter().all(|&x| x > 0.0) && (b.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                next += 1;
            }
        }
        assert_eq!(next, texels.value.len());
    }

    #[test]
    fn means_are_of_what_was_observed() {
        let mut texels = SurfaceTexels::new(vec![1, 2]);
        let centres: Vec<[f64; 3]> = texels.centres(1).collect();
        for (k, b) in centres.iter().enumerate() {
            let at = texels.index(1, *b);
            (texels.value[at], texels.views[at]) = ([k as f32, 1.0, 0.5], u16::from(k > 0));
        }
        let points = [centres[0], centres[1], centres[3], centres[3]];
        assert_eq!(texels.observed_mean(1, points), [7.0 / 3.0, 1.0, 0.5]);
        assert!(texels.observed_mean(1, [centres[0]; 4])[0].is_nan());
    }
}
