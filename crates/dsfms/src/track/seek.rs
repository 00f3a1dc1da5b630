//! Places of the template without a match, sought by descriptors near where a surface has them: a
//! few parts of the picture a frame.

use super::Surface;
use super::covered::CoveredCells;
use super::parts::SoughtPart;
use super::places::{FollowedPlace, OLD};
use super::prepare::View;
use super::tracker::Tracker;
use crate::geometry::{Point2, Point3};
use crate::image::Frame;
use crate::register::pose::rest_point;
use rayon::prelude::*;

/// Places that are followed at most.
const MOST_PLACES: usize = 600;

impl Tracker<'_> {
    /// Seek what the surface of this frame lacks; what is found is followed from the next on.
    pub(super) fn seek(&mut self, frame: &Frame, view: &View, surface: &Surface) {
        let due = self.count.is_multiple_of(self.options.seek_every);
        if self.options.seek == 0 || !due || self.places.len() >= MOST_PLACES {
            return;
        }
        let size = self.working.camera.size;
        let kept = surface.matches.iter().filter(|m| m.1);
        let matched: Vec<Point2> = kept.map(|m| self.working.of_frame(m.0.pixel)).collect();
        // What will soon be too old to be followed counts as missing.
        let old = |p: &&FollowedPlace| self.count > p.frame + OLD / 2;
        let old: Vec<Point2> = (self.places.iter().filter(old))
            .filter_map(|p| self.shown_at(&surface.vertices, p.found.face, p.found.barycentric))
            .collect();
        let (covered, old) =
            (CoveredCells::of(size, matched.into_iter()), CoveredCells::of(size, old.into_iter()));
        let lacks = |place: Point2| !covered.at(place) || old.at(place);
        let probes = self.visible(view, surface, &self.seeker.probes);
        let probes: Vec<(Point2, bool)> = probes.iter().map(|p| (p.1, lacks(p.1))).collect();
        for part in self.seeker.worst(&probes, self.count, self.options.seek) {
            let found = self.sought_in(frame, view, surface, part, &lacks);
            self.seeker.looked(part, self.count, !found.is_empty());
            // The newer stands for the older of the same place.
            let near = |p: &FollowedPlace| {
                let own = self.rest_place(p);
                found.iter().any(|f| (self.rest_place(f) - own).norm() < self.search.one_place())
            };
            let mut places: Vec<FollowedPlace> =
                self.places.iter().filter(|p| !near(p)).cloned().collect();
            places.extend(found);
            places.truncate(MOST_PLACES);
            self.places = places;
        }
    }

    /// Where on the rest shape a place is.
    fn rest_place(&self, place: &FollowedPlace) -> Point3 {
        rest_point(&self.template.mesh, &place.found)
    }

    /// What is found in one part of the picture.
    fn sought_in(
        &self,
        frame: &Frame,
        view: &View,
        surface: &Surface,
        part: usize,
        lacks: &dyn Fn(Point2) -> bool,
    ) -> Vec<FollowedPlace> {
        let window = self.seeker.window(part, self.working.camera.size);
        let all: Vec<u32> = (0..self.search.places().len() as u32).collect();
        let sought = SoughtPart { frame, seen: &view.seen, working: &self.working, window };
        let found = sought.matches(&self.search, &self.visible(view, surface, &all));
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
