//! What one frame has found, offered to the others: a surface that a frame sees at a grazing angle,
//! with few pixels and little parallax to its neighbours, another may see from the front.

use super::plane::{Field, InversePlane};
use super::view::StereoPyramid;
use crate::geometry::{Isometry, Point3};
use nalgebra::Vector3;

/// Cost below which a plane is offered to other frames.
const OFFERED: f32 = 0.3;

/// For every pixel of the grid of frame `to`, the plane of least cost that the other frames offer.
pub(super) fn offers(
    views: &[StereoPyramid],
    fields: &[Field],
    to: usize,
    others: &[usize],
) -> Vec<Option<InversePlane>> {
    let [w, h] = fields[to].size;
    let mut best: Vec<Option<(f32, InversePlane)>> = vec![None; w * h];
    for &from in others {
        let field = &fields[from];
        let way = Way::new(&views[from], &views[to]);
        for i in (0..field.planes.len()).filter(|&i| field.cost[i] < OFFERED) {
            let (cost, plane) = (field.cost[i], &field.planes[i]);
            let at = [i % field.size[0], i / field.size[0]].map(|v| v as f32);
            let Some(landing) = way.landing(at, plane) else { continue };
            let place = &mut best[landing.pixel];
            if place.is_none_or(|(least, _)| cost < least)
                && let Some(plane) = way.plane(at, plane, &landing)
            {
                *place = Some((cost, plane));
            }
        }
    }
    best.into_iter().map(|offer| offer.map(|(_, plane)| plane)).collect()
}

/// From the grid of one frame to that of another.
struct Way {
    /// `to_from_from`.
    motion: Isometry,
    own: [f32; 4],
    target: [f32; 4],
    size: [usize; 2],
}

/// Where the centre of a plane appears: place, nearest pixel and its index, inverse depth.
struct Landing {
    place: [f32; 2],
    nearest: [f32; 2],
    pixel: usize,
    w: f32,
}

impl Way {
    fn new(from: &StereoPyramid, to: &StereoPyramid) -> Self {
        let grid = |p: &StereoPyramid| p.levels[1].k.map(|v| v as f32);
        let motion = to.posed.pose * from.posed.pose.inverse();
        Self { motion, own: grid(from), target: grid(to), size: to.levels[1].size }
    }

    fn landing(&self, [x, y]: [f32; 2], plane: &InversePlane) -> Option<Landing> {
        let ([fx, fy, cx, cy], k) = (self.own, self.target);
        let depth = 1.0 / f64::from(plane.w);
        let ray = [(x - cx) / fx, (y - cy) / fy].map(f64::from);
        let p = self.motion * Point3::new(ray[0] * depth, ray[1] * depth, depth);
        let (u, v) = (k[0] * (p.x / p.z) as f32 + k[2], k[1] * (p.y / p.z) as f32 + k[3]);
        let nearest = [u.round(), v.round()];
        let [w, h] = self.size;
        let within = |c: f32, n: usize| c >= 0.0 && c < n as f32;
        let inside = p.z > 0.0 && within(nearest[0], w) && within(nearest[1], h);
        inside.then(|| Landing {
            place: [u, v],
            nearest,
            pixel: nearest[1] as usize * w + nearest[0] as usize,
            w: 1.0 / p.z as f32,
        })
    }

    /// The plane at the pixel where it lands; `None` where it would be seen from behind.
    fn plane(&self, at: [f32; 2], plane: &InversePlane, l: &Landing) -> Option<InversePlane> {
        let normal = Vector3::from(plane.normal(self.own, at[0], at[1]).map(f64::from));
        let normal = self.motion.rotation * normal;
        let n = [0, 1, 2].map(|c| normal[c] as f32);
        let ([u, v], [x, y]) = (l.place, l.nearest);
        let seen = InversePlane::from_normal(l.w, n, self.target, u, v).moved(x - u, y - v);
        (seen.w > 0.0 && seen.facing(self.target, x, y) > 0.0).then_some(seen)
    }
}
