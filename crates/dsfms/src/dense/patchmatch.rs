//! PatchMatch stereo: good planes spread over a chessboard of pixels.
//!
//! Each round looks, at the pixels of one colour, at the planes of eight neighbourhoods of the
//! other colour (the best of each, as in ACMH), then tries random changes of the winner.

use super::options::DenseOptions;
use super::plane::{ALL, Field, InversePlane, NONE, Noise};
use super::score::{Pairs, WindowPatch};
use rayon::prelude::*;

/// The eight neighbourhoods: four near (straight) and four far (both parities reach the other
/// colour).
const NEIGHBOURHOODS: [&[[i32; 2]]; 8] = [
    &[[0, -1], [-1, -2], [1, -2]],
    &[[0, 1], [-1, 2], [1, 2]],
    &[[-1, 0], [-2, -1], [-2, 1]],
    &[[1, 0], [2, -1], [2, 1]],
    &[[0, -3], [0, -5], [0, -9]],
    &[[0, 3], [0, 5], [0, 9]],
    &[[-3, 0], [-5, 0], [-9, 0]],
    &[[3, 0], [5, 0], [9, 0]],
];
/// Sources kept for the finer levels beyond `best_sources`.
const SPARE_SOURCES: usize = 2;
/// Planes seen at less than this cosine are not tried: the window degenerates.
const MIN_FACING: f32 = 0.1;

/// Planes drawn at random: inverse depth uniform over the range, normals within 60 degrees of the
/// sightline.
pub(super) fn random_field(pairs: &Pairs, range: [f64; 2], seed: u64) -> Field {
    let size = pairs.reference.size;
    let planes = (0..size[0] * size[1])
        .map(|i| {
            let mut noise = Noise::new(seed, 0, i as u64);
            let (near, far) = (1.0 / range[0] as f32, 1.0 / range[1] as f32);
            let w = far + noise.unit() * (near - far);
            let (u, v) = ((i % size[0]) as f32, (i / size[0]) as f32);
            let ray = [(u - pairs.k[2]) / pairs.k[0], (v - pairs.k[3]) / pairs.k[1]];
            let tilt = [noise.signed(), noise.signed()];
            InversePlane::from_normal(w, [tilt[0] - ray[0], tilt[1] - ray[1], -1.0], pairs.k, u, v)
        })
        .collect();
    Field::new(size, planes)
}

/// `iterations` rounds over both colours.
pub(super) fn run(
    pairs: &Pairs,
    mut field: Field,
    range: [f64; 2],
    iterations: usize,
    seed: u64,
    options: &DenseOptions,
) -> Field {
    let search = PlaneSearch { pairs, range: range.map(|d| 1.0 / d as f32), seed, options };
    search.rescore(&mut field);
    for iteration in 0..iterations {
        for colour in 0..2 {
            search.sweep(&mut field, iteration, colour);
        }
    }
    search.choose_sources(&mut field);
    field
}

/// Take the planes that other frames offer where they explain the views better.
pub(super) fn accept(
    pairs: &Pairs,
    field: &mut Field,
    offers: &[Option<InversePlane>],
    range: [f64; 2],
    options: &DenseOptions,
) {
    let search = PlaneSearch { pairs, range: range.map(|d| 1.0 / d as f32), seed: 0, options };
    let w = field.size[0];
    let keep = options.best_sources + SPARE_SOURCES;
    let pixels = field.planes.par_iter_mut().zip(&mut field.cost).zip(&mut field.sources);
    pixels.zip(offers).enumerate().for_each(|(i, (((plane, cost), sources), offer))| {
        let (Some(offer), Some(patch)) = (offer, WindowPatch::new(pairs.reference, i % w, i / w))
        else {
            return;
        };
        let at = [(i % w) as f32, (i / w) as f32];
        let before = *cost;
        search.attempt(&PatchWindow { patch: &patch, at, sources: ALL }, *offer, plane, cost);
        if *cost < before {
            *sources = patch.speaking(pairs, plane, ALL, keep, options);
        }
    });
}

struct PlaneSearch<'a> {
    pairs: &'a Pairs<'a>,
    /// Largest and smallest inverse depth.
    range: [f32; 2],
    seed: u64,
    options: &'a DenseOptions,
}

/// A pixel with its window and the sources it is compared with.
struct PatchWindow<'a> {
    patch: &'a WindowPatch,
    at: [f32; 2],
    sources: u16,
}

