//! From planes to a depth map: trusted pixels smoothed by their variance, gaps filled with care.

use super::consistency::correlates;
use super::depth_map::{self, DepthMap};
use super::options::DenseOptions;
use super::plane::{Field, InversePlane};
use super::view::StereoPyramid;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Radius of the fit around a trusted pixel, px.
const RADIUS: i32 = 3;
/// Neighbours whose plane misses the pixel by more than this fraction of depth (seen from the
/// front) are another surface.
const SAME_SURFACE: f32 = depth_map::SAME_SURFACE as f32;
/// Cosine to the sightline below which that fraction grows no further.
const GRAZING: f32 = depth_map::GRAZING as f32;
/// Cosine to the sightline (83 degrees) below which the slope of a surface is not believed.
const LEAST_FACING: f32 = 0.12;
/// Trust in a filled pixel, at most.
const FILLED: f32 = 0.1;
/// Trust in a pixel that no other frame confirms, at most.
const ALONE: f32 = 0.15;
/// Cost up to which such a pixel may continue a confirmed surface.
const ALONE_COST: f32 = 0.4;

/// Depth map of one frame from its planes and the number of frames that agree with each.
pub(super) fn depth_map(
    view: &StereoPyramid,
    field: &Field,
    agreement: &[u8],
    options: &DenseOptions,
) -> DepthMap {
    let k = view.levels[1].k.map(|v| v as f32);
    let trust = trust(field, agreement, k, options);
    let grid = TrustedGrid { field, trust: &trust, k };
    let w = field.size[0];
    let rows: Vec<Option<DepthEstimate>> = (0..field.planes.len())
        .into_par_iter()
        .map(|i| {
            let at = [(i % w) as i32, (i / w) as i32];
            if trust[i] > 0.0 {
                grid.smoothed(at, i)
            } else if view.valid_grid(i) {
                grid.filled(at, options.fill_px as i32)
            } else {
                None
            }
        })
        .collect();
    let mut map = DepthMap {
        camera: view.camera_of(1),
        pose: view.posed.pose,
        depth: vec![0.0; rows.len()],
        normal: vec![[0.0; 3]; rows.len()],
        sigma: vec![f32::INFINITY; rows.len()],
        confidence: vec![0.0; rows.len()],
    };
    for (i, estimate) in rows.iter().enumerate() {
        let Some(e) = estimate else { continue };
        let (u, v) = ((i % w) as f32, (i / w) as f32);
        if e.plane.w <= 0.0 || e.plane.facing(k, u, v) < LEAST_FACING {
            continue;
        }
        map.depth[i] = 1.0 / e.plane.w;
        map.normal[i] = e.plane.normal(k, u, v);
        map.sigma[i] = e.sigma / (e.plane.w * e.plane.w);
        map.confidence[i] = e.confidence;
    }
    map
}

/// Trust in each pixel: correlation above the least accepted one, and agreement.
fn trust(field: &Field, agreement: &[u8], k: [f32; 4], options: &DenseOptions) -> Vec<f32> {
    let floor = options.min_correlation as f32;
    // Texture or parallax that leaves the depth open by more than frames may disagree.
    let sharp =
        |i: usize| field.sigma[i] as f64 <= options.max_relative_depth * field.planes[i].w as f64;
    let correlation = |i: usize| ((1.0 - field.cost[i] - floor) / (1.0 - floor)).clamp(0.05, 1.0);
    let confirmed = |i: usize| {
        let agree = agreement[i] as usize >= options.min_consistent;
        if !agree || !correlates(field, i, options) || !sharp(i) {
            return 0.0;
        }
        let frames = (agreement[i] as f32 / (options.min_consistent as f32 + 2.0)).min(1.0);
        correlation(i) * frames
    };
    let mut trust: Vec<f32> = (0..field.planes.len()).map(confirmed).collect();
    let may_follow =
        |i: usize| field.cost[i] < ALONE_COST && correlates(field, i, options) && sharp(i);
    for i in continued(field, &trust, k, may_follow) {
        trust[i] = ALONE * correlation(i);
    }
    trust
}

/// Pixels that continue the surface of trusted ones without a step. What one frame sees well and
/// all others at a grazing angle no other depth map confirms, but surfaces go on.
fn continued(
    field: &Field,
    trust: &[f32],
    k: [f32; 4],
    may_follow: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let [w, h] = field.size;
    let mut reached: Vec<bool> = trust.iter().map(|&t| t > 0.0).collect();
    let mut queue: Vec<usize> = (0..trust.len()).filter(|&i| reached[i]).collect();
    let confirmed = queue.len();
    let mut next = 0;
    while next < queue.len() {
        let i = queue[next];
        next += 1;
        let (x, y) = (i % w, i / w);
        for (dx, dy) in [(-1i32, 0i32), (1, 0), (0, -1), (0, 1)] {
            let (nx, ny) = (x as i32 + dx, y as i32 + dy);
            if nx < 0 || ny < 0 || nx >= w as i32 || ny >= h as i32 {
                continue;
            }
            let n = ny as usize * w + nx as usize;
            if reached[n] || !may_follow(n) {
                continue;
            }
            let (own, other) = (&field.planes[i], &field.planes[n]);
            let facing = other.facing(k, nx as f32, ny as f32);
            // Each must lie on the other's plane.
            let miss = (own.at(dx as f32, dy as f32) - other.w)
                .abs()
                .max((other.at(-dx as f32, -dy as f32) - own.w).abs());
            if facing > LEAST_FACING && miss < 0.5 * SAME_SURFACE * other.w / facing.max(GRAZING) {
                reached[n] = true;
                queue.push(n);
            }
        }
    }
    queue.split_off(confirmed)
}

