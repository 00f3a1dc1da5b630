//! The outline of the organ in every frame.
//!
//! The labels of the depth maps tell roughly where: a window of stereo that lies across an
//! occluding contour takes the depth of the side of more texture, so a depth map is off by up to
//! the window's size. The image tells exactly where: between what the labels hold well inside and
//! well outside, the outline runs along the strongest edge. Both sides go on at the price of the
//! edges they cross (shortest paths), and the outline is where they meet.

use super::depth_map::DepthMap;
use crate::camera::{Camera, PosedFrame};
use crate::geometry::Point2;
use crate::image::{Frame, Mask};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Px of the depth grid by which depth may run over an outline from inside: the width of the window
/// of stereo, less the pixel itself.
const BAND_PX: f64 = 6.0;
/// And from outside: where the rim is dim and the wall is not, the wall's depth wins on the coarser
/// levels, whose windows are twice as wide or more, and stays. Chosen, as [`DOUBT`], on
/// `rendered_scene` (`docs/results/template.md` has what other values give there); the generated
/// scenes confirm it.
const OUTER_PX: f64 = 2.0 * BAND_PX;
/// To go on from outside costs this times as much as from inside, so that where no edge is clear
/// the outline lies outside: one too far inside cuts the organ, one too far outside only holds it
/// less.
const DOUBT: u64 = 3;

/// Of every view where the organ is the first surface hit, on the frame's pixels; `organ`: the
/// same, roughly, on those of the depth maps. Masks of the views stay as they are.
pub fn outlines(organ: &[Mask], views: &[PosedFrame], maps: &[DepthMap]) -> Vec<Mask> {
    let views = organ.par_iter().zip(views).zip(maps);
    views.map(|((organ, view), map)| outline(organ, view, map)).collect()
}

fn outline(organ: &Mask, view: &PosedFrame, map: &DepthMap) -> Mask {
    if let Some(given) = view.organ {
        return given.clone();
    }
    let (own, other) = (organ.erode(BAND_PX), organ.dilate(OUTER_PX).complement());
    let [own, other] = [own, other].map(|mask| on_frame(&mask, view, map));
    flooded(&gradient(view.frame), own, &other)
}

/// The pixels left, right, above and below, as far as they are in the image.
fn beside(i: usize, [w, h]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (x, y) = (i % w, i / w);
    let left = (x > 0).then(|| i - 1);
    let right = (x + 1 < w).then(|| i + 1);
    let above = (y > 0).then(|| i - w);
    let below = (y + 1 < h).then(|| i + w);
    [left, right, above, below].into_iter().flatten()
}

/// A mask of the depth grid on the pixels of the frame.
fn on_frame(mask: &Mask, view: &PosedFrame, map: &DepthMap) -> Mask {
    let [w, h] = view.camera.size;
    let shown = |i: usize| {
        let ray = view.camera.unproject(&Point2::new((i % w) as f64, (i / w) as f64))?;
        Some(mask.data[map.pixel(&ray.into())?])
    };
    Mask { size: [w, h], data: (0..w * h).map(|i| shown(i).unwrap_or(false)).collect() }
}

/// Steepness of the encoded image, all channels (Sobel).
fn gradient(frame: &Frame) -> Vec<u32> {
    let [w, h] = frame.size;
    let at = |x: usize, y: usize, dx: i32, dy: i32, c: usize| {
        let to = |v: usize, d: i32, n: usize| (v as i32 + d).clamp(0, n as i32 - 1) as usize;
        i32::from(frame.rgb[to(y, dy, h) * w + to(x, dx, w)][c])
    };
    let steepness = |i: usize| {
        let (x, y) = (i % w, i / w);
        let channel = |c: usize| {
            let across = |k: i32| at(x, y, 1, k, c) - at(x, y, -1, k, c);
            let along = |k: i32| at(x, y, k, 1, c) - at(x, y, k, -1, c);
            let weighed = |f: &dyn Fn(i32) -> i32| f(-1) + 2 * f(0) + f(1);
            weighed(&across).pow(2) + weighed(&along).pow(2)
        };
        (0..3).map(channel).sum::<i32>() as u32
    };
    (0..w * h).into_par_iter().map(steepness).collect()
}

