//! How well a plane explains the other views: normalised correlation of warped windows.

use super::lanes::{LANES, Lanes, Samples, Warp, meets, total};
use super::options::DenseOptions;
use super::plane::{ALL, InversePlane, NONE};
use super::view::{Image, StereoPyramid};

/// Half the side of the window, px of the level.
const RADIUS: i32 = 3;
/// Every second pixel of the window, like the black squares of a chessboard, less the centre.
const TAPS: usize = 24;
/// Views scored at once, at most (the bound of `max_sources`).
const MAX_VIEWS: usize = 16;
/// What each view short of `best_sources` adds to the cost, over `best_sources`: enough that a
/// plane does not win by leaving the views in which it would be found wrong, little enough that
/// what only two frames see can be found.
const LONELY: f32 = 0.3;
/// Correlation cost above which a view says nothing for a plane.
const USEFUL: f32 = 0.7;

/// One frame and those it is compared with, at one level.
pub(super) struct Pairs<'a> {
    pub reference: &'a Image,
    pub k: [f32; 4],
    pub views: Vec<PairView<'a>>,
}

/// A source and the warp to it: a point at pixel `(u, v)` of inverse depth `w` appears at
/// `h (u, v, 1)ᵀ + w t`, dehomogenised.
pub(super) struct PairView<'a> {
    pub image: &'a Image,
    pub h: [f32; 9],
    pub t: [f32; 3],
}

impl<'a> Pairs<'a> {
    pub(super) fn new(
        views: &'a [StereoPyramid],
        reference: usize,
        sources: &[usize],
        level: usize,
    ) -> Self {
        let image = &views[reference].levels[level];
        let pairs = sources.iter().map(|&j| PairView::new(views, reference, j, level)).collect();
        Self { reference: image, k: image.k.map(|v| v as f32), views: pairs }
    }
}

impl<'a> PairView<'a> {
    fn new(views: &'a [StereoPyramid], reference: usize, source: usize, level: usize) -> Self {
        use nalgebra::Matrix3;
        let matrix = |k: [f64; 4]| Matrix3::new(k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 1.0);
        let motion = views[source].posed.pose * views[reference].posed.pose.inverse();
        let (kr, image) = (matrix(views[reference].levels[level].k), &views[source].levels[level]);
        let ks = matrix(image.k);
        // A pinhole matrix has positive focal lengths; the identity stands in if it has not.
        let inverse = kr.try_inverse().unwrap_or_else(Matrix3::identity);
        let h = ks * motion.rotation.to_rotation_matrix().matrix() * inverse;
        let t = ks * motion.translation.vector;
        let rows = std::array::from_fn(|i| h[(i / 3, i % 3)] as f32);
        Self { image, h: rows, t: [t.x as f32, t.y as f32, t.z as f32] }
    }

    /// The homography of a plane about pixel `(u, v)`: homogeneous image of the centre and its
    /// change per px along u and v.
    #[inline(always)]
    pub(super) fn warp(&self, plane: &InversePlane, u: f32, v: f32) -> Warp {
        let (h, t) = (&self.h, &self.t);
        let base =
            [0, 1, 2].map(|i| h[3 * i] * u + h[3 * i + 1] * v + h[3 * i + 2] + plane.w * t[i]);
        let du = [0, 1, 2].map(|i| h[3 * i] + plane.a * t[i]);
        let dv = [0, 1, 2].map(|i| h[3 * i + 1] + plane.b * t[i]);
        [base, du, dv]
    }
}

/// Registers that hold a window.
const GROUPS: usize = TAPS / LANES;

/// The usable samples of the window around one pixel of the reference.
pub(super) struct WindowPatch {
    u: f32,
    v: f32,
    /// Offsets, weights (1, or 0 for the unused places at the end) and values less the centre's.
    x: [Lanes; GROUPS],
    y: [Lanes; GROUPS],
    weight: [Lanes; GROUPS],
    value: [Lanes; GROUPS],
    count: usize,
}

