//! In which parts of the picture places of the template are sought: those that lack most, each
//! again after a while.

use super::look::{Seen, Working};
use super::prepare::WorkingWindow;
use crate::geometry::{Point2, Point3};
use crate::image::Frame;
use crate::register::Match;
use crate::register::find::Search;
use crate::sfm::Features2d;

/// Side of a part, px of the working image.
const PART: usize = 64;

/// Margin about it, in which no features lie but what describes those in it.
const MARGIN: usize = 16;

/// Features of the template that tell where matches are missing, at most.
const PROBES: usize = 2000;

/// A part is looked at where it lacks so many matches, and this share of its places.
const LACKS: (usize, f64) = (4, 1.0 / 3.0);

/// Frames until a part is looked at again after something was found there, and at most after
/// nothing was.
const AGAIN: [usize; 2] = [4, 64];

/// A feature is looked for so far from where it is expected, px of the working image: where nothing
/// matched, the surface may be off by a fold of the tissue.
const REACH_PX: f64 = 24.0;

/// Features of a part at most.
const MOST_FEATURES: usize = 150;

/// The features of a part of a frame.
pub(super) struct SoughtPart {
    window: WorkingWindow,
    features: Features2d,
}

impl SoughtPart {
    pub(super) fn of(frame: &Frame, seen: &Seen, working: &Working, window: WorkingWindow) -> Self {
        Self { window, features: seen.features_in(frame, working, window, MOST_FEATURES) }
    }

    /// Matches near where features of a template are visible: their indices, and px of the working
    /// image.
    pub(super) fn matches(
        &self,
        working: &Working,
        search: &Search,
        visible: &[(u32, Point2)],
    ) -> Vec<Match> {
        let Self { window, features } = self;
        let [low, high] = [0, 1].map(|end| {
            let at = |k: usize| (window.corner[k] + end * window.size[k]) as f64;
            Point2::new(at(0), at(1))
        });
        let near =
            |p: &Point2| (0..2).all(|k| p[k] >= low[k] - REACH_PX && p[k] <= high[k] + REACH_PX);
        let expected = visible.iter().filter(|e| near(&e.1));
        let expected: Vec<(u32, Point2)> =
            expected.map(|&(i, p)| (i, working.to_frame(p))).collect();
        search.near(features, &expected, REACH_PX * f64::from(1u32 << working.halvings))
    }
}

/// What is known of where to look.
pub(super) struct Seeker {
    /// Features spread over the template.
    pub(super) probes: Vec<u32>,
    /// Parts across the working image.
    across: usize,
    parts: Vec<PartState>,
}

/// When a part may be looked at again.
#[derive(Clone, Copy, Debug)]
struct PartState {
    due: usize,
    wait: usize,
}

impl Seeker {
    /// For features at these places of the rest shape, and working images of a size.
    pub(super) fn new(places: &[Point3], size: [usize; 2]) -> Self {
        let step = places.len().div_ceil(PROBES).max(1);
        let [across, down] = size.map(|n| n.div_ceil(PART));
        let parts = vec![PartState { due: 0, wait: AGAIN[0] }; across * down];
        Self { probes: (0..places.len() as u32).step_by(step).collect(), across, parts }
    }

    /// Up to `most` parts that lack matches in frame `now`, the worst first; `places` holds where
    /// probes are seen, `true` for those that lack a match.
    pub(super) fn worst(&self, places: &[(Point2, bool)], now: usize, most: usize) -> Vec<usize> {
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
    pub(super) fn looked(&mut self, part: usize, now: usize, found: bool) {
        let PartState { due, wait } = &mut self.parts[part];
        *wait = if found { AGAIN[0] } else { (2 * *wait).min(AGAIN[1]) };
        *due = now + *wait;
    }

    /// A part with its margin.
    pub(super) fn window(&self, part: usize, size: [usize; 2]) -> WorkingWindow {
        let at = [part % self.across, part / self.across].map(|n| n * PART);
        let corner = at.map(|c| c.saturating_sub(MARGIN));
        let end = |k: usize| (at[k] + PART + MARGIN).min(size[k]);
        WorkingWindow { corner, size: [end(0) - corner[0], end(1) - corner[1]] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_parts_come_first_and_rest_after_a_look() {
        let places: Vec<Point3> = (0..5000).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        let mut seeker = Seeker::new(&places, [300, 200]);
        assert!((seeker.across, seeker.parts.len()) == (5, 20) && seeker.probes.len() <= PROBES);
        let at = |x: f64, y: f64, lack: usize, all: usize| {
            (0..all).map(move |k| (Point2::new(x, y), k < lack))
        };
        // Part 0 lacks 5 of 9, part 1 9 of 40, part 6 8 of 8, part 19 3 of 3.
        let all: Vec<_> = at(10.0, 10.0, 5, 9)
            .chain(at(100.0, 10.0, 9, 40))
            .chain(at(100.0, 100.0, 8, 8))
            .chain(at(299.0, 199.0, 3, 3))
            .collect();
        assert_eq!(seeker.worst(&all, 1, 9), [6, 0]);
        assert_eq!(seeker.worst(&all, 1, 1), [6]);
        seeker.looked(6, 1, false);
        assert_eq!(seeker.worst(&all, 8, 9), [0]);
        assert_eq!(seeker.worst(&all, 9, 9), [6, 0]);
        (0..9).for_each(|_| seeker.looked(6, 100, false));
        assert_eq!(seeker.parts[6].due, 100 + AGAIN[1]);
        seeker.looked(6, 100, true);
        assert_eq!(seeker.parts[6].due, 100 + AGAIN[0]);
    }

    #[test]
    fn a_part_has_a_margin_within_the_image() {
        let seeker = Seeker::new(&[], [300, 200]);
        let window = |part| seeker.window(part, [300, 200]);
        assert_eq!(window(0), WorkingWindow { corner: [0, 0], size: [80, 80] });
        assert_eq!(window(6), WorkingWindow { corner: [48, 48], size: [96, 96] });
        assert_eq!(window(19), WorkingWindow { corner: [240, 176], size: [60, 24] });
    }
}
