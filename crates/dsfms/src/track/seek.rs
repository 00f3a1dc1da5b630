//! Places of the template without a match, sought by descriptors near where a surface has them: a few parts
//! of the picture a frame, those that lack most and were not looked at for longest.

use super::Surface;
use super::follow::Covered;
use super::places::{OLD, Place};
use super::prepare::{View, Window};
use super::tracker::Tracker;
use crate::geometry::{Point2, Point3};
use crate::image::Frame;
use crate::register::pose::rest_point;
use rayon::prelude::*;

/// Side of a part, px of the working image.
const PART: usize = 96;

/// Margin about it, in which no features lie but what describes those in it.
const MARGIN: usize = 16;

/// A feature is looked for so far from where the surface has it, px of the working image: where nothing
/// matched, the surface may be off by a fold of the tissue.
const REACH_PX: f64 = 24.0;

/// Features of a part at most.
const MOST_FEATURES: usize = 300;

/// Features of the template that tell where matches are missing, at most.
const PROBES: usize = 2000;

/// A part is looked at where it lacks so many matches, and this share of its places.
const LACKS: (usize, f64) = (4, 1.0 / 3.0);

/// Frames until a part is looked at again after something was found there, and at most after nothing was.
const AGAIN: [usize; 2] = [4, 64];

/// Places that are followed at most.
const MOST_PLACES: usize = 600;

/// What is known of where to look.
pub(super) struct Seeker {
    /// Features spread over the template.
    probes: Vec<u32>,
    /// Parts across the working image.
    across: usize,
    parts: Vec<Part>,
}

/// When a part may be looked at again.
#[derive(Clone, Copy, Debug)]
struct Part {
    due: usize,
    wait: usize,
}

impl Seeker {
    /// For features at these places of the rest shape, and working images of a size.
    pub(super) fn new(places: &[Point3], size: [usize; 2]) -> Self {
        let step = places.len().div_ceil(PROBES).max(1);
        let [across, down] = size.map(|n| n.div_ceil(PART));
        let parts = vec![Part { due: 0, wait: AGAIN[0] }; across * down];
        Self { probes: (0..places.len() as u32).step_by(step).collect(), across, parts }
    }

    /// Up to `most` parts that lack matches in frame `now`, the worst first; `places` holds where probes are
    /// seen, `true` for those that lack a match.
    fn worst(&self, places: &[(Point2, bool)], now: usize, most: usize) -> Vec<usize> {
        let mut lack = vec![[0usize; 2]; self.parts.len()];
        for (place, lacks) in places {
            let [x, y] = [place.x, place.y].map(|c| c.max(0.0) as usize / PART);
            if let Some(part) = lack.get_mut(y * self.across + x).filter(|_| x < self.across) {
                part[0] += 1;
                part[1] += usize::from(*lacks);
            }
        }
        let (least, share) = LACKS;
        let wanting = |&i: &usize| {
            let [all, lacks] = lack[i];
            lacks >= least && lacks as f64 >= share * all as f64 && now >= self.parts[i].due
        };
        let mut worst: Vec<usize> = (0..self.parts.len()).filter(wanting).collect();
        worst.sort_by_key(|&i| (std::cmp::Reverse(lack[i][1]), i));
        worst.truncate(most);
        worst
    }

    /// Remember what a look in frame `now` gave.
    fn looked(&mut self, part: usize, now: usize, found: bool) {
        let Part { due, wait } = &mut self.parts[part];
        *wait = if found { AGAIN[0] } else { (2 * *wait).min(AGAIN[1]) };
        *due = now + *wait;
    }

    /// A part with its margin.
    fn window(&self, part: usize, size: [usize; 2]) -> Window {
        let at = [part % self.across, part / self.across].map(|n| n * PART);
        let corner = at.map(|c| c.saturating_sub(MARGIN));
        let end = |k: usize| (at[k] + PART + MARGIN).min(size[k]);
        Window { corner, size: [end(0) - corner[0], end(1) - corner[1]] }
    }
}

