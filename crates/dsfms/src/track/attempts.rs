//! How a frame gets its surface: followed from the last one, found again, or both.

use super::candidate::Candidate;
use super::follow::FollowedMatches;
use super::places::FollowedPlace;
use super::prepare::View;
use super::tracker::{Clock, Last, Tracker};
use super::{Origin, TrackStatus};
use crate::geometry::Isometry;
use crate::image::Frame;
use crate::register::Match;
use crate::verdict::Reason;
use crate::verdict::intrinsics::other_camera;

/// Features of a frame that are looked up at most; more tell little.
const MOST_FEATURES: usize = 2000;

/// Searches beside a degraded surface that found nothing better make the next one this much rarer at
/// most.
const RAREST: usize = 16;

impl Tracker<'_> {
    /// Follow, and find where that is not good enough; the better of both.
    pub(super) fn attempts(
        &mut self,
        frame: &Frame,
        view: &View,
        clock: &mut Clock,
    ) -> Result<Candidate, String> {
        let fresh =
            |last: &Last| (self.count - last.frame <= self.options.patience).then_some(last.frame);
        let followed = match self.last.as_ref().and_then(fresh) {
            Some(_) => {
                let found = clock.time("follow", || self.followed(view));
                self.on_from_last(view, found, Origin::Followed, clock)
            }
            None => Err("not found yet".to_owned()),
        };
        let due = |at: usize| self.count >= at + self.rarer * self.options.search_every;
        match &followed {
            // Where a surface jumped, the last shape is no better a start than the rest shape.
            Ok(c) if c.jumped => {}
            Ok(c) if c.verdict.level == TrackStatus::Ok => {
                self.rarer = 1;
                return followed;
            }
            Ok(c) if c.verdict.level == TrackStatus::Degraded => {
                // What covers a part, or veils all, is no matter of where the template is.
                let veil =
                    |r: &Reason| matches!(r, Reason::RegionContradicted(_) | Reason::Faint { .. });
                if c.verdict.reasons.iter().all(veil) || !self.searched.is_none_or(due) {
                    return followed;
                }
            }
            _ => {}
        }
        if matches!(&followed, Ok(c) if c.verdict.level == TrackStatus::Degraded) {
            self.searched = Some(self.count);
        }
        let seed = self.options.reconstruct.seed;
        let matches = clock.time("find", || {
            let seen = view.features(frame, &self.working, MOST_FEATURES);
            let options = &self.options.reconstruct.register;
            self.search.matches(self.camera, &seen, options, seed)
        });
        let found = matches
            .map_err(|error| error.to_string())
            .and_then(|matches| self.found(view, matches, clock));
        let keep = match (&followed, &found) {
            (Ok(a), Ok(b)) => a.verdict.level < TrackStatus::Lost && !b.beats(a),
            (Ok(a), Err(_)) => a.verdict.level < TrackStatus::Lost,
            (Err(_), _) => false,
        };
        self.rarer = if keep { (2 * self.rarer).min(RAREST) } else { 1 };
        if keep { followed } else { found }
    }

    /// The surface where the template was found: bent as it was last, or from nothing.
    fn found(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        clock: &mut Clock,
    ) -> Result<Candidate, String> {
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
        let anew = self.anew(view, matches, clock).map(|draft| {
            let first = self.judged(view, draft, Origin::Found, clock);
            let first = self.with_places(view, first);
            self.followed_at_once(view, first, clock)
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
    ) -> Result<Candidate, String> {
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

    /// A surface found from nothing, followed within its own frame: its look finds more matches than
    /// descriptors do. The first where following it ends worse.
    fn followed_at_once(&mut self, view: &View, first: Candidate, clock: &mut Clock) -> Candidate {
        if first.verdict.level == TrackStatus::Lost {
            return first;
        }
        let vertices = first.surface.vertices.clone();
        let earlier = self.last.replace(Last {
            frame: self.count,
            ahead: vertices.clone(),
            vertices,
            pose: first.surface.pose,
            ambient: first.ambient,
            look: first.look.clone(),
            earlier: self.as_earlier(view, &first.surface.vertices),
        });
        let places = std::mem::replace(&mut self.places, first.places.clone());
        let found = clock.time("follow", || self.followed(view));
        let again = self.on_from_last(view, found, Origin::Found, clock);
        (self.last, self.places) = (earlier, places);
        match again {
            // Places that anchors cover now may be wanted in the next frames.
            Ok(again) if again.verdict.level <= first.verdict.level => {
                Candidate { places: first.places, ..again }
            }
            _ => first,
        }
    }
}
