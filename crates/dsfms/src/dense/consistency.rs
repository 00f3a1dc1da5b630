//! Do the depth maps agree? Project a point into another frame, and what that frame sees back.

use super::neighbours::sees;
use super::options::DenseOptions;
use super::plane::Field;
use super::view::StereoPyramid;
use crate::geometry::Point3;
use rayon::prelude::*;

/// Cosine below which a more grazing view earns no more tolerance.
const MIN_FACING: f32 = 0.25;

/// How many other frames agree with each pixel of each frame.
pub(super) fn check(
    views: &[StereoPyramid],
    fields: &[Field],
    options: &DenseOptions,
) -> Vec<Vec<u8>> {
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
    views: &[StereoPyramid],
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
    let others: Vec<usize> =
        (0..views.len()).filter(|&j| j != i && sees(&views[j], &world)).collect();
    let agree = |j: &&usize| agrees(&views[i], at, &world, &views[**j], &fields[**j], options);
    let count = others.iter().filter(agree).count();
    if count >= chance(others.len()) { count.min(255) as u8 } else { 0 }
}

/// Frames of `seeing` that must agree before it is no accident: wrong depths spread over the range
/// agree with one in a few per cent of the frames, so one of thirty says nothing.
fn chance(seeing: usize) -> usize {
    /// Above the few per cent, below what sees a place at a usable angle.
    const SHARE: f64 = 0.1;
    (SHARE * seeing as f64).round() as usize
}

/// World point of a pixel of the depth grid.
pub(super) fn lifted(view: &StereoPyramid, [u, v]: [f64; 2], w: f64) -> Point3 {
    let [fx, fy, cx, cy] = view.levels[1].k;
    let point = Point3::new((u - cx) / fx, (v - cy) / fy, 1.0) / w;
    view.posed.pose.inverse_transform_point(&point)
}

fn agrees(
    from: &StereoPyramid,
    at: [f64; 2],
    world: &Point3,
    other: &StereoPyramid,
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
    let plane = &field.planes[pixel];
    let w = plane.at((u - x) as f32, (v - y) as f32) as f64;
    // Seen at a grazing angle, a small step across the surface is a large one in depth.
    let facing = plane.facing(other.levels[1].k.map(|k| k as f32), x as f32, y as f32);
    let tolerance = options.max_relative_depth / facing.max(MIN_FACING) as f64;
    if w <= 0.0 || (w * z - 1.0).abs() > tolerance {
        return false;
    }
    let back = projected(from, &lifted(other, [u, v], w));
    back.is_some_and(|([bu, bv], _)| (bu - at[0]).hypot(bv - at[1]) < options.max_reprojection_px)
}

/// Pixel on the depth grid and depth of a world point in front of the camera.
fn projected(view: &StereoPyramid, world: &Point3) -> Option<([f64; 2], f64)> {
    let p = view.posed.pose * world;
    let [fx, fy, cx, cy] = view.levels[1].k;
    (p.z > 0.0).then(|| ([fx * p.x / p.z + cx, fy * p.y / p.z + cy], p.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_frames_one_is_an_accident() {
        assert_eq!([1, 4, 10, 16, 31].map(chance), [0, 0, 1, 2, 3]);
    }
}