struct DepthEstimate {
    plane: InversePlane,
    /// Standard deviation of inverse depth.
    sigma: f32,
    confidence: f32,
}

struct TrustedGrid<'a> {
    field: &'a Field,
    trust: &'a [f32],
    k: [f32; 4],
}

/// Weighted least squares of a plane in inverse depth, about a centre.
#[derive(Default)]
struct PlaneFit {
    normal: Matrix3<f64>,
    right: Vector3<f64>,
    weight: f64,
    trust: f64,
    offset: [f64; 2],
    count: usize,
}

impl PlaneFit {
    fn add(&mut self, [du, dv]: [i32; 2], w: f32, weight: f64, trust: f32) {
        let row = Vector3::new(1.0, du as f64, dv as f64);
        self.normal += weight * row * row.transpose();
        self.right += weight * w as f64 * row;
        self.weight += weight;
        self.trust += weight * trust as f64;
        self.offset[0] += weight * du as f64;
        self.offset[1] += weight * dv as f64;
        self.count += 1;
    }

    fn solve(&self) -> Option<InversePlane> {
        let solution = self.normal.cholesky()?.solve(&self.right);
        let plane =
            InversePlane { w: solution[0] as f32, a: solution[1] as f32, b: solution[2] as f32 };
        plane.w.is_finite().then_some(plane)
    }
}

impl TrustedGrid<'_> {
    /// Trusted pixels within `radius`, as `(offset, index)`.
    fn around(&self, [x, y]: [i32; 2], radius: i32) -> impl Iterator<Item = ([i32; 2], usize)> {
        let [w, h] = self.field.size.map(|s| s as i32);
        let rows = (y - radius).max(0)..=(y + radius).min(h - 1);
        rows.flat_map(move |v| {
            let columns = (x - radius).max(0)..=(x + radius).min(w - 1);
            columns.map(move |u| ([u - x, v - y], (v * w + u) as usize))
        })
        .filter(|(_, i)| self.trust[*i] > 0.0)
    }

    fn weight(&self, [du, dv]: [i32; 2], i: usize, spread: f64) -> f64 {
        let near = (-((du * du + dv * dv) as f64) / (2.0 * spread * spread)).exp();
        let (sigma, w) = (self.field.sigma[i] as f64, self.field.planes[i].w as f64);
        // Below 0.05 % of depth other errors (poses, curvature) outweigh the image noise.
        near * self.trust[i] as f64 / (sigma * sigma + (5e-4 * w).powi(2))
    }

    /// The neighbours' observations and this one's, each by its variance.
    fn smoothed(&self, at: [i32; 2], centre: usize) -> Option<DepthEstimate> {
        let own = self.field.planes[centre];
        let [u, v] = at.map(|c| c as f32);
        let tolerance = SAME_SURFACE * own.w / own.facing(self.k, u, v).max(GRAZING);
        let mut fit = PlaneFit::default();
        for (offset, i) in self.around(at, RADIUS) {
            let plane = self.field.planes[i];
            let here = plane.at(-offset[0] as f32, -offset[1] as f32);
            if (here - own.w).abs() < tolerance {
                fit.add(
                    offset,
                    plane.w,
                    self.weight(offset, i, RADIUS as f64 / 2.0),
                    self.trust[i],
                );
            }
        }
        let plane = if fit.count >= 6 { fit.solve().unwrap_or(own) } else { own };
        Some(DepthEstimate {
            plane,
            sigma: self.field.sigma[centre],
            confidence: self.trust[centre],
        })
    }

    /// A plane through the trusted pixels around a gap; `None` where they lie on one side only.
    fn filled(&self, at: [i32; 2], reach: i32) -> Option<DepthEstimate> {
        let mut radius = 3;
        while radius <= reach {
            let mut fit = PlaneFit::default();
            for (offset, i) in self.around(at, radius) {
                let weight = self.weight(offset, i, radius as f64 / 2.0);
                fit.add(offset, self.field.planes[i].w, weight, self.trust[i]);
            }
            if fit.count >= (radius * radius) as usize && fit.weight > 0.0 {
                let [u, v] = fit.offset.map(|o| o / fit.weight);
                if u.hypot(v) < 0.35 * radius as f64 {
                    return self.gap(&fit, at, radius);
                }
            }
            radius += 3;
        }
        None
    }

    fn gap(&self, fit: &PlaneFit, at: [i32; 2], radius: i32) -> Option<DepthEstimate> {
        let plane = fit.solve()?;
        let mut squares = 0.0;
        for (offset, i) in self.around(at, radius) {
            let miss = self.field.planes[i].w - plane.at(offset[0] as f32, offset[1] as f32);
            squares += miss * miss;
        }
        let sigma = (squares / fit.count as f32).sqrt();
        if sigma > SAME_SURFACE * plane.w {
            return None;
        }
        let trust = (fit.trust / fit.weight) as f32;
        Some(DepthEstimate { plane, sigma, confidence: FILLED * trust * 3.0 / radius as f32 })
    }
}