impl WindowPatch {
    /// `None` where the centre is masked or too little of the window is usable.
    pub(super) fn new(image: &Image, x: usize, y: usize) -> Option<Self> {
        let [w, h] = image.size.map(|s| s as i32);
        let centre = image.grey[y * image.size[0] + x];
        if centre.is_nan() {
            return None;
        }
        let zero = [[0.0; LANES]; GROUPS];
        let mut patch = Self {
            u: x as f32,
            v: y as f32,
            x: zero,
            y: zero,
            weight: zero,
            value: zero,
            count: 0,
        };
        for dy in -RADIUS..=RADIUS {
            for dx in -RADIUS..=RADIUS {
                let (px, py) = (x as i32 + dx, y as i32 + dy);
                let outside = px < 0 || py < 0 || px >= w || py >= h;
                if outside || (dx + dy) % 2 != 0 || (dx, dy) == (0, 0) {
                    continue;
                }
                let value = image.grey[(py * w + px) as usize];
                if !value.is_nan() {
                    patch.push([dx as f32, dy as f32], value - centre);
                }
            }
        }
        (patch.count >= TAPS * 2 / 5).then_some(patch)
    }

    fn push(&mut self, [x, y]: [f32; 2], value: f32) {
        let (g, l) = (self.count / LANES, self.count % LANES);
        (self.x[g][l], self.y[g][l]) = (x, y);
        (self.weight[g][l], self.value[g][l]) = (1.0, value);
        self.count += 1;
    }

    /// `1 - correlation` in one view, in `[0, 2]`; the noise added to both variances draws windows
    /// without texture towards 1, "no idea".
    #[inline(always)]
    pub(super) fn cost(&self, view: &PairView, plane: &InversePlane, noise_variance: f32) -> f32 {
        let warp = view.warp(plane, self.u, self.v);
        if !meets(&warp, RADIUS as f32, view.image.size) {
            return NONE;
        }
        let sums = self.sums(view.image, &warp);
        let n = sums[0];
        if n < 10.0 || n < 0.6 * self.count as f32 {
            return NONE;
        }
        let [_, sr, ss, rr, rs, s2] = sums;
        let i = 1.0 / n;
        let vr = (rr - sr * sr * i) * i + noise_variance;
        let vs = (s2 - ss * ss * i) * i + noise_variance;
        let correlation = (rs - sr * ss * i) * i / (vr * vs).sqrt();
        (1.0 - correlation).clamp(0.0, NONE)
    }

    /// Sums over the samples that fall on usable pixels of the other view: their number, reference,
    /// source, and the products.
    #[inline(always)]
    fn sums(&self, image: &Image, warp: &Warp) -> [f32; 6] {
        let mut sums = [[0.0f32; LANES]; 6];
        for g in 0..self.count.div_ceil(LANES) {
            let source = Samples::new(image, warp, &self.x[g], &self.y[g]);
            #[allow(clippy::needless_range_loop, reason = "one lane of every array")]
            for l in 0..LANES {
                let value = source.value(l);
                let usable = !value.is_nan();
                let n = if usable { self.weight[g][l] } else { 0.0 };
                let s = if usable { value - 0.5 } else { 0.0 };
                let r = n * self.value[g][l];
                let s = n * s;
                sums[0][l] += n;
                sums[1][l] += r;
                sums[2][l] += s;
                sums[3][l] += r * r;
                sums[4][l] += r * s;
                sums[5][l] += s * s;
            }
        }
        sums.map(total)
    }

    /// Cost of every source that `sources` names; [`NONE`] for the others.
    fn costs(
        &self,
        pairs: &Pairs,
        plane: &InversePlane,
        noise: f32,
        sources: u16,
    ) -> [f32; MAX_VIEWS] {
        let mut costs = [NONE; MAX_VIEWS];
        for (j, (cost, view)) in costs.iter_mut().zip(&pairs.views).enumerate() {
            if sources >> j & 1 == 1 {
                *cost = self.cost(view, plane, noise);
            }
        }
        costs
    }

