//! Gauss-Newton on the images: sub-pixel depth, slope, and how well the texture fixes them.
//!
//! For each view the warped window `s` should be a gain and an offset away from the reference
//! window `r`. Both are projected out (variable projection), so what remains depends only on the
//! plane `w (1 + e₀ + e₁ δu + e₂ δv)`:
//!
//! `min Σ_views 1/σ_v² ‖ P (s + J e) ‖²`, `P` the projector on the complement of `{1, r}`.
//!
//! `σ_v²` is the variance of the residual in that view plus the noise of the image, so a view with
//! an occlusion or a highlight counts little, and the inverse of the normal matrix is a variance.
//! The change of gain and offset along the window is neglected.

use super::lanes::{LANES, Lanes, Samples, Warp, meets, total};
use super::options::DenseOptions;
use super::plane::{Field, InversePlane, NONE};
use super::score::{PairView, Pairs};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Window: every second pixel (chessboard) of `-REACH + 1 ..= REACH` around a grid point, which
/// lies at the corner of four working pixels.
const REACH: i32 = 6;
/// Standard deviation of the window's Gaussian weight, working px.
const SPREAD: f32 = 3.5;
const TAPS: usize = 72;
/// Registers that hold the window.
const GROUPS: usize = TAPS / LANES;
/// Gauss-Newton steps.
const STEPS: usize = 5;
/// A step is not worth taking when its square is less than this times the variance of the depth.
const SMALL_STEP: f64 = 1e-3;
/// Cost above which a view takes no part.
const MAX_VIEW_COST: f32 = 0.6;
/// Samples of a blurred image are not independent: variance is this much larger than it seems.
const CORRELATION_INFLATION: f64 = 3.0;

/// Refine every plane of `field` (on the grid of level 1) on the images of level 0.
pub(super) fn run(pairs: &Pairs, field: &mut Field, range: [f64; 2], options: &DenseOptions) {
    let w = field.size[0];
    let depth = range.map(|d| 1.0 / d as f32);
    let noise = (options.image_noise * options.image_noise) as f32;
    let polisher = Polisher { pairs, noise, keep: options.best_sources + 1, depth };
    field
        .planes
        .par_iter_mut()
        .zip(field.cost.par_iter_mut())
        .zip(field.sigma.par_iter_mut())
        .zip(&field.sources)
        .enumerate()
        .for_each(|(i, (((plane, cost), sigma), &sources))| {
            if *cost >= NONE {
                (*cost, *sigma) = (NONE, f32::INFINITY);
                return;
            }
            let fine = InversePlane { w: plane.w, a: 0.5 * plane.a, b: 0.5 * plane.b };
            let (better, c, s) = polisher.polish(fine, i % w, i / w, sources);
            *plane = InversePlane { w: better.w, a: 2.0 * better.a, b: 2.0 * better.b };
            (*cost, *sigma) = (c, s);
        });
}

struct Polisher<'a> {
    pairs: &'a Pairs<'a>,
    noise: f32,
    keep: usize,
    depth: [f32; 2],
}

/// Usable samples of the reference window: offset from the grid point, weight (0 for the unused
/// places at the end), value less the weighted mean.
struct PolishWindow {
    centre: [f32; 2],
    x: [Lanes; GROUPS],
    y: [Lanes; GROUPS],
    weight: [Lanes; GROUPS],
    value: [Lanes; GROUPS],
    count: usize,
}

/// Normal equations of one view, gain and offset projected out.
struct ViewSystem {
    normal: Matrix3<f64>,
    gradient: Vector3<f64>,
    /// Variance of the residual.
    variance: f64,
    /// `1 - correlation`.
    cost: f32,
}