impl PlaneSearch<'_> {
    fn rescore(&self, field: &mut Field) {
        let w = field.size[0];
        let (planes, sources) = (&field.planes, &field.sources);
        field.cost.par_iter_mut().enumerate().for_each(|(i, cost)| {
            *cost = WindowPatch::new(self.pairs.reference, i % w, i / w)
                .map_or(NONE, |p| p.score(self.pairs, &planes[i], sources[i], self.options, NONE));
        });
    }

    /// Keep the sources that agree with what was found: a finer level need not ask the others.
    fn choose_sources(&self, field: &mut Field) {
        let w = field.size[0];
        let keep = self.options.best_sources + SPARE_SOURCES;
        let planes = &field.planes;
        field.sources.par_iter_mut().enumerate().for_each(|(i, sources)| {
            if let Some(patch) = WindowPatch::new(self.pairs.reference, i % w, i / w) {
                *sources = patch.speaking(self.pairs, &planes[i], *sources, keep, self.options);
            }
        });
    }

    /// Update the pixels with `(x + y) % 2 == colour` from a copy of the others.
    fn sweep(&self, field: &mut Field, iteration: usize, colour: usize) {
        let old = field.clone();
        let w = field.size[0];
        field.planes.par_chunks_mut(w).zip(field.cost.par_chunks_mut(w)).enumerate().for_each(
            |(y, (planes, costs))| {
                for x in ((y + colour) % 2..w).step_by(2) {
                    self.update(&old, [x, y], iteration, &mut planes[x], &mut costs[x]);
                }
            },
        );
    }

    fn update(
        &self,
        old: &Field,
        [x, y]: [usize; 2],
        iteration: usize,
        plane: &mut InversePlane,
        cost: &mut f32,
    ) {
        let Some(patch) = WindowPatch::new(self.pairs.reference, x, y) else { return };
        let at = [x as f32, y as f32];
        let window = PatchWindow { patch: &patch, at, sources: old.sources[y * old.size[0] + x] };
        let mut tried = [*plane; NEIGHBOURHOODS.len() + 1];
        let mut count = 1;
        for neighbourhood in NEIGHBOURHOODS {
            let Some(candidate) = best_neighbour(old, [x, y], neighbourhood) else { continue };
            // Neighbours mostly hold one plane, handed on.
            if tried[..count].iter().all(|plane| !alike(plane, &candidate)) {
                tried[count] = candidate;
                count += 1;
                self.attempt(&window, candidate, plane, cost);
            }
        }
        let pixel = (y * old.size[0] + x) as u64;
        let mut noise = Noise::new(self.seed, 1 + iteration as u64, pixel);
        let reach = 0.5f32.powi(iteration as i32 + 1);
        for kind in 0..3 {
            let candidate = self.perturbed(plane, at, kind, reach, &mut noise);
            self.attempt(&window, candidate, plane, cost);
        }
    }

    /// Take the candidate where it explains the other views better.
    fn attempt(
        &self,
        window: &PatchWindow,
        candidate: InversePlane,
        plane: &mut InversePlane,
        cost: &mut f32,
    ) {
        if self.feasible(&candidate, window.at) {
            let sources = window.sources;
            let score = window.patch.score(self.pairs, &candidate, sources, self.options, *cost);
            if score < *cost {
                (*plane, *cost) = (candidate, score);
            }
        }
    }

    /// Change inverse depth (kind 0), slope (1), or both (2).
    fn perturbed(
        &self,
        plane: &InversePlane,
        [u, v]: [f32; 2],
        kind: usize,
        reach: f32,
        noise: &mut Noise,
    ) -> InversePlane {
        let k = self.pairs.k;
        let span = 0.25 * (self.range[0] - self.range[1]);
        let w = plane.w + if kind == 1 { 0.0 } else { noise.signed() * reach * span };
        if kind == 0 {
            return InversePlane { w, ..*plane };
        }
        let n = plane.normal(k, u, v);
        let turned = n.map(|c| c + noise.signed() * reach);
        InversePlane::from_normal(w, turned, k, u, v)
    }

    fn feasible(&self, plane: &InversePlane, [u, v]: [f32; 2]) -> bool {
        plane.w > self.range[1]
            && plane.w < self.range[0]
            && plane.facing(self.pairs.k, u, v) > MIN_FACING
    }
}

/// Whether two planes differ by less than what a window can tell: a fraction of the depth at its
/// centre and across it.
fn alike(a: &InversePlane, b: &InversePlane) -> bool {
    const FRACTION: f32 = 1e-4;
    const ACROSS: f32 = 3.0;
    let bound = FRACTION * a.w;
    (a.w - b.w).abs() < bound
        && ACROSS * (a.a - b.a).abs() < bound
        && ACROSS * (a.b - b.b).abs() < bound
}

/// The plane of the cheapest pixel of a neighbourhood, as seen from `(x, y)`.
fn best_neighbour(old: &Field, [x, y]: [usize; 2], offsets: &[[i32; 2]]) -> Option<InversePlane> {
    let [w, h] = old.size.map(|s| s as i32);
    let mut best: Option<(f32, InversePlane)> = None;
    for &[dx, dy] in offsets {
        let (nx, ny) = (x as i32 + dx, y as i32 + dy);
        if nx < 0 || ny < 0 || nx >= w || ny >= h {
            continue;
        }
        let i = (ny * w + nx) as usize;
        if old.cost[i] < best.map_or(NONE, |b| b.0) {
            best = Some((old.cost[i], old.planes[i].moved(-dx as f32, -dy as f32)));
        }
    }
    best.map(|b| b.1)
}
