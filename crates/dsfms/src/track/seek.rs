//! Places of the template without a match, sought by descriptors near where a surface has them: a
//! few parts of the picture a frame, those where the frame before lacked most.

use super::Surface;
use super::covered::CoveredCells;
use super::parts::SoughtPart;
use super::places::{FollowedPlace, OLD};
use super::prepare::View;
use super::tracker::Tracker;
use crate::geometry::{Isometry, Point2, Point3};
use crate::image::Frame;
use crate::register::pose::rest_point;
use rayon::prelude::*;

/// Places that are followed at most.
const MOST_PLACES: usize = 600;

/// Where a frame lacks matches.
struct Lacking {
    matched: CoveredCells,
    /// What will soon be too old to be followed.
    old: CoveredCells,
}

impl Lacking {
    fn at(&self, place: Point2) -> bool {
        !self.matched.at(place) || self.old.at(place)
    }
}

impl Tracker<'_> {
    /// What finds the features of the parts that the last frame asked for, by their numbers.
    pub(super) fn next_sought<'f>(
        &mut self,
        frame: &'f Frame,
        view: &'f View,
    ) -> impl FnOnce() -> Vec<(usize, SoughtPart)> + Send + use<'f> {
        let (parts, working) = (std::mem::take(&mut self.next_parts), self.working.clone());
        let windows = parts.iter().map(|&part| self.seeker.window(part, working.camera.size));
        let parts: Vec<_> = parts.iter().copied().zip(windows).collect();
        let features =
            move |(part, window)| (part, SoughtPart::of(frame, &view.seen, &working, window));
        move || parts.into_par_iter().map(features).collect()
    }

    /// Take what the sought parts of this frame show of the surface where it lacks matches; what is
    /// found is followed from the next frame on. `sought`: parts by their numbers.
    pub(super) fn seek(&mut self, sought: &[(usize, SoughtPart)], view: &View, surface: &Surface) {
        let due = self.options.seek > 0
            && (self.count + 1).is_multiple_of(self.options.seek_every)
            && self.places.len() < MOST_PLACES;
        if sought.is_empty() && !due {
            return;
        }
        let lacking = self.lacking(surface);
        let all = if sought.is_empty() { 0 } else { self.search.places().len() as u32 };
        let visible = self.visible(view, surface, &(0..all).collect::<Vec<_>>());
        for (part, features) in sought {
            let found = self.sought_in(features, &visible, view, surface.pose, &lacking);
            self.seeker.looked(*part, self.count, !found.is_empty());
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
        if due {
            let probes = self.visible(view, surface, &self.seeker.probes);
            let probes: Vec<(Point2, bool)> =
                probes.iter().map(|p| (p.1, lacking.at(p.1))).collect();
            self.next_parts = self.seeker.worst(&probes, self.count + 1, self.options.seek);
        }
    }

    /// Where this frame lacks matches of a surface.
    fn lacking(&self, surface: &Surface) -> Lacking {
        let size = self.working.camera.size;
        let kept = surface.matches.iter().filter(|m| m.1);
        let matched = kept.map(|m| self.working.of_frame(m.0.pixel));
        let old = |p: &&FollowedPlace| self.count > p.frame + OLD / 2;
        let old = (self.places.iter().filter(old))
            .filter_map(|p| self.shown_at(&surface.vertices, p.found.face, p.found.barycentric));
        Lacking { matched: CoveredCells::of(size, matched), old: CoveredCells::of(size, old) }
    }

    /// Where on the rest shape a place is.
    fn rest_place(&self, place: &FollowedPlace) -> Point3 {
        rest_point(&self.template.mesh, &place.found)
    }

    /// What is found in one part of the picture; `visible`: which features the surface shows, and
    /// where.
    fn sought_in(
        &self,
        part: &SoughtPart,
        visible: &[(u32, Point2)],
        view: &View,
        pose: Isometry,
        lacking: &Lacking,
    ) -> Vec<FollowedPlace> {
        let found = part.matches(&self.working, &self.search, visible);
        let lacks = found.into_iter().filter(|m| lacking.at(self.working.of_frame(m.pixel)));
        lacks.filter_map(|m| self.place(view, m, pose)).collect()
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
