//! Poses from which an alignment without landmarks starts, and those that come of them.
//!
//! The seen side of the template is turned to every direction and spun about it, and put over
//! places all over the preoperative surface; a few steps each on a coarse surface, the best ones
//! refined.

use super::align::{Aligned, Schedule, refine};
use super::landmarks::LandmarkPair;
use super::options::ScaleRule;
use super::target::{SurfaceSample, Target, extent, samples};
use crate::geometry::{Point3, Similarity, Vector3};
use crate::mesh::Mesh;
use crate::mesh::decimate::decimate;
use nalgebra::{Translation3, Unit, UnitQuaternion};
use rayon::prelude::*;

/// Directions to which the seen side is turned, and turns about each.
const DIRECTIONS: [usize; 2] = [32, 10];
/// Places over which the middle of the template is put, and turns at each.
const PLACES: [usize; 2] = [48, 8];
/// Points of the template in the search.
const COARSE: usize = 100;
/// Vertices of the preoperative surface in the search.
const COARSE_TARGET: usize = 1000;
/// Cuts of the loss in the search, of the template's size: of all starts first, then of the best.
const CUTS: [f64; 3] = [0.35, 0.2, 0.12];
/// Steps at each cut.
const STEPS: usize = 5;
/// Starts that go beyond the first cut.
const PROMISING: usize = 160;
/// Poses that are refined.
const REFINED: usize = 16;

/// What the search is given besides the surfaces.
pub(super) struct StartSearch<'a> {
    pub landmarks: &'a [LandmarkPair],
    pub schedule: Schedule,
    /// Called after each of `total` shares of the work.
    pub step: &'a (dyn Fn(usize, usize) + Sync),
}

/// Poses of the template that fit best, the best first.
pub(super) fn search(
    template: &Mesh,
    target: &Target,
    fine: &[SurfaceSample],
    how: &StartSearch,
) -> Vec<Aligned> {
    let coarse_mesh = match target.mesh.positions.len() > COARSE_TARGET {
        true => decimate(target.mesh, COARSE_TARGET).map(|d| d.mesh),
        false => None,
    };
    let coarse_target = Target::new(coarse_mesh.as_ref().unwrap_or(target.mesh));
    let points = samples(template, COARSE);
    let starts = starts(&points, &samples(target.mesh, 2000), how.schedule.scale);
    let (_, size) = extent(points.iter().map(|s| &s.point));
    let total = starts.len() + PROMISING + REFINED;
    let rough = |poses: &[Similarity], cut: [f64; 2], done: usize| {
        let schedule = Schedule { cut: cut.map(|c| c * size), steps: STEPS, ..how.schedule };
        let mut tried: Vec<Aligned> = Vec::with_capacity(poses.len());
        for chunk in poses.chunks(80) {
            let more =
                chunk.par_iter().map(|s| refine(&coarse_target, &points, &[], *s, &schedule));
            tried.extend(more.collect::<Vec<_>>());
            (how.step)(done + tried.len(), total);
        }
        // Stable: of equal misfits the first start.
        let misfit = |a: &Aligned| misfit_at(a, schedule.cut[1]);
        tried.sort_by(|a, b| misfit(a).total_cmp(&misfit(b)));
        tried
    };
    let first = rough(&starts, [CUTS[0]; 2], 0);
    let best: Vec<Similarity> = first.iter().take(PROMISING).map(|a| a.similarity).collect();
    let chosen = distinct(rough(&best, [CUTS[1], CUTS[2]], starts.len()), &points, size);
    let mut refined: Vec<Aligned> = chosen
        .par_iter()
        .map(|a| refine(target, fine, how.landmarks, a.similarity, &how.schedule))
        .collect();
    (how.step)(total, total);
    best_first(&mut refined);
    refined
}

/// Sort by the misfit at the smallest cut of all: with a wide one of its own a bad pose looks good.
pub(super) fn best_first(poses: &mut [Aligned]) {
    let cut = poses.iter().map(|a| a.cut).fold(f64::INFINITY, f64::min);
    poses.sort_by(|a, b| misfit_at(a, cut).total_cmp(&misfit_at(b, cut)));
}