impl Tracker<'_> {
    /// Seek what the surface of this frame lacks; what is found is followed from the next on.
    pub(super) fn seek(&mut self, frame: &Frame, view: &View, surface: &Surface) {
        if self.options.seek == 0 || self.places.len() >= MOST_PLACES {
            return;
        }
        let size = self.working.camera.size;
        let kept = surface.matches.iter().filter(|m| m.1);
        let matched: Vec<Point2> = kept.map(|m| self.working.of_frame(m.0.pixel)).collect();
        // What will soon be too old to be followed counts as missing.
        let old = |p: &&Place| self.count > p.frame + OLD / 2;
        let old: Vec<Point2> = (self.places.iter().filter(old))
            .filter_map(|p| self.shown_at(&surface.vertices, p.found.face, p.found.barycentric))
            .collect();
        let (covered, old) =
            (Covered::of(size, matched.into_iter()), Covered::of(size, old.into_iter()));
        let lacks = |place: Point2| !covered.at(place) || old.at(place);
        let probes = self.visible(view, surface, &self.seeker.probes);
        let probes: Vec<(Point2, bool)> = probes.iter().map(|p| (p.1, lacks(p.1))).collect();
        for part in self.seeker.worst(&probes, self.count, self.options.seek) {
            let found = self.sought(frame, view, surface, part, &lacks);
            self.seeker.looked(part, self.count, !found.is_empty());
            // The newer stands for the older of the same place.
            let near = |p: &Place| {
                let own = self.rest_place(p);
                found.iter().any(|f| (self.rest_place(f) - own).norm() < self.search.one_place())
            };
            let mut places: Vec<Place> = self.places.iter().filter(|p| !near(p)).cloned().collect();
            places.extend(found);
            places.truncate(MOST_PLACES);
            self.places = places;
        }
    }

    /// Where on the rest shape a place is.
    fn rest_place(&self, place: &Place) -> Point3 {
        rest_point(&self.template.mesh, &place.found)
    }

    /// What is found in one part of the picture.
    fn sought(
        &self,
        frame: &Frame,
        view: &View,
        surface: &Surface,
        part: usize,
        lacks: &dyn Fn(Point2) -> bool,
    ) -> Vec<Place> {
        let window = self.seeker.window(part, self.working.camera.size);
        let seen = view.features_in(frame, &self.working, window, MOST_FEATURES);
        let [low, high] = [0, 1].map(|end| {
            let at = |k: usize| (window.corner[k] + end * window.size[k]) as f64;
            Point2::new(at(0), at(1))
        });
        let near =
            |p: &Point2| (0..2).all(|k| p[k] >= low[k] - REACH_PX && p[k] <= high[k] + REACH_PX);
        let all: Vec<u32> = (0..self.search.places().len() as u32).collect();
        let expected = self.visible(view, surface, &all).into_iter().filter(|e| near(&e.1));
        let expected: Vec<(u32, Point2)> =
            expected.map(|(i, p)| (i, self.working.to_frame(p))).collect();
        let reach = REACH_PX * f64::from(1u32 << self.working.halvings);
        let found = self.search.near(&seen, &expected, reach);
        let lacking = found.into_iter().filter(|m| lacks(self.working.of_frame(m.pixel)));
        lacking.filter_map(|m| self.place(view, m, surface.pose)).collect()
    }

    /// Which features the surface shows in the usable part of the working image, and where.
    fn visible(&self, view: &View, surface: &Surface, features: &[u32]) -> Vec<(u32, Point2)> {
        let faces = &self.template.mesh.topology.faces;
        let one = |&i: &u32| {
            let m = self.search.matched(i, Point2::origin());
            let seen = faces[m.face as usize].iter().all(|&v| surface.visible[v as usize]);
            let place =
                seen.then(|| self.shown_at(&surface.vertices, m.face, m.barycentric)).flatten()?;
            view.seen.usable.at_pixel(&place).then_some((i, place))
        };
        features.par_iter().filter_map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_parts_come_first_and_rest_after_a_look() {
        let places: Vec<Point3> = (0..5000).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        let mut seeker = Seeker::new(&places, [300, 200]);
        assert!((seeker.across, seeker.parts.len()) == (4, 12) && seeker.probes.len() <= PROBES);
        let at = |x: f64, y: f64, lack: usize, all: usize| {
            (0..all).map(move |k| (Point2::new(x, y), k < lack))
        };
        // Part 0 lacks 5 of 9, part 1 9 of 40, part 5 8 of 8, part 11 3 of 3.
        let all: Vec<_> = at(10.0, 10.0, 5, 9)
            .chain(at(100.0, 10.0, 9, 40))
            .chain(at(100.0, 100.0, 8, 8))
            .chain(at(299.0, 199.0, 3, 3))
            .collect();
        assert_eq!(seeker.worst(&all, 1, 9), [5, 0]);
        assert_eq!(seeker.worst(&all, 1, 1), [5]);
        seeker.looked(5, 1, false);
        assert_eq!(seeker.worst(&all, 8, 9), [0]);
        assert_eq!(seeker.worst(&all, 9, 9), [5, 0]);
        (0..9).for_each(|_| seeker.looked(5, 100, false));
        assert_eq!(seeker.parts[5].due, 100 + AGAIN[1]);
        seeker.looked(5, 100, true);
        assert_eq!(seeker.parts[5].due, 100 + AGAIN[0]);
    }

    #[test]
    fn a_part_has_a_margin_within_the_image() {
        let seeker = Seeker::new(&[], [300, 200]);
        let window = |part| seeker.window(part, [300, 200]);
        assert_eq!(window(0), Window { corner: [0, 0], size: [112, 112] });
        assert_eq!(window(5), Window { corner: [80, 80], size: [128, 120] });
        assert_eq!(window(11), Window { corner: [272, 176], size: [28, 24] });
    }
}
