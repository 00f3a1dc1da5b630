//! What else may be meant by the organ, where its outline is a guess: the same energy under other
//! priors.

use super::labels::{LabelPrior, Labelling, NOTHING, Parting, USUAL};
use crate::image::Mask;

/// Priors, the likeliest meaning first: with the pieces that it borders on, less, more than what is
/// looked at, and what depth and folds alone enclose.
const OTHERS: [LabelPrior; 4] = [
    LabelPrior { apart: false, ..USUAL },
    LabelPrior { middle: 0.3, favour: -0.75, ..USUAL },
    LabelPrior { middle: 0.9, favour: 0.75, ..USUAL },
    LabelPrior { middle: 0.7, looks: 0.0, gaze: 1.0, ..USUAL },
];
/// Labellings that overlap by more are the same to a user.
const SAME: f64 = 0.9;
/// Shares of what the frames show below and above which a labelling tells nothing.
const SHOWN: [f64; 2] = [NOTHING, 0.95];

impl Parting<'_> {
    /// Labellings that differ clearly from `own`, from each other and from everything, at most
    /// `most`, those first whose border is marked best.
    pub fn others(&self, own: &Labelling, most: usize) -> Vec<Labelling> {
        let mut found: Vec<Labelling> = Vec::new();
        for prior in &OTHERS {
            let other = self.under(prior);
            let mut known = std::iter::once(own).chain(&found);
            if telling(&other.masks)
                && known.all(|known| overlap(&known.masks, &other.masks) < SAME)
            {
                found.push(other);
            }
        }
        found.sort_by(|a, b| b.marked.total_cmp(&a.marked));
        found.truncate(most);
        found
    }
}

/// Whether the masks hold neither everything nor nothing.
fn telling(masks: &[Mask]) -> bool {
    let own: usize = masks.iter().map(|m| m.data.iter().filter(|&&on| on).count()).sum();
    let all: usize = masks.iter().map(|m| m.data.len()).sum();
    let share = own as f64 / all.max(1) as f64;
    SHOWN[0] < share && share < SHOWN[1]
}

/// Intersection over union of two lists of masks of the same sizes; 1 where both are empty.
pub fn overlap(a: &[Mask], b: &[Mask]) -> f64 {
    let (mut both, mut either) = (0, 0);
    for (p, q) in a.iter().zip(b).flat_map(|(a, b)| a.data.iter().zip(&b.data)) {
        both += usize::from(*p && *q);
        either += usize::from(*p || *q);
    }
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}

#[cfg(test)]
mod tests {
    use super::super::plates::{PLATE, SIZE, WALL, camera, parted, plate, posed, scene};
    use super::super::{DepthMap, Seeds};
    use super::*;
    use crate::camera::Camera;
    use crate::geometry::{Point2, Point3};
    use crate::image::Frame;

    fn mask(inside: impl Fn(usize) -> bool) -> Mask {
        Mask { size: SIZE, data: (0..SIZE[0] * SIZE[1]).map(inside).collect() }
    }

    /// A smaller and brighter plate in the middle of the plate, nearer by a step.
    fn stepped() -> (Vec<Frame>, Vec<DepthMap>) {
        let (mut frames, mut maps) = scene(0.0, PLATE[0]);
        for (i, (frame, map)) in frames.iter_mut().zip(&mut maps).enumerate() {
            for p in (0..map.depth.len()).filter(|&p| plate(i, p, -10.0)) {
                map.depth[p] = (PLATE[0] - 3.0) as f32;
                frame.rgb[p] = [230, 200, 200];
            }
        }
        (frames, maps)
    }

    #[test]
    fn parts_that_may_be_meant_differ() {
        let (camera, (frames, maps)) = (camera(), stepped());
        let views = posed(&frames, &camera);
        let parting = Parting::new(&views, &maps, &Seeds::default(), &[]);
        let own = parting.best();
        let others = parting.others(&own, 2);
        assert!(!others.is_empty() && others.len() <= 2);
        let all: Vec<&Labelling> = std::iter::once(&own).chain(&others).collect();
        for (i, a) in all.iter().enumerate() {
            for b in &all[i + 1..] {
                assert!(overlap(&a.masks, &b.masks) < SAME);
            }
        }
        // Both plates are among them.
        for fat in [0.0, -10.0] {
            let true_masks: Vec<Mask> = (0..5).map(|i| mask(|p| plate(i, p, fat))).collect();
            let best = all.iter().map(|part| overlap(&part.masks, &true_masks)).fold(0.0, f64::max);
            assert!(best > 0.85, "{fat}: {best}");
        }
        assert_eq!(parting.others(&own, 1).len(), 1);
    }

