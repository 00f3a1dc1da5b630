//! Do the depth maps agree? Project a point into another frame, and what that frame sees back.

use super::neighbours::sees;
use super::options::DenseOptions;
use super::plane::Field;
use super::view::Pyramid;
use crate::geometry::Point3;
use rayon::prelude::*;

/// How many other frames agree with each pixel of each frame.
pub(super) fn check(views: &[Pyramid], fields: &[Field], options: &DenseOptions) -> Vec<Vec<u8>> {
    (0..views.len())
        .into_par_iter()
        .map(|i| {
            let [w, h] = fields[i].size;
            (0..w * h).map(|p| count(views, fields, i, [p % w, p / w], options)).collect()
        })
        .collect()
}

/// Whether a pixel's plane has passed its own test of correlation.
pub(super) fn correlates(field: &Field, pixel: usize, options: &DenseOptions) -> bool {
    field.planes[pixel].w > 0.0 && (field.cost[pixel] as f64) < 1.0 - options.min_correlation
}

fn count(
    views: &[Pyramid],
    fields: &[Field],
    i: usize,
    [x, y]: [usize; 2],
    options: &DenseOptions,
) -> u8 {
    let pixel = y * fields[i].size[0] + x;
    if !correlates(&fields[i], pixel, options) {
        return 0;
    }
    let at = [x as f64, y as f64];
    let world = lifted(&views[i], at, fields[i].planes[pixel].w as f64);
    let agree = |j: &usize| {
        let j = *j;
        j != i
            && sees(&views[j], &world)
            && agrees(&views[i], at, &world, &views[j], &fields[j], options)
    };
    (0..views.len()).filter(agree).count().min(255) as u8
}

/// World point of a pixel of the depth grid.
pub(super) fn lifted(view: &Pyramid, [u, v]: [f64; 2], w: f64) -> Point3 {
    let [fx, fy, cx, cy] = view.levels[1].k;
    let point = Point3::new((u - cx) / fx, (v - cy) / fy, 1.0) / w;
    view.pose.inverse_transform_point(&point)
}

fn agrees(
    from: &Pyramid,
    at: [f64; 2],
    world: &Point3,
    other: &Pyramid,
    field: &Field,
    options: &DenseOptions,
) -> bool {
    let Some(([u, v], z)) = projected(other, world) else { return false };
    let (x, y) = (u.round(), v.round());
    if x < 0.0 || y < 0.0 || x >= field.size[0] as f64 || y >= field.size[1] as f64 {
        return false;
    }
    let pixel = y as usize * field.size[0] + x as usize;
    if !correlates(field, pixel, options) {
        return false;
    }
    let w = field.planes[pixel].at((u - x) as f32, (v - y) as f32) as f64;
    if w <= 0.0 || (w * z - 1.0).abs() > options.max_relative_depth {
        return false;
    }
    let back = projected(from, &lifted(other, [u, v], w));
    back.is_some_and(|([bu, bv], _)| (bu - at[0]).hypot(bv - at[1]) < options.max_reprojection_px)
}

/// Pixel on the depth grid and depth of a world point in front of the camera.
fn projected(view: &Pyramid, world: &Point3) -> Option<([f64; 2], f64)> {
    let p = view.pose * world;
    let [fx, fy, cx, cy] = view.levels[1].k;
    (p.z > 0.0).then(|| ([fx * p.x / p.z + cx, fy * p.y / p.z + cy], p.z))
}
