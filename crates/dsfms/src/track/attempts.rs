//! How a frame gets its surface: followed from the last one, found again, or both.

use super::beside::{Beside, Effort, Need};
use super::candidate::{Candidate, Last};
use super::clock::Clock;
use super::follow::FollowedMatches;
use super::places::FollowedPlace;
use super::prepare::View;
use super::search_times::merely_hidden;
use super::tracker::Tracker;
use super::{Origin, TrackStatus};
use crate::geometry::Isometry;
use crate::image::Frame;
use crate::register::Match;
use crate::verdict::NoSurface;
use crate::verdict::intrinsics::other_camera;

/// Features of a frame that are looked up at most; more tell little.
const MOST_FEATURES: usize = 2000;
/// And by a hasty search: it takes less than half as long (`docs/performance.md`).
const HASTY_FEATURES: usize = 800;

impl Tracker<'_> {
    /// Follow, and find where that is not good enough; the better of both.
    pub(super) fn attempts(
        &mut self,
        frame: &Frame,
        view: &View,
        clock: &mut Clock,
    ) -> Result<Candidate, NoSurface> {
        let fresh =
            |last: &Last| (self.count - last.frame <= self.options.patience).then_some(last.frame);
        let all_search = self.beside.as_ref().is_some_and(Beside::all_search);
        let followed = match self.last.as_ref().filter(|_| !all_search).and_then(fresh) {
            Some(_) => {
                let found = clock.time("follow", || self.followed(view));
                self.on_from_last(view, found, Origin::Followed, clock)
            }
            None => Err(NoSurface::NotFound),
        };
        let reasons = followed.as_ref().ok().map(|c| &c.verdict.reasons[..]);
        self.search_times.followed(self.count, reasons);
        let need = self.need(&followed);
        if need.held {
            self.search_times.worthwhile(true);
        }
        if need.search && need.level == TrackStatus::Degraded {
            self.search_times.asked(self.count);
        }
        let found = match self.beside.take() {
            None => need.search.then(|| self.sought(frame, view, Effort::Full, clock)),
            Some(beside) => self.sought_beside(beside, &need, frame, view, clock),
        };
        let Some(found) = found else {
            let nothing = |why| if need.search { NoSurface::SearchedElsewhere } else { why };
            return followed.map_err(nothing);
        };
        let keep = match (&followed, &found) {
            (Ok(a), Ok(b)) => a.verdict.level < TrackStatus::Lost && !b.beats(a),
            (Ok(a), Err(_)) => a.verdict.level < TrackStatus::Lost,
            (Err(_), _) => false,
        };
        self.search_times.worthwhile(!keep);
        if keep { followed } else { found }
    }

    /// What a followed surface, or none, leaves to a search.
    fn need(&self, followed: &Result<Candidate, NoSurface>) -> Need {
        let due = |c: &Candidate| {
            self.search_times.due(self.count, self.options.search_every, &c.verdict.reasons)
        };
        let level = followed.as_ref().map_or(TrackStatus::Lost, |c| c.verdict.level);
        // Where a surface jumped, the last shape is no better a start than the rest shape.
        let jumped = matches!(followed, Ok(c) if c.jumped);
        let search = match (level, followed) {
            (TrackStatus::Degraded, Ok(c)) => c.jumped || due(c),
            (TrackStatus::Ok, _) => jumped,
            _ => true,
        };
        let held = level == TrackStatus::Ok && !jumped;
        Need { search, held, level }
    }

    /// The template found by descriptors in a frame.
    pub(super) fn sought(
        &mut self,
        frame: &Frame,
        view: &View,
        effort: Effort,
        clock: &mut Clock,
    ) -> Result<Candidate, NoSurface> {
        let seed = self.options.reconstruct.seed;
        let matches = clock.time("find", || {
            let most = match effort {
                Effort::Full => MOST_FEATURES,
                Effort::Hasty => HASTY_FEATURES,
            };
            let seen = view.seen.features(frame, &self.working, most);
            let options = &self.options.reconstruct.register;
            self.search.matches(self.camera, &seen, options, seed)
        });
        self.found(view, matches?, effort, clock)
    }

    /// The surface where the template was found: bent as it was last, or from nothing.
    fn found(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        effort: Effort,
        clock: &mut Clock,
    ) -> Result<Candidate, NoSurface> {
        let options = &self.options.reconstruct;
        self.other_camera = self.template.camera.as_ref().and_then(|own| {
            let (limit, cameras) = (options.verdict.camera, [self.camera, own]);
            let rest = &self.template.mesh;
            other_camera(cameras, limit, rest, &matches, &options.register, options.seed)
        });
        let again = self.last.is_some().then(|| self.again(view, matches.clone(), clock));
        let again = again.and_then(Result::ok).map(|draft| {
            let found = self.judged(view, draft, Origin::Found, clock);
            self.with_places(view, found)
        });
        let enough = |c: &Candidate| {
            let usable = c.verdict.level < TrackStatus::Lost && merely_hidden(&c.verdict.reasons);
            effort == Effort::Hasty && usable
        };
        let again = match again {
            Some(again) if enough(&again) => return Ok(again),
            again => again,
        };
        let anew = self.anew(view, matches, clock).map(|draft| {
            let first = self.judged(view, draft, Origin::Found, clock);
            let first = self.with_places(view, first);
            if enough(&first) { first } else { self.followed_at_once(view, first, clock) }
        });
        match (again, anew) {
            (Some(again), Ok(anew)) if anew.beats(&again) => Ok(anew),
            (Some(again), _) => Ok(again),
            (None, anew) => anew,
        }
    }

    /// The surface that matches from the last one give, with the places that it explains.
    fn on_from_last(
        &mut self,
        view: &View,
        found: FollowedMatches,
        origin: Origin,
        clock: &mut Clock,
    ) -> Result<Candidate, NoSurface> {
        let FollowedMatches { matches, places } = found;
        let by_look = matches.len() - places.len();
        let draft = self.carried(view, matches, origin, clock)?;
        let mut found = self.judged(view, draft, origin, clock);
        let kept = found.surface.matches[by_look..].iter().zip(places).filter(|m| m.0.1);
        found.places = kept.map(|m| m.1).collect();
        Ok(found)
    }

    /// The matches of a surface that was found by descriptors, as places to follow.
    fn with_places(&self, view: &View, mut found: Candidate) -> Candidate {
        let kept = found.surface.matches.iter().filter(|m| m.1);
        let pose = found.surface.pose;
        found.places = kept.filter_map(|m| self.place(view, m.0, pose)).collect();
        found
    }

    /// A match of this frame as a place to follow.
    pub(super) fn place(&self, view: &View, found: Match, pose: Isometry) -> Option<FollowedPlace> {
        let pixel = self.working.of_frame(found.pixel);
        FollowedPlace::new(found, pixel, &view.seen.pyramid.levels[0], pose, self.count)
    }

    /// A surface found from nothing, followed within its own frame: its look finds more matches
    /// than descriptors do. The first where following it ends worse.
    fn followed_at_once(&mut self, view: &View, first: Candidate, clock: &mut Clock) -> Candidate {
        if first.verdict.level == TrackStatus::Lost {
            return first;
        }
        let last = self.as_last(view, &first);
        let again = self.followed_from(view, last, first.places.clone(), Origin::Found, clock);
        match again {
            // Places that anchors cover now may be wanted in the next frames.
            Ok(again) if again.verdict.level <= first.verdict.level => {
                Candidate { places: first.places, ..again }
            }
            _ => first,
        }
    }

    /// A surface of this frame as later ones follow it.
    pub(super) fn as_last(&self, view: &View, found: &Candidate) -> Last {
        let vertices = found.surface.vertices.clone();
        Last {
            frame: self.count,
            ahead: vertices.clone(),
            pose: found.surface.pose,
            ambient: found.ambient,
            look: found.look.clone(),
            earlier: self.as_earlier(view, &vertices),
            vertices,
        }
    }

    /// The surface of this frame that another than the last one and its places lead to.
    pub(super) fn followed_from(
        &mut self,
        view: &View,
        last: Last,
        places: Vec<FollowedPlace>,
        origin: Origin,
        clock: &mut Clock,
    ) -> Result<Candidate, NoSurface> {
        let kept = (self.last.replace(last), std::mem::replace(&mut self.places, places));
        let found = clock.time("follow", || self.followed(view));
        let again = self.on_from_last(view, found, origin, clock);
        (self.last, self.places) = kept;
        again
    }
}
