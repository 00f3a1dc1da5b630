//! Windows warped into another view, eight samples at a time: written so that everything but the
//! loads fills the lanes of a register.

use super::view::Image;

/// Samples at a time.
pub(super) const LANES: usize = 8;

/// One value a sample.
pub(super) type Lanes = [f32; LANES];

/// A homography about the centre of a window: homogeneous image of the centre, and its change per
/// px along u and v.
pub(super) type Warp = [[f32; 3]; 3];

/// Where samples fall in a view, and the four pixels around.
pub(super) struct Samples {
    /// Inverse of the third homogeneous coordinate.
    pub iz: Lanes,
    /// Place in the view, px.
    pub x: Lanes,
    pub y: Lanes,
    /// Place between the four pixels; NaN outside the pixel centres.
    fx: Lanes,
    fy: Lanes,
    /// Upper left and right, lower left and right.
    corners: [Lanes; 4],
}

impl Samples {
    /// Warp the offsets `x`, `y`. The window must [meet](meets) the view.
    #[inline(always)]
    pub(super) fn new(image: &Image, [base, du, dv]: &Warp, x: &Lanes, y: &Lanes) -> Self {
        let [w, h] = image.size;
        let (right, bottom) = ((w - 1) as f32, (h - 1) as f32);
        let zero = [0.0; LANES];
        let mut s = Self { iz: zero, x: zero, y: zero, fx: zero, fy: zero, corners: [zero; 4] };
        let mut index = [0u32; LANES];
        for l in 0..LANES {
            let iz = 1.0 / (base[2] + x[l] * du[2] + y[l] * dv[2]);
            let px = (base[0] + x[l] * du[0] + y[l] * dv[0]) * iz;
            let py = (base[1] + x[l] * du[1] + y[l] * dv[1]) * iz;
            let (column, row) = (floor(between(px, right - 1.0)), floor(between(py, bottom - 1.0)));
            let inside = (px >= 0.0) & (py >= 0.0) & (px <= right) & (py <= bottom);
            s.fx[l] = if inside { px - column } else { f32::NAN };
            s.fy[l] = py - row;
            (s.iz[l], s.x[l], s.y[l]) = (iz, px, py);
            index[l] = integer(row) * w as u32 + integer(column);
        }
        for (l, &at) in index.iter().enumerate() {
            let four = &image.grey[at as usize..][..w + 2];
            s.corners[0][l] = four[0];
            s.corners[1][l] = four[1];
            s.corners[2][l] = four[w];
            s.corners[3][l] = four[w + 1];
        }
        s
    }

    /// Bilinear value of sample `l`; NaN outside the view or next to an unusable pixel.
    #[inline(always)]
    pub(super) fn value(&self, l: usize) -> f32 {
        let (upper, lower) = self.rows(l);
        upper + self.fy[l] * (lower - upper)
    }

    /// Derivative of the value along x and y.
    #[inline(always)]
    pub(super) fn gradient(&self, l: usize) -> [f32; 2] {
        let [a, b, c, d] = &self.corners;
        let (upper, lower) = self.rows(l);
        [(b[l] - a[l]) + self.fy[l] * (d[l] - c[l] - b[l] + a[l]), lower - upper]
    }

    #[inline(always)]
    fn rows(&self, l: usize) -> (f32, f32) {
        let [a, b, c, d] = &self.corners;
        (a[l] + self.fx[l] * (b[l] - a[l]), c[l] + self.fx[l] * (d[l] - c[l]))
    }
}

#[inline(always)]
fn between(v: f32, high: f32) -> f32 {
    let v = if v > 0.0 { v } else { 0.0 };
    if v < high { v } else { high }
}

/// From here on neighbouring numbers of single precision differ by one.
const WHOLE: f32 = 8_388_608.0;

/// The largest whole number not above `0 ≤ v < 2²²`. A cast to an integer, which has to look after
/// every number there is, would be done lane by lane.
#[inline(always)]
fn floor(v: f32) -> f32 {
    let nearest = (v + WHOLE) - WHOLE;
    if nearest > v { nearest - 1.0 } else { nearest }
}

/// A whole number `0 ≤ v < 2²²` as an integer.
#[inline(always)]
fn integer(v: f32) -> u32 {
    (v + WHOLE).to_bits() - WHOLE.to_bits()
}

