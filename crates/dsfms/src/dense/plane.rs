//! Slanted planes in inverse depth.
//!
//! A plane `n·X = d` seen through a pinhole has inverse depth affine in the pixel:
//! `1/z(u + δu, v + δv) = w + a δu + b δv`. Handing a plane to a neighbour is one addition.

/// Correlation cost of a view that cannot be compared.
pub(super) const NONE: f32 = 2.0;
/// Every source.
pub(super) const ALL: u16 = u16::MAX;

/// Inverse depth and its slope per pixel of the grid it lives on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct InversePlane {
    /// Inverse depth at the pixel; not positive = none.
    pub w: f32,
    /// `∂w/∂u`, per px.
    pub a: f32,
    /// `∂w/∂v`, per px.
    pub b: f32,
}

impl InversePlane {
    /// Inverse depth `(du, dv)` px away.
    pub(super) fn at(&self, du: f32, dv: f32) -> f32 {
        self.w + self.a * du + self.b * dv
    }

    /// The same plane seen from the pixel `(du, dv)` away.
    pub(super) fn moved(&self, du: f32, dv: f32) -> Self {
        Self { w: self.at(du, dv), ..*self }
    }

    /// Unit normal towards the camera for a pinhole `[fx, fy, cx, cy]` at pixel `(u, v)`.
    ///
    /// With `w(u, v) = (n·ray)/d`, `ray = ((u-cx)/fx, (v-cy)/fy, 1)`:
    /// `n/d = (a fx, b fy, w - a fx x - b fy y)`.
    pub(super) fn normal(&self, k: [f32; 4], u: f32, v: f32) -> [f32; 3] {
        let [fx, fy, cx, cy] = k;
        let (nx, ny) = (self.a * fx, self.b * fy);
        let nz = self.w - self.a * (u - cx) - self.b * (v - cy);
        let length = -(nx * nx + ny * ny + nz * nz).sqrt();
        [nx / length, ny / length, nz / length]
    }

    /// The plane of inverse depth `w` at `(u, v)` with normal `n` (any length, not across the ray).
    pub(super) fn from_normal(w: f32, n: [f32; 3], k: [f32; 4], u: f32, v: f32) -> Self {
        let [fx, fy, cx, cy] = k;
        let along = n[0] * (u - cx) / fx + n[1] * (v - cy) / fy + n[2];
        Self { w, a: w * n[0] / (fx * along), b: w * n[1] / (fy * along) }
    }

    /// Cosine of the angle between the normal and the sightline.
    pub(super) fn facing(&self, k: [f32; 4], u: f32, v: f32) -> f32 {
        let n = self.normal(k, u, v);
        let (x, y) = ((u - k[2]) / k[0], (v - k[3]) / k[1]);
        -(n[0] * x + n[1] * y + n[2]) / (x * x + y * y + 1.0).sqrt()
    }
}

/// Planes of one frame on a grid, with what is known of their quality.
#[derive(Clone, Debug, Default)]
pub(super) struct Field {
    /// Width and height, px.
    pub size: [usize; 2],
    /// One plane a pixel, row major.
    pub planes: Vec<InversePlane>,
    /// `1 - correlation`, mean over the best views; 2 = none.
    pub cost: Vec<f32>,
    /// Standard deviation of `w`; infinity = unknown.
    pub sigma: Vec<f32>,
    /// Sources worth comparing at each pixel, one bit each; see [`ALL`].
    pub sources: Vec<u16>,
}

impl Field {
    /// Planes without a score yet.
    pub(super) fn new(size: [usize; 2], planes: Vec<InversePlane>) -> Self {
        let n = planes.len();
        let sources = vec![ALL; n];
        Self { size, planes, cost: vec![NONE; n], sigma: vec![f32::INFINITY; n], sources }
    }

    /// The same planes on a grid of twice the resolution.
    pub(super) fn upsampled(&self, size: [usize; 2]) -> Self {
        let [w, h] = self.size;
        let (planes, sources) = (0..size[0] * size[1])
            .map(|i| {
                let (x, y) = (i % size[0], i / size[0]);
                let (cx, cy) = ((x / 2).min(w - 1), (y / 2).min(h - 1));
                let p = self.planes[cy * w + cx];
                // Fine pixel x has the coarse coordinate (x - 0.5) / 2.
                let (du, dv) =
                    ((x as f32 - 0.5) / 2.0 - cx as f32, (y as f32 - 0.5) / 2.0 - cy as f32);
                let plane = InversePlane { w: p.at(du, dv), a: 0.5 * p.a, b: 0.5 * p.b };
                (plane, self.sources[cy * w + cx])
            })
            .unzip();
        Self { sources, ..Self::new(size, planes) }
    }
}

/// Uniform numbers that depend on nothing but the seed and the place (splitmix64).
pub(super) struct Noise(u64);

impl Noise {
    /// A stream for one pixel of one round.
    pub(super) fn new(seed: u64, round: u64, pixel: u64) -> Self {
        let mut noise = Self(seed ^ round.wrapping_mul(0xd1b5_4a32_d192_ed03) ^ (pixel << 20));
        noise.next();
        noise
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `[-1, 1)`.
    pub(super) fn signed(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    /// Uniform in `[0, 1)`.
    pub(super) fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1u64 << 24) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_and_plane_invert_each_other() {
        let k = [500.0, 510.0, 320.0, 240.0];
        let n = [0.3f32, -0.2, -0.9327379];
        let plane = InversePlane::from_normal(0.02, n, k, 100.0, 300.0);
        let back = plane.normal(k, 100.0, 300.0);
        (0..3).for_each(|i| assert!((back[i] - n[i]).abs() < 1e-4, "{back:?}"));
        // Elsewhere on the plane: n·X keeps its value.
        let depth = |u: f32, v: f32| 1.0 / plane.at(u - 100.0, v - 300.0);
        let along = |u: f32, v: f32| {
            depth(u, v) * (n[0] * (u - 320.0) / 500.0 + n[1] * (v - 240.0) / 510.0 + n[2])
        };
        assert!((along(100.0, 300.0) / along(400.0, 50.0) - 1.0).abs() < 1e-4);
    }

    #[test]
    fn upsampling_keeps_the_plane() {
        let plane = |x: usize, y: usize| InversePlane {
            w: 1.0 + 0.1 * x as f32 + 0.2 * y as f32,
            a: 0.1,
            b: 0.2,
        };
        let coarse = Field::new([3, 2], (0..6).map(|i| plane(i % 3, i / 3)).collect());
        let fine = coarse.upsampled([6, 4]);
        let p = fine.planes[2 * 6 + 5];
        assert!((p.w - (1.0 + 0.1 * 2.25 + 0.2 * 0.75)).abs() < 1e-6);
        assert!((p.a - 0.05).abs() < 1e-7);
    }
}