impl Polisher<'_> {
    /// The better plane, its cost, and the standard deviation of its inverse depth.
    fn polish(
        &self,
        start: InversePlane,
        x: usize,
        y: usize,
        sources: u16,
    ) -> (InversePlane, f32, f32) {
        let failed = (start, NONE, f32::INFINITY);
        let Some(window) = PolishWindow::new(self.pairs, x, y) else { return failed };
        let views = self.best_views(&window, &start, sources);
        if views.is_empty() {
            return failed;
        }
        let mut best = failed;
        let mut plane = start;
        for step in 0..=STEPS {
            let Some((cost, normal, gradient)) = self.system(&window, &views, &plane) else {
                break;
            };
            let Some(inverse) = normal.try_inverse() else { break };
            if cost < best.1 {
                let variance = inverse[(0, 0)] * CORRELATION_INFLATION;
                best = (plane, cost, plane.w * variance.max(0.0).sqrt() as f32);
            }
            let e = -(inverse * gradient);
            if step == STEPS || e[0] * e[0] < SMALL_STEP * inverse[(0, 0)] {
                break;
            }
            let scale = (0.03 / e[0].abs()).min(1.0) * plane.w as f64;
            plane = InversePlane {
                w: plane.w + (scale * e[0]) as f32,
                a: plane.a + (scale * e[1]) as f32,
                b: plane.b + (scale * e[2]) as f32,
            };
            let [u, v] = window.centre;
            if plane.w > self.depth[0]
                || plane.w < self.depth[1]
                || plane.facing(self.pairs.k, u, v) < 0.1
            {
                break;
            }
        }
        best
    }

    /// The views that agree best with the first guess.
    fn best_views(&self, window: &PolishWindow, plane: &InversePlane, sources: u16) -> Vec<usize> {
        let mut scored: Vec<(f32, usize)> = (0..self.pairs.views.len())
            .filter(|j| sources >> j & 1 == 1)
            .filter_map(|j| {
                Some((window.linearise(&self.pairs.views[j], plane, self.noise)?.cost, j))
            })
            .filter(|s| s.0 < MAX_VIEW_COST)
            .collect();
        scored.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        scored.iter().take(self.keep).map(|s| s.1).collect()
    }

    /// Mean cost and normal equations over the views that can be compared, with a weak prior that
    /// holds the slopes where there is no texture.
    fn system(
        &self,
        window: &PolishWindow,
        views: &[usize],
        plane: &InversePlane,
    ) -> Option<(f32, Matrix3<f64>, Vector3<f64>)> {
        let (mut cost, mut count) = (0.0, 0);
        let [fx, fy] = [self.pairs.k[0] as f64, self.pairs.k[1] as f64];
        // One standard deviation: 20 % of depth, 45 degrees of slope, about the current plane.
        let prior = Vector3::new(25.0, fx * fx, fy * fy);
        let mut normal = Matrix3::from_diagonal(&prior);
        let mut gradient = Vector3::zeros();
        for &j in views {
            let Some(view) = window.linearise(&self.pairs.views[j], plane, self.noise) else {
                continue;
            };
            let weight = 1.0 / (view.variance + self.noise as f64);
            normal += weight * view.normal;
            gradient += weight * view.gradient;
            cost += view.cost;
            count += 1;
        }
        // A plane that leaves views out of sight has not become better by it.
        (count == views.len()).then(|| (cost / count as f32, normal, gradient))
    }
}

impl PolishWindow {
    fn new(pairs: &Pairs, x: usize, y: usize) -> Option<Self> {
        let image = pairs.reference;
        let [w, h] = image.size.map(|s| s as i32);
        let mut window = Self {
            centre: [2.0 * x as f32 + 0.5, 2.0 * y as f32 + 0.5],
            x: [[0.0; LANES]; GROUPS],
            y: [[0.0; LANES]; GROUPS],
            weight: [[0.0; LANES]; GROUPS],
            value: [[0.0; LANES]; GROUPS],
            count: 0,
        };
        let (mut sum, mut total) = (0.0, 0.0);
        for j in 1 - REACH..=REACH {
            for i in 1 - REACH..=REACH {
                let (px, py) = (2 * x as i32 + i, 2 * y as i32 + j);
                if (i + j) % 2 != 0 || px < 0 || py < 0 || px >= w || py >= h {
                    continue;
                }
                let value = image.grey[(py * w + px) as usize];
                if value.is_nan() {
                    continue;
                }
                let (du, dv) = (i as f32 - 0.5, j as f32 - 0.5);
                let weight = (-(du * du + dv * dv) / (2.0 * SPREAD * SPREAD)).exp();
                let (g, l) = (window.count / LANES, window.count % LANES);
                (window.x[g][l], window.y[g][l]) = (du, dv);
                (window.weight[g][l], window.value[g][l]) = (weight, value);
                window.count += 1;
                sum += weight * value;
                total += weight;
            }
        }
        window.value.iter_mut().flatten().for_each(|v| *v -= sum / total);
        (window.count >= TAPS * 2 / 5).then_some(window)
    }

