//! How a frame gets its surface: followed from the last one, found again, or both.

use super::judged::Candidate;
use super::prepare::View;
use super::tracker::{Clock, Last, Tracker};
use super::{Origin, TrackStatus};
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
                let matches = clock.time("follow", || self.followed(view));
                let draft = self.carried(view, matches, Origin::Followed, clock);
                draft.map(|draft| self.judged(view, draft, Origin::Followed, clock))
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
        let again = again.and_then(Result::ok).map(|d| self.judged(view, d, Origin::Found, clock));
        let anew = self.anew(view, matches, clock).map(|draft| {
            let first = self.judged(view, draft, Origin::Found, clock);
            self.followed_at_once(view, first, clock)
        });
        match (again, anew) {
            (Some(again), Ok(anew)) if anew.beats(&again) => Ok(anew),
            (Some(again), _) => Ok(again),
            (None, anew) => anew,
        }
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
        });
        let matches = clock.time("follow", || self.followed(view));
        let again = self.carried(view, matches, Origin::Found, clock);
        let again = again.map(|draft| self.judged(view, draft, Origin::Found, clock));
        self.last = earlier;
        match again {
            Ok(again) if again.verdict.level <= first.verdict.level => again,
            _ => first,
        }
    }
}
