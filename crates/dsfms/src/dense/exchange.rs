//! What one frame has found, offered to the others: a surface that a frame sees at a grazing angle,
//! with few pixels and little parallax to its neighbours, another may see from the front.

use super::consistency::lifted;
use super::plane::{Field, InversePlane};
use super::view::Pyramid;
use nalgebra::Vector3;

/// Cost below which a plane is offered to other frames.
const OFFERED: f32 = 0.3;

/// For every pixel of the grid of frame `to`, the plane of least cost that the other frames offer.
pub(super) fn offers(
    views: &[Pyramid],
    fields: &[Field],
    to: usize,
    others: &[usize],
) -> Vec<Option<InversePlane>> {
    let [w, h] = fields[to].size;
    let mut best: Vec<Option<(f32, InversePlane)>> = vec![None; w * h];
    for &from in others {
        let field = &fields[from];
        let offered = (0..field.planes.len()).filter(|&i| field.cost[i] < OFFERED);
        for (i, cost) in offered.map(|i| (i, field.cost[i])) {
            let Some((pixel, plane)) = moved(&views[from], field, i, &views[to]) else { continue };
            let place = &mut best[pixel];
            if place.is_none_or(|(least, _)| cost < least) {
                *place = Some((cost, plane));
            }
        }
    }
    best.into_iter().map(|offer| offer.map(|(_, plane)| plane)).collect()
}

/// The plane of pixel `i` of a frame as another frame sees it, and that frame's nearest pixel.
fn moved(from: &Pyramid, field: &Field, i: usize, to: &Pyramid) -> Option<(usize, InversePlane)> {
    let (x, y) = (i % field.size[0], i / field.size[0]);
    let plane = &field.planes[i];
    let own = from.levels[1].k.map(|v| v as f32);
    let p = to.pose * lifted(from, [x as f64, y as f64], f64::from(plane.w));
    let target = &to.levels[1];
    let k = target.k.map(|v| v as f32);
    let (u, v) = (k[0] * (p.x / p.z) as f32 + k[2], k[1] * (p.y / p.z) as f32 + k[3]);
    let (cx, cy) = (u.round(), v.round());
    let [w, h] = target.size;
    let inside = p.z > 0.0 && cx >= 0.0 && cy >= 0.0 && cx < w as f32 && cy < h as f32;
    let normal = Vector3::from(plane.normal(own, x as f32, y as f32).map(f64::from));
    let normal = to.pose.rotation * from.pose.rotation.inverse() * normal;
    let n = [0, 1, 2].map(|c| normal[c] as f32);
    let seen = InversePlane::from_normal(1.0 / p.z as f32, n, k, u, v).moved(cx - u, cy - v);
    (inside && seen.w > 0.0 && seen.facing(k, cx, cy) > 0.0)
        .then(|| (cy as usize * w + cx as usize, seen))
}