    /// Warp the window into a view and set up its share of the normal equations; `None` where too
    /// little of it is usable there or the contrast is reversed.
    fn linearise(&self, view: &PairView, plane: &InversePlane, noise: f32) -> Option<ViewSystem> {
        let warp = view.warp(plane, self.centre[0], self.centre[1]);
        if !meets(&warp, REACH as f32, view.image.size) {
            return None;
        }
        let sums = self.moments(view, plane, &warp);
        let enough = sums[0] >= 24.0 && sums[0] >= 0.6 * self.count as f32;
        enough.then(|| project(&sums, noise)).flatten()
    }

    /// What [`project`] needs, summed over the window.
    #[inline(always)]
    fn moments(&self, view: &PairView, plane: &InversePlane, warp: &Warp) -> [f32; SUMS] {
        let mut sums = [[0.0; LANES]; SUMS];
        for g in 0..self.count.div_ceil(LANES) {
            let samples = Samples::new(view.image, warp, &self.x[g], &self.y[g]);
            #[allow(clippy::needless_range_loop, reason = "one lane of every array")]
            for l in 0..LANES {
                let usable = !samples.value(l).is_nan();
                let or_zero = |v: f32| if usable { v } else { 0.0 };
                let [gx, gy] = samples.gradient(l).map(or_zero);
                let w = or_zero(self.weight[g][l]);
                let (r, s) = (self.value[g][l], or_zero(samples.value(l) - 0.5));
                // ds/de₀: along the epipolar line, per relative change of inverse depth.
                let along = gx * (view.t[0] - samples.x[l] * view.t[2])
                    + gy * (view.t[1] - samples.y[l] * view.t[2]);
                let a = plane.w * samples.iz[l] * along;
                let (b, c) = (a * self.x[g][l], a * self.y[g][l]);
                let (wr, ws) = (w * r, w * s);
                let (wa, wb, wc) = (w * a, w * b, w * c);
                let terms = [
                    if w > 0.0 { 1.0 } else { 0.0 },
                    w,
                    wr,
                    ws,
                    wr * r,
                    wr * s,
                    ws * s,
                    wa,
                    wb,
                    wc,
                    wa * r,
                    wb * r,
                    wc * r,
                    wa * s,
                    wb * s,
                    wc * s,
                    wa * a,
                    wa * b,
                    wa * c,
                    wb * b,
                    wb * c,
                    wc * c,
                ];
                (0..SUMS).for_each(|k| sums[k][l] += terms[k]);
            }
        }
        sums.map(total)
    }
}

/// Weighted moments of reference, warped window and Jacobian: number, 1; r, s; rr, rs, ss; the
/// three columns j alone, with r and with s; the upper triangle of jj.
const SUMS: usize = 22;

/// Inner products after `{1, r}` are projected out.
fn project(m: &[f32; SUMS], noise: f32) -> Option<ViewSystem> {
    let [_, w, r, s, rr, rs, ss, ..] = *m;
    let centred = |fg: f32, f: f32, g: f32| (fg - f * g / w) as f64;
    let (rr, rs, ss) = (centred(rr, r, r), centred(rs, r, s), centred(ss, s, s));
    let floor = (noise * w) as f64;
    if rs <= 0.0 {
        return None;
    }
    let correlation = rs / ((rr + floor) * (ss + floor)).sqrt();
    let j = &m[7..10];
    let jr = Vector3::from_fn(|k, _| centred(m[10 + k], j[k], r));
    let js = Vector3::from_fn(|k, _| centred(m[13 + k], j[k], s));
    let index = [[16, 17, 18], [17, 19, 20], [18, 20, 21]];
    let jj = Matrix3::from_fn(|a, b| centred(m[index[a][b]], j[a], j[b]));
    let rr = rr + floor;
    Some(ViewSystem {
        normal: jj - jr * jr.transpose() / rr,
        gradient: js - jr * (rs / rr),
        variance: ((ss - rs * rs / rr) / w as f64).max(0.0),
        cost: (1.0 - correlation).clamp(0.0, NONE as f64) as f32,
    })
}
