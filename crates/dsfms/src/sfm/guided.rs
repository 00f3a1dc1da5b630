//! Guided matching: with poses known, a feature is compared only along its epipolar line, where
//! fewer look-alikes compete and the ratio test can be milder.

use super::essential::{epipolar_angle, essential_matrix};
use super::matching::{DescriptorMatch, UnitDescriptors, distance};
use crate::geometry::{Isometry, Vector3};

/// Sightlines and descriptors of one view.
#[derive(Clone, Debug)]
pub struct GuidedView {
    /// `camera_from_world`.
    pub pose: Isometry,
    /// Unit sightline of every feature, camera axes; `None` where the lens has no inverse.
    pub rays: Vec<Option<Vector3>>,
    /// Unit descriptors in the same order.
    pub descriptors: UnitDescriptors,
}

/// Limits of a guided match.
#[derive(Clone, Copy, Debug)]
pub struct GuidedLimits {
    /// Largest angle between a sightline and the epipolar plane, radians.
    pub angle: f64,
    /// Largest ratio of the distances to the nearest and second nearest along the line.
    pub ratio: f32,
    /// Largest descriptor distance.
    pub max_distance: f32,
    /// Smallest and largest distance of a point from the first camera, length units.
    pub depth: [f64; 2],
}

/// Mutual nearest descriptors among features on each other's epipolar lines, ordered by `a`;
/// none for views without a baseline.
pub(crate) fn match_guided(
    a: &GuidedView,
    b: &GuidedView,
    limits: &GuidedLimits,
) -> Vec<DescriptorMatch> {
    let b_from_a = b.pose * a.pose.inverse();
    let baseline = b_from_a.translation.vector.norm();
    if baseline.is_nan() || baseline <= 1e-9 {
        return Vec::new();
    }
    let e = essential_matrix(&b_from_a) / baseline;
    let empty = (u32::MAX, f32::MIN, f32::MIN);
    let (mut forward, mut backward) = (vec![empty; a.rays.len()], vec![empty; b.rays.len()]);
    let bundles: Vec<RayLanes> = b.rays.chunks(LANES).map(RayLanes::new).collect();
    for (i, ray) in a.rays.iter().enumerate() {
        let Some(ray) = ray else { continue };
        let Some(window) = EpipolarWindow::new(&b_from_a, ray, &(e * ray), limits) else {
            continue;
        };
        let row = a.descriptors.row(i);
        for (k, bundle) in bundles.iter().enumerate() {
            let mut inside = window.contains(bundle);
            while inside != 0 {
                let j = k * LANES + inside.trailing_zeros() as usize;
                inside &= inside - 1;
                let dot = dot(row, b.descriptors.row(j));
                offer(&mut forward[i], j as u32, dot);
                offer(&mut backward[j], i as u32, dot);
            }
        }
    }
    let clear = |c: &(u32, f32, f32)| distance(c.1) < limits.ratio * distance(c.2);
    let keep = |(i, best): (usize, &(u32, f32, f32))| {
        let back = backward.get(best.0 as usize)?;
        let good = back.0 as usize == i
            && distance(best.1) <= limits.max_distance
            && clear(best)
            && clear(back);
        let (ray, other) = (a.rays[i].as_ref()?, b.rays[best.0 as usize].as_ref()?);
        let near = epipolar_angle(&e, ray, other).abs() <= limits.angle;
        (good && near).then(|| DescriptorMatch {
            a: i as u32,
            b: best.0,
            distance: distance(best.1),
        })
    };
    forward.iter().enumerate().filter_map(keep).collect()
}

/// Keep the best two.
fn offer(slot: &mut (u32, f32, f32), index: u32, dot: f32) {
    if dot > slot.1 {
        *slot = (index, dot, slot.1);
    } else if dot > slot.2 {
        slot.2 = dot;
    }
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    // Sixteen running sums: a fixed order that still fills the vector registers.
    let mut sums = [0.0f32; 16];
    for (x, y) in a.chunks_exact(16).zip(b.chunks_exact(16)) {
        for k in 0..16 {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().sum()
}

/// Sightlines looked at together.
const LANES: usize = 16;

/// Sightlines by coordinate; not a number where there is none.
struct RayLanes([[f64; LANES]; 3]);

impl RayLanes {
    fn new(rays: &[Option<Vector3>]) -> Self {
        let ray = |l: usize| rays.get(l).copied().flatten();
        let axis = |k: usize| std::array::from_fn(|l| ray(l).map_or(f64::NAN, |ray| ray[k]));
        Self([axis(0), axis(1), axis(2)])
    }
}

/// The part of the second view in which the first view's sightline can appear: near the epipolar
/// plane, between the directions of the nearest and the farthest point.
struct EpipolarWindow {
    normal: Vector3,
    middle: Vector3,
    sine: f64,
    cosine: f64,
}

impl EpipolarWindow {
    fn new(
        b_from_a: &Isometry,
        ray: &Vector3,
        normal: &Vector3,
        limits: &GuidedLimits,
    ) -> Option<Self> {
        let ends = limits.depth.map(|d| {
            (b_from_a.rotation * (ray * d) + b_from_a.translation.vector).try_normalize(1e-12)
        });
        let (near, far) = (ends[0]?, ends[1]?);
        let middle = (near + far).try_normalize(1e-12)?;
        let half = 0.5 * near.angle(&far) + 2.0 * limits.angle;
        Some(Self {
            normal: normal.try_normalize(1e-12)?,
            middle,
            // The angle is shared between both sightlines, hence up to √2 more on one side.
            sine: (std::f64::consts::SQRT_2 * limits.angle).sin(),
            cosine: half.min(std::f64::consts::PI).cos(),
        })
    }

    /// Which sightlines of the bundle lie in it, one bit each.
    #[inline]
    fn contains(&self, RayLanes([x, y, z]): &RayLanes) -> u32 {
        let (n, m) = (&self.normal, &self.middle);
        let mut inside = [false; LANES];
        for l in 0..LANES {
            let across = n.x * x[l] + n.y * y[l] + n.z * z[l];
            let along = m.x * x[l] + m.y * y[l] + m.z * z[l];
            inside[l] = (across.abs() <= self.sine) & (along >= self.cosine);
        }
        if !inside.iter().fold(false, |any, &one| any | one) {
            return 0;
        }
        (0..LANES).fold(0, |bits, l| bits | u32::from(inside[l]) << l)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point3;
    use crate::sfm::random::Random;

    #[test]
    fn look_alikes_are_told_apart_by_the_epipolar_line() {
        let mut random = Random::new(4, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        let points: Vec<_> = (0..40)
            .map(|_| Point3::new(20.0 * unit(), 20.0 * unit(), 50.0 + 5.0 * unit()))
            .collect();
        // All descriptors are nearly the same: unguided, the ratio test would refuse every match.
        let descriptors: Vec<[u8; 128]> =
            (0..40).map(|i| std::array::from_fn(|k| if k == i { 60 } else { 40 })).collect();
        let view = |pose: Isometry| GuidedView {
            pose,
            rays: points.iter().map(|p| Some((pose * p).coords.normalize())).collect(),
            descriptors: UnitDescriptors::new(&descriptors),
        };
        let views = [view(Isometry::identity()), view(Isometry::translation(-4.0, 1.0, 0.5))];
        let limits =
            GuidedLimits { angle: 1e-4, ratio: 0.9, max_distance: 0.7, depth: [30.0, 90.0] };
        let found = match_guided(&views[0], &views[1], &limits);
        assert!(found.len() >= 35 && found.iter().all(|m| m.a == m.b), "{}", found.len());
    }
}