/// Mean loss of the samples were `cut` (template units) where it gives in.
pub(super) fn misfit_at(aligned: &Aligned, cut: f64) -> f64 {
    let limit = (cut * aligned.similarity.scaling()).powi(2);
    let share = |d: &Option<f64>| d.map_or(1.0, |d| d * d / (limit + d * d));
    aligned.distances.iter().map(share).sum::<f64>() / aligned.distances.len().max(1) as f64
}

/// The first [`REFINED`] that are not the same pose.
fn distinct(tried: Vec<Aligned>, points: &[SurfaceSample], size: f64) -> Vec<Aligned> {
    let mut kept: Vec<Aligned> = Vec::new();
    for aligned in tried {
        let scale = aligned.similarity.scaling();
        let near = |other: &Aligned| {
            apart(&aligned.similarity, &other.similarity, points) < 0.05 * size * scale
        };
        if !kept.iter().any(near) {
            kept.push(aligned);
        }
        if kept.len() == REFINED {
            break;
        }
    }
    kept
}

/// Root mean square distance of the samples between two poses, mm.
pub(super) fn apart(a: &Similarity, b: &Similarity, samples: &[SurfaceSample]) -> f64 {
    let square = |s: &SurfaceSample| (a * s.point - b * s.point).norm_squared();
    (samples.iter().map(square).sum::<f64>() / samples.len().max(1) as f64).sqrt()
}

fn starts(found: &[SurfaceSample], metric: &[SurfaceSample], rule: ScaleRule) -> Vec<Similarity> {
    let facing = found.iter().map(|f| f.normal).sum::<Vector3>();
    let (middle, size) = extent(found.iter().map(|f| &f.point));
    if size.is_nan() || size <= 0.0 || metric.is_empty() {
        return Vec::new();
    }
    // A closed template faces nowhere: any axis will do.
    let facing = Unit::try_new(facing, 1e-9).unwrap_or_else(Vector3::z_axis);
    let turned = Turned { facing, middle, size, rule };
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let mut out = Vec::new();
    for i in 0..DIRECTIONS[0] {
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / DIRECTIONS[0] as f64;
        let (r, a) = ((1.0 - z * z).sqrt(), golden * i as f64);
        let direction = Unit::new_normalize(Vector3::new(r * a.cos(), r * a.sin(), z));
        let side: Vec<&Point3> =
            metric.iter().filter(|m| m.normal.dot(&direction) > 0.2).map(|m| &m.point).collect();
        let (target, target_size) = extent(side.iter().copied());
        turned.spun(&mut out, &direction, &target, target_size / size, DIRECTIONS[1]);
    }
    let (_, whole) = extent(metric.iter().map(|m| &m.point));
    for k in 0..PLACES[0] {
        let place = &metric[(k * metric.len() + metric.len() / 2) / PLACES[0] % metric.len()];
        let Some(direction) = Unit::try_new(place.normal, 1e-9) else { continue };
        // A part of the organ: about half its size.
        turned.spun(&mut out, &direction, &place.point, 0.5 * whole / size, PLACES[1]);
    }
    out
}

struct Turned {
    facing: Unit<Vector3>,
    middle: Point3,
    size: f64,
    rule: ScaleRule,
}

impl Turned {
    fn spun(
        &self,
        out: &mut Vec<Similarity>,
        direction: &Unit<Vector3>,
        target: &Point3,
        scale: f64,
        spins: usize,
    ) {
        let [low, high] = self.rule.bounds();
        let scale = if self.rule.is_free() { scale } else { 1.0_f64.clamp(low, high) };
        if !(scale.is_finite() && scale * self.size > 0.0) {
            return;
        }
        let turn =
            UnitQuaternion::rotation_between_axis(&self.facing, direction).unwrap_or_else(|| {
                UnitQuaternion::from_axis_angle(&across(&self.facing), std::f64::consts::PI)
            });
        for spin in 0..spins {
            let angle = std::f64::consts::TAU * spin as f64 / spins as f64;
            let turn = UnitQuaternion::from_axis_angle(direction, angle) * turn;
            let shift = target.coords - scale * (turn * self.middle.coords);
            out.push(Similarity::from_parts(Translation3::from(shift), turn, scale));
        }
    }
}

fn across(axis: &Unit<Vector3>) -> Unit<Vector3> {
    let other = if axis.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    Unit::new_normalize(axis.cross(&other))
}