    /// Mean cost over the best few of the named sources, and a fine for each that is missing;
    /// [`NONE`], without looking at the last sources, where they cannot bring it below `than`.
    pub(super) fn score(
        &self,
        pairs: &Pairs,
        plane: &InversePlane,
        sources: u16,
        options: &DenseOptions,
        than: f32,
    ) -> f32 {
        let noise = (options.image_noise * options.image_noise) as f32;
        let (views, best) =
            (&pairs.views[..pairs.views.len().min(MAX_VIEWS)], options.best_sources);
        let mut costs = [NONE; MAX_VIEWS];
        let costs = &mut costs[..views.len()];
        let named = |j: usize| sources >> j & 1 == 1;
        let mut left = (0..views.len()).filter(|&j| named(j)).count();
        for j in (0..views.len()).filter(|&j| named(j)) {
            costs[j] = self.cost(&views[j], plane, noise);
            left -= 1;
            if left > 0 && left < best && least(costs, j, sources, best) >= than {
                return NONE;
            }
        }
        mean_of_smallest(costs, best)
    }

    /// The sources that speak for a plane, at most `keep`, best first chosen; [`ALL`] where fewer
    /// than two do and nothing is known.
    pub(super) fn speaking(
        &self,
        pairs: &Pairs,
        plane: &InversePlane,
        sources: u16,
        keep: usize,
        options: &DenseOptions,
    ) -> u16 {
        let noise = (options.image_noise * options.image_noise) as f32;
        let costs = self.costs(pairs, plane, noise, sources);
        let mut order: Vec<usize> = (0..MAX_VIEWS).filter(|&j| costs[j] < USEFUL).collect();
        order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));
        let chosen = order.iter().take(keep).fold(0, |bits, j| bits | 1 << j);
        if order.len() < 2 { ALL } else { chosen }
    }
}

/// What the mean can still become when the sources after the `last` fit perfectly.
fn least(costs: &[f32], last: usize, sources: u16, best: usize) -> f32 {
    let mut hoped = [NONE; MAX_VIEWS];
    for (j, (hoped, cost)) in hoped.iter_mut().zip(costs).enumerate() {
        *hoped = if j > last && sources >> j & 1 == 1 { 0.0 } else { *cost };
    }
    mean_of_smallest(&mut hoped[..costs.len()], best)
}

/// Mean of the `k` smallest values that can be compared, and [`LONELY`] for each that cannot;
/// reorders them.
fn mean_of_smallest(values: &mut [f32], k: usize) -> f32 {
    let k = k.clamp(1, values.len().max(1));
    for i in 0..k.min(values.len()) {
        for j in i + 1..values.len() {
            if values[j] < values[i] {
                values.swap(i, j);
            }
        }
    }
    let best = values.iter().take(k).filter(|v| **v < NONE);
    let (sum, count) = best.fold((0.0, 0), |(sum, n), v| (sum + v, n + 1));
    if count == 0 {
        return NONE;
    }
    sum / count as f32 + LONELY * (k - count) as f32 / k as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_that_can_come_is_never_above_what_comes() {
        let all = [0.9, NONE, 0.3, 0.7, 0.05, 1.4];
        for sources in [0b111111u16, 0b101101, 0b011110] {
            let named = |j: usize| sources >> j & 1 == 1;
            let costs: Vec<f32> = (0..6).map(|j| if named(j) { all[j] } else { NONE }).collect();
            let comes = mean_of_smallest(&mut costs.clone(), 3);
            for last in 0..6 {
                let mut so_far = costs.clone();
                so_far[last + 1..].fill(NONE);
                assert!(least(&so_far, last, sources, 3) <= comes);
            }
            assert_eq!(least(&costs, 5, sources, 3), comes);
        }
        // By hand: one still to come, two known.
        assert!((least(&[0.6, 0.9, NONE], 1, 0b111, 3) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn smallest_by_hand() {
        assert_eq!(mean_of_smallest(&mut [2.0, 0.5, 1.0, 0.1], 2), 0.3);
        assert_eq!(mean_of_smallest(&mut [NONE, 0.5], 2), 0.5 + 0.5 * LONELY);
        assert_eq!(mean_of_smallest(&mut [NONE, NONE], 2), NONE);
        assert_eq!(mean_of_smallest(&mut [], 2), NONE);
    }
}