/// `own` grown into what neither mask holds until the two meet: every pixel falls to the mask from
/// which the least steepness, summed over the way, leads to it; see [`DOUBT`].
fn flooded(steepness: &[u32], mut own: Mask, other: &Mask) -> Mask {
    let mut cost: Vec<u64> = vec![u64::MAX; own.data.len()];
    let mut front = BinaryHeap::new();
    for i in (0..cost.len()).filter(|&i| own.data[i] || other.data[i]) {
        cost[i] = 0;
        front.push(Reverse((0, i)));
    }
    while let Some(Reverse((so_far, i))) = front.pop() {
        if so_far > cost[i] {
            continue;
        }
        for n in beside(i, own.size) {
            let pace = if own.data[i] { 1 } else { DOUBT };
            let longer = so_far + pace * (u64::from(steepness[n]) + 1);
            if longer < cost[n] {
                cost[n] = longer;
                own.data[n] = own.data[i];
                front.push(Reverse((longer, n)));
            }
        }
    }
    own
}

#[cfg(test)]
mod tests {
    use super::super::Seeds;
    use super::super::plates::{PLATE, SIZE, WALL, camera, parted, plate, posed, scene};
    use super::*;

    #[test]
    fn a_plate_is_told_from_its_wall_and_its_outline_is_the_edge_in_the_image() {
        let (camera, (frames, maps)) = (camera(), scene(3.0, PLATE[0]));
        let views = posed(&frames, &camera);
        let found = parted(&views, &maps, &Seeds::default());
        assert!(found.stepping > 0.9 && found.marked > 0.9, "{} {}", found.stepping, found.marked);
        for (i, mask) in outlines(&found.masks, &views, &maps).iter().enumerate() {
            let wrong = |p: &usize| {
                mask.data[*p] && !plate(i, *p, 1.5) || !mask.data[*p] && plate(i, *p, -1.5)
            };
            assert_eq!((0..mask.data.len()).filter(wrong).count(), 0, "frame {i}");
        }
    }

    #[test]
    fn no_depth_steps_on_one_surface() {
        let (camera, (frames, maps)) = (camera(), scene(0.0, WALL - 0.5));
        let found = parted(&posed(&frames, &camera), &maps, &Seeds::default());
        assert!(found.stepping < 0.1, "{}", found.stepping);
    }

    #[test]
    fn a_click_and_a_mask_say_what_the_organ_is() {
        let (camera, (frames, maps)) = (camera(), scene(0.0, PLATE[0]));
        let mut views = posed(&frames, &camera);
        // The corner of the wall that frame 2 shows at (8, 8).
        let wall = camera.unproject(&Point2::new(8.0, 8.0)).unwrap() * WALL;
        let clicked = {
            let seeds = Seeds { organ: vec![wall.into()], other: Vec::new() };
            parted(&views, &maps, &seeds).masks
        };
        assert!(clicked[2].at(8, 8) && !clicked[2].at(59, 44));
        let given =
            Mask { size: SIZE, data: (0..SIZE[0] * SIZE[1]).map(|p| plate(2, p, -2.0)).collect() };
        views[2].organ = Some(&given);
        let found = parted(&views, &maps, &Seeds::default()).masks;
        assert_eq!(outlines(&found, &views, &maps)[2], given);
        assert!(found[0].at(59 + 15, 44) && !found[0].at(8, 8), "the other frames are told too");
    }

    #[test]
    fn the_strongest_edge_decides_and_no_edge_falls_to_the_organ() {
        let row = |on: &[usize]| {
            let data = (0..12).map(|x| on.contains(&x)).collect();
            Mask { size: [12, 1], data }
        };
        let mut steepness = vec![1; 12];
        (steepness[3], steepness[5]) = (10, 1000);
        let reach = |steepness: &[u32]| {
            let found = flooded(steepness, row(&[0, 1]), &row(&[10, 11]));
            found.data.iter().filter(|&&own| own).count()
        };
        assert_eq!(reach(&steepness), 6, "past the faint edge, up to the strong one");
        // 2 a step from the organ, 6 from outside: pixel 7 costs 12 from the organ, 18 from
        // outside; pixel 8 14 and 12.
        assert_eq!(reach(&[1; 12]), 8);
    }
}
