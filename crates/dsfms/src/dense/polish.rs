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

use super::options::DenseOptions;
use super::plane::{Field, InversePlane};
use super::score::{NONE, PairView, Pairs};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Window: every second pixel (chessboard) of `-REACH + 1 ..= REACH` around a grid point, which
/// lies at the corner of four working pixels.
const REACH: i32 = 6;
/// Standard deviation of the window's Gaussian weight, working px.
const SPREAD: f32 = 3.5;
const TAPS: usize = 72;
/// Gauss-Newton steps.
const STEPS: usize = 5;
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

/// Usable samples of the reference window: offset from the grid point, weight, value less the
/// weighted mean.
struct Window {
    centre: [f32; 2],
    offsets: [[f32; 2]; TAPS],
    weights: [f32; TAPS],
    values: [f32; TAPS],
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
        let Some(window) = Window::new(self.pairs, x, y) else { return failed };
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
            if step == STEPS || e[0].abs() < 1e-6 {
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
    fn best_views(&self, window: &Window, plane: &InversePlane, sources: u16) -> Vec<usize> {
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
        window: &Window,
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

impl Window {
    fn new(pairs: &Pairs, x: usize, y: usize) -> Option<Self> {
        let image = pairs.reference;
        let [w, h] = image.size.map(|s| s as i32);
        let mut window = Self {
            centre: [2.0 * x as f32 + 0.5, 2.0 * y as f32 + 0.5],
            offsets: [[0.0; 2]; TAPS],
            weights: [0.0; TAPS],
            values: [0.0; TAPS],
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
                let n = window.count;
                (window.offsets[n], window.weights[n], window.values[n]) =
                    ([du, dv], weight, value);
                window.count += 1;
                sum += weight * value;
                total += weight;
            }
        }
        window.values[..window.count].iter_mut().for_each(|v| *v -= sum / total);
        (window.count >= TAPS * 2 / 5).then_some(window)
    }

    /// Warp the window into a view and set up its share of the normal equations; `None` where too
    /// little of it is usable there or the contrast is reversed.
    fn linearise(&self, view: &PairView, plane: &InversePlane, noise: f32) -> Option<ViewSystem> {
        let [base, du, dv] = view.warp(plane, self.centre[0], self.centre[1]);
        let mut sums = Sums::default();
        for ((offset, &weight), &r) in
            self.offsets[..self.count].iter().zip(&self.weights).zip(&self.values)
        {
            let [x, y] = *offset;
            let z = base[2] + x * du[2] + y * dv[2];
            if z <= 0.0 {
                return None;
            }
            let iz = 1.0 / z;
            let px = (base[0] + x * du[0] + y * dv[0]) * iz;
            let py = (base[1] + x * du[1] + y * dv[1]) * iz;
            let Some((s, gx, gy)) = with_gradient(view, px, py) else { continue };
            // ds/de₀: along the epipolar line, per relative change of inverse depth.
            let slope = plane.w
                * iz
                * (gx * (view.t[0] - px * view.t[2]) + gy * (view.t[1] - py * view.t[2]));
            sums.add(weight, r, s, [slope, slope * x, slope * y]);
        }
        let enough = sums.count >= 24 && sums.count as f32 >= 0.6 * self.count as f32;
        enough.then(|| sums.project(noise)).flatten()
    }
}

/// Bilinear value and gradient of a source image; `None` next to unusable pixels.
#[inline]
fn with_gradient(view: &PairView, x: f32, y: f32) -> Option<(f32, f32, f32)> {
    let [w, h] = view.image.size;
    if !(x >= 0.0 && y >= 0.0 && x < (w - 1) as f32 && y < (h - 1) as f32) {
        return None;
    }
    let (x0, y0) = (x as usize, y as usize);
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    let i = y0 * w + x0;
    let grey = &view.image.grey;
    let (a, b, c, d) = (grey[i], grey[i + 1], grey[i + w], grey[i + w + 1]);
    let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
    let value = top + fy * (bottom - top);
    (!value.is_nan()).then_some((value, (b - a) + fy * (d - c - b + a), bottom - top))
}

/// Weighted moments of reference, warped window and Jacobian.
#[derive(Default)]
struct Sums {
    count: usize,
    w: f32,
    r: f32,
    s: f32,
    rr: f32,
    rs: f32,
    ss: f32,
    j: [f32; 3],
    jr: [f32; 3],
    js: [f32; 3],
    jj: [f32; 6],
}

impl Sums {
    #[inline]
    fn add(&mut self, w: f32, r: f32, s: f32, j: [f32; 3]) {
        let s = s - 0.5;
        self.count += 1;
        self.w += w;
        self.r += w * r;
        self.s += w * s;
        self.rr += w * r * r;
        self.rs += w * r * s;
        self.ss += w * s * s;
        for (k, jk) in j.iter().enumerate() {
            let wj = w * jk;
            self.j[k] += wj;
            self.jr[k] += wj * r;
            self.js[k] += wj * s;
        }
        let [a, b, c] = j;
        let products = [a * a, a * b, a * c, b * b, b * c, c * c];
        self.jj.iter_mut().zip(products).for_each(|(sum, p)| *sum += w * p);
    }

    /// Inner products after `{1, r}` are projected out.
    fn project(&self, noise: f32) -> Option<ViewSystem> {
        let centred = |fg: f32, f: f32, g: f32| (fg - f * g / self.w) as f64;
        let (rr, ss) = (centred(self.rr, self.r, self.r), centred(self.ss, self.s, self.s));
        let rs = centred(self.rs, self.r, self.s);
        let floor = (noise * self.w) as f64;
        if rs <= 0.0 {
            return None;
        }
        let correlation = rs / ((rr + floor) * (ss + floor)).sqrt();
        let jr = Vector3::from_fn(|k, _| centred(self.jr[k], self.j[k], self.r));
        let js = Vector3::from_fn(|k, _| centred(self.js[k], self.j[k], self.s));
        let index = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
        let jj = Matrix3::from_fn(|a, b| centred(self.jj[index[a][b]], self.j[a], self.j[b]));
        let rr = rr + floor;
        Some(ViewSystem {
            normal: jj - jr * jr.transpose() / rr,
            gradient: js - jr * (rs / rr),
            variance: ((ss - rs * rs / rr) / self.w as f64).max(0.0),
            cost: (1.0 - correlation).clamp(0.0, NONE as f64) as f32,
        })
    }
}