    #[test]
    fn an_organ_that_looks_no_rarer_elsewhere_is_found_by_its_place() {
        // Four more pieces like the plate in the corners: of the middle and of the rest the same
        // share looks so.
        let (camera, (mut frames, mut maps)) = (camera(), scene(0.0, PLATE[0]));
        let corner = |p: usize| {
            let (x, y) = (p % SIZE[0], p / SIZE[0]);
            x.min(SIZE[0] - 1 - x).max(y.min(SIZE[1] - 1 - y)) < 24
        };
        for (i, (frame, map)) in frames.iter_mut().zip(&mut maps).enumerate() {
            for p in 0..map.depth.len() {
                let like = plate(i, p, -10.0) || corner(p);
                map.depth[p] = if like { PLATE[0] } else { WALL } as f32;
                let red = (p % 5) as u8;
                frame.rgb[p] = if like { [180 + red, 150, 120] } else { [60 + red, 60, 60] };
            }
        }
        let views = posed(&frames, &camera);
        let parting = Parting::new(&views, &maps, &Seeds::default(), &[]);
        let truth: Vec<Mask> = (0..5).map(|i| mask(|p| plate(i, p, -10.0))).collect();
        assert!(!telling(&parting.under(&USUAL).masks), "what the fallback is for");
        assert!(overlap(&parting.best().masks, &truth) > 0.95);
    }

    #[test]
    fn overlap_by_hand() {
        let row = |on: [bool; 4]| vec![Mask { size: [4, 1], data: on.to_vec() }];
        let (a, b) = (row([true, true, false, false]), row([false, true, true, false]));
        assert!((overlap(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(overlap(&row([false; 4]), &row([false; 4])), 1.0);
        assert!(!telling(&row([false; 4])) && !telling(&row([true; 4])) && telling(&a));
    }

    #[test]
    fn strokes_hold_in_every_frame() {
        let (camera, (frames, maps)) = (camera(), stepped());
        let views = posed(&frames, &camera);
        let place = |x: f64, y: f64, z: f64| -> Point3 {
            (camera.unproject(&Point2::new(x, y)).unwrap() * z).into()
        };
        // Frame 2 has its plates in the middle; the wall is organ, the plate is not.
        let wall: Vec<Point3> =
            (0..8).map(|k| place(8.0 + 13.0 * f64::from(k), 8.0, WALL)).collect();
        let other = vec![place(59.0, 44.0, PLATE[0] - 3.0), place(45.0, 44.0, PLATE[0])];
        let found = parted(&views, &maps, &Seeds { organ: wall, other });
        for i in 0..5 {
            let centre = (0..SIZE[0] * SIZE[1]).filter(|&p| plate(i, p, -10.0));
            assert!(centre.clone().count() > 0 && centre.clone().all(|p| !found.masks[i].data[p]));
        }
        assert!(found.masks[2].at(60, 8) && found.masks[0].at(60, 8));
    }

    #[test]
    fn what_moves_apart_is_apart_and_what_does_not_changes_little() {
        // One colour and one depth: only motion tells the plate from the rest.
        let (camera, (mut frames, mut maps)) = (camera(), scene(0.0, PLATE[0]));
        for (frame, map) in frames.iter_mut().zip(&mut maps) {
            map.depth.fill(PLATE[0] as f32);
            frame.rgb.iter_mut().enumerate().for_each(|(p, rgb)| *rgb = [90 + (p % 7) as u8; 3]);
        }
        let views = posed(&frames, &camera);
        let moved = |px: f64| -> Vec<(Point3, f64)> {
            let on_grid = (0..SIZE[0] * SIZE[1])
                .filter(|p| p.is_multiple_of(4) && (p / SIZE[0]).is_multiple_of(4));
            let point = |p: usize| {
                let back = maps[2].pose.inverse();
                (back * maps[2].point(p), if plate(2, p, 0.0) { px } else { 0.1 })
            };
            on_grid.map(point).collect()
        };
        let best = |moved: &[(Point3, f64)]| {
            Parting::new(&views, &maps, &Seeds::default(), moved).best().masks
        };
        let truth: Vec<Mask> = (0..5).map(|i| mask(|p| plate(i, p, 0.0))).collect();
        let (without, with) = (overlap(&best(&[]), &truth), overlap(&best(&moved(2.0)), &truth));
        assert!(with > 0.8 && without < 0.7, "{with} {without}");
        // Where all moves alike it says nothing.
        let same: Vec<(Point3, f64)> = moved(2.0).iter().map(|m| (m.0, 1.0)).collect();
        assert!(overlap(&best(&same), &best(&[])) > 0.97);
    }
}
