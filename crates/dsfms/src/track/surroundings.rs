//! The camera by what lies around the organ: its places are found by descriptors, part by part,
//! near where a known pose has them, and followed by the look of the frame that they were found in.
//! The organ may bend, move or be covered meanwhile.

use super::covered::CoveredCells;
use super::look::{Seen, Working};
use super::parts::{Seeker, SoughtPart};
use super::places::{FollowedPlace, OLD};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, normal};
use crate::image::Frame;
use crate::image::flow::whole;
use crate::mesh::Mesh;
use crate::pipeline::{CameraSight, sighted};
use crate::register::find::{NEEDED, Search};
use crate::register::pose::rest_point;
use crate::register::{Match, RegisterOptions};
use crate::template::{Surroundings, Template};
use rayon::prelude::*;

/// Places that are followed at most: with 80 the pose leaves a tenth of a millimetre open, more
/// take time.
const MOST_PLACES: usize = 80;

/// A part is searched in every so many frames, until twice as many places as a pose needs are known
/// and from then on.
const SEEK_EVERY: [usize; 2] = [2, 4];

/// Follows the surroundings of a template.
pub(super) struct SurroundingsTracker<'a> {
    template: &'a Template,
    mesh: &'a Mesh,
    search: Search<'a>,
    seeker: Seeker,
    places: Vec<FollowedPlace>,
    last: Option<LastCamera>,
}

/// The camera in the last frame that showed the surroundings.
#[derive(Clone, Copy)]
struct LastCamera {
    frame: usize,
    pose: Isometry,
    /// In the frame before.
    before: Option<Isometry>,
}

/// A frame in which the surroundings are looked for.
pub(super) struct ShownFrame<'a> {
    pub(super) frame: &'a Frame,
    /// As what lies around the organ is looked for in it.
    pub(super) seen: &'a Seen,
    pub(super) working: &'a Working,
    pub(super) camera: &'a CameraModel,
    pub(super) number: usize,
}

impl ShownFrame<'_> {
    /// Where the working image shows a point of the template frame under a pose.
    fn pixel(&self, pose: &Isometry, point: &Point3) -> Option<Point2> {
        Some(self.working.camera.project(&(pose * point))?.pixel)
    }
}

impl<'a> SurroundingsTracker<'a> {
    /// `None` where the template has nothing to follow around its organ.
    pub(super) fn of(template: &'a Template, working: &Working) -> Option<Self> {
        let Surroundings { mesh, features } = template.surroundings.as_ref()?;
        if features.descriptors.is_empty() {
            return None;
        }
        let search = Search::new(mesh, features);
        let seeker = Seeker::new(search.places(), working.camera.size);
        Some(Self { template, mesh, search, seeker, places: Vec::new(), last: None })
    }

    /// The camera as the places found so far show it; places that do not agree are given up after a
    /// while.
    pub(super) fn followed(
        &mut self,
        shown: &ShownFrame,
        correlation: f64,
        options: &RegisterOptions,
    ) -> Option<CameraSight> {
        let now = shown.number;
        self.places.retain(|p| p.lasts(now));
        let start = self.expected(now)?;
        let one = |p: &FollowedPlace| -> Option<Match> {
            let expected = shown.pixel(&start, &rest_point(self.mesh, &p.found))?;
            let turn = p.turn(&shown.working.camera, self.mesh, &start);
            let (place, alike) = p.follow(&shown.seen.pyramid, expected, turn)?;
            let good = alike >= correlation && whole(&shown.seen.usable, place);
            let glare = || p.stays(&shown.seen.pyramid.levels[0], place);
            (good && !glare()).then(|| Match { pixel: shown.working.to_frame(place), ..p.found })
        };
        let found: Vec<Option<Match>> = self.places.par_iter().map(one).collect();
        let matches: Vec<Match> = found.iter().flatten().copied().collect();
        let meshes = [&self.template.mesh, self.mesh];
        let (sight, agree) = sighted(shown.camera, meshes, &matches, start, options)?;
        let followed = self.places.iter_mut().zip(&found).filter(|(_, found)| found.is_some());
        for ((place, _), agrees) in followed.zip(agree) {
            if agrees {
                place.held = now;
            }
        }
        let before = self.last.filter(|l| l.frame + 1 == now).map(|l| l.pose);
        self.last = Some(LastCamera { frame: now, pose: sight.pose, before });
        Some(sight)
    }

    /// The pose that the last motion leads to.
    fn expected(&self, now: usize) -> Option<Isometry> {
        let LastCamera { frame, pose, before } = self.last?;
        let before = before.filter(|_| frame + 1 == now);
        Some(before.map_or(pose, |before| pose * before.inverse() * pose))
    }

    /// Seek places in the part of the picture that lacks most, near where a pose has them; `organ`
    /// (camera axes) hides what is behind it.
    pub(super) fn seek(&mut self, shown: &ShownFrame, pose: Isometry, organ: &[Point3]) {
        let (now, count) = (shown.number, self.places.len());
        let every = SEEK_EVERY[usize::from(count >= 2 * NEEDED)];
        // Live, the organ's places are sought in the even frames.
        if now % every != 1 || count >= MOST_PLACES {
            return;
        }
        let size = shown.working.camera.size;
        let hidden = organ.iter().filter_map(|p| Some(shown.working.camera.project(p)?.pixel));
        let hidden = CoveredCells::of(size, hidden);
        let lasting = self.places.iter().filter(|p| now <= p.frame + OLD / 2);
        let known = lasting.filter_map(|p| shown.pixel(&pose, &rest_point(self.mesh, &p.found)));
        let known = CoveredCells::of(size, known);
        let all: Vec<u32> = (0..self.search.places().len() as u32).collect();
        let visible = |features: &[u32]| -> Vec<(u32, Point2)> {
            let seen = |&i: &u32| self.visible(shown, &pose, i).filter(|p| !hidden.at(*p));
            features.par_iter().filter_map(|i| Some((*i, seen(i)?))).collect()
        };
        let probes: Vec<(Point2, bool)> =
            visible(&self.seeker.probes).iter().map(|p| (p.1, !known.at(p.1))).collect();
        let Some(part) = self.seeker.worst(&probes, now, 1).first().copied() else { return };
        let ShownFrame { frame, seen, working, .. } = *shown;
        let window = self.seeker.window(part, size);
        let sought = SoughtPart::of(frame, seen, working, window);
        let found = sought.matches(working, &self.search, &visible(&all));
        let new = found.into_iter().filter(|m| !known.at(working.of_frame(m.pixel)));
        let new: Vec<FollowedPlace> = new
            .filter_map(|m| {
                let pixel = working.of_frame(m.pixel);
                FollowedPlace::new(m, pixel, &seen.pyramid.levels[0], pose, now)
            })
            .collect();
        self.seeker.looked(part, now, !new.is_empty());
        self.places.extend(new);
        self.places.truncate(MOST_PLACES);
        if self.last.is_none_or(|last| last.frame != now) {
            self.last = Some(LastCamera { frame: now, pose, before: None });
        }
    }

    /// Where the working image shows a feature on a face that is turned to the camera.
    fn visible(&self, shown: &ShownFrame, pose: &Isometry, feature: u32) -> Option<Point2> {
        let found = self.search.matched(feature, Point2::origin());
        let [a, b, c] = self.mesh.corners(found.face as usize).map(|p| pose * p);
        let towards = normal(&a, &b, &c)?.dot(&a.coords) < 0.0;
        let pixel = shown.pixel(pose, &self.search.places()[feature as usize])?;
        (towards && shown.seen.usable.at_pixel(&pixel)).then_some(pixel)
    }
}