/// Sum of the lanes, pairwise.
#[inline(always)]
pub(super) fn total(v: Lanes) -> f32 {
    ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]))
}

/// Whether a warped window of half the side `reach` may meet the view: it lies before the camera
/// and not beyond one side. A homography keeps the window within its four corners.
#[inline(always)]
pub(super) fn meets([base, du, dv]: &Warp, reach: f32, size: [usize; 2]) -> bool {
    let (right, bottom) = ((size[0] - 1) as f32, (size[1] - 1) as f32);
    let mut beyond = [true; 4];
    for (x, y) in [(-reach, -reach), (reach, -reach), (-reach, reach), (reach, reach)] {
        let z = base[2] + x * du[2] + y * dv[2];
        if z <= 0.0 {
            return false;
        }
        let (px, py) = (base[0] + x * du[0] + y * dv[0], base[1] + x * du[1] + y * dv[1]);
        let sides = [px < 0.0, py < 0.0, px > right * z, py > bottom * z];
        beyond.iter_mut().zip(sides).for_each(|(all, side)| *all &= side);
    }
    !beyond.contains(&true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::view::bilinear;

    #[test]
    fn whole_numbers_like_those_of_a_cast() {
        for v in [0.0, 1e-30, 0.5, 0.999_999_94, 1.0, 1.5, 2.5, 1919.0, 1919.5, 4_194_303.5] {
            assert_eq!(floor(v), v.floor());
            assert_eq!(integer(v.floor()), v as u32);
        }
    }

    /// A wavy picture with a blind spot.
    fn picture() -> Image {
        let value = |i: usize| 0.5 + 0.3 * ((i % 40) as f32 * 0.7).sin() * ((i / 40) as f32).cos();
        let mut grey: Vec<f32> = (0..1200).map(value).collect();
        grey[11 * 40 + 25] = f32::NAN;
        Image { size: [40, 30], k: [30.0, 30.0, 20.0, 15.0], grey }
    }

    const X: Lanes = [-3.0, -1.0, 0.0, 1.0, 2.0, 3.0, 1.5, 0.5];
    const Y: Lanes = [0.0, 3.0, 1.0, -2.0, 2.0, 0.0, 0.0, -1.0];

    fn warp(u: f32, v: f32, z: f32) -> Warp {
        [[u, v, z], [1.2, 0.1, 0.01], [-0.1, 0.9, 0.02]]
    }

    #[test]
    fn samples_are_those_of_bilinear() {
        let image = picture();
        let mut blind = 0;
        for (u, v) in [(23.0, 10.0), (0.7, 0.4), (42.5, 30.9)] {
            let [base, du, dv] = warp(u, v, 1.1);
            let found = Samples::new(&image, &[base, du, dv], &X, &Y);
            for l in 0..LANES {
                let at = [0, 1, 2].map(|i| base[i] + X[l] * du[i] + Y[l] * dv[i]);
                let expected = bilinear(&image.grey, image.size, at[0] / at[2], at[1] / at[2]);
                let value = found.value(l);
                let same = (value - expected).abs() < 1e-5;
                assert!(same || value.is_nan() && expected.is_nan(), "{value} {expected}");
                blind += usize::from(value.is_nan());
            }
        }
        assert!((3..20).contains(&blind), "{blind}");
    }

    #[test]
    fn gradient_by_differences() {
        let image = picture();
        let at = |u: f32, v: f32| Samples::new(&image, &warp(u, v, 1.0), &[0.0; 8], &[0.0; 8]);
        let [gx, gy] = at(12.3, 7.6).gradient(0);
        let h = 0.1;
        let by_x = (at(12.3 + h, 7.6).value(0) - at(12.3 - h, 7.6).value(0)) / (2.0 * h);
        let by_y = (at(12.3, 7.6 + h).value(0) - at(12.3, 7.6 - h).value(0)) / (2.0 * h);
        assert!((gx - by_x).abs() < 1e-4 && (gy - by_y).abs() < 1e-4);
    }

    #[test]
    fn windows_beside_or_behind_do_not_meet_the_view() {
        let met = |u: f32, z: f32| meets(&warp(u, 10.0, z), 3.0, [40, 30]);
        assert!(met(20.0, 1.0) && met(-1.0, 1.0) && !met(-9.0, 1.0) && !met(20.0, 0.05));
    }
}
