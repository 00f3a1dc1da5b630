//! Matches of a frame from the last shape: places of the rendered template carried on by its motion
//! and then by their look, and those that descriptors found, by the look of the frame that they
//! were found in.

use super::candidate::Last;
use super::covered::CoveredCells;
use super::look::{Anchor, Look};
use super::places::{Earlier, FollowedPlace, stays};
use super::prepare::View;
use super::tracker::Tracker;
use crate::camera::Camera;
use crate::geometry::{Isometry, Neighbours, Point2, Point3, Vector2, align_rigid_few, median};
use crate::image::Plane;
use crate::image::flow::{correlation, follow, settle, whole};
use crate::register::Match;
use crate::register::find::agreeing;
use crate::register::pose_near;
use rayon::prelude::*;
use std::sync::Arc;

/// A followed place moves like its neighbours within this and a third of their motion, px of the
/// working image.
const STRAY_PX: f64 = 1.5;

/// The same of a place that descriptors found, which are less exact than the rendered template.
const SOUGHT_STRAY_PX: f64 = 3.0;

/// Where a place was last is another start than where it is expected, px of the working image.
const APART_PX: f64 = 4.0;

/// Least correlation of a patch with white pixels in it. The albedo holds no highlights, so that a
/// patch which looks like it in spite of them is pale tissue.
const PALE: f64 = 0.85;

/// Of the places that could be followed at least this share is, or they are sought by their
/// neighbours' motion too.
const ENOUGH: f64 = 0.6;

/// Neighbours whose motion tells where a place is sought.
const NEIGHBOURS: usize = 8;

/// Fewest matches that tell the motion of the whole.
const LEAST: usize = 12;

/// A rotation by more changes how patches look, radians.
const TURNED: f64 = 0.08;

/// A change of distance by more does so too, of the distance.
const NEARER: f64 = 0.08;

/// Matches of a frame.
#[derive(Default)]
pub(super) struct FollowedMatches {
    pub(super) matches: Vec<Match>,
    /// Of the last of the matches, in their order: the places that descriptors found.
    pub(super) places: Vec<FollowedPlace>,
}

/// A place found in the working image.
#[derive(Clone, Copy)]
struct TrackedPlace {
    face: u32,
    barycentric: [f64; 3],
    place: Point2,
    /// From where the last shape has it.
    offset: Vector2,
}

/// What places are followed by: a rendered shape, and where the frame may show it.
struct ShownLook<'a> {
    look: &'a Look,
    start: &'a [Point3],
}

impl Tracker<'_> {
    /// Matches of the last shape's places, in the order of the anchors and then of the places that
    /// descriptors found.
    pub(super) fn followed(&self, view: &View) -> FollowedMatches {
        let Some(last) = &self.last else { return FollowedMatches::default() };
        let start = self.expected(last);
        let mut tracks = self.by_look(view, last, &ShownLook { look: &last.look, start });
        if (tracks.len() as f64) < ENOUGH * self.could_be(view, &last.look, start) as f64
            && let Some(better) = self.turned(view, last, start, &tracks)
            && better.len() > tracks.len()
        {
            tracks = better;
        }
        // Where the render holds on to as many places, nothing moved that the last motion does not
        // foretell.
        let enough = tracks.len() >= self.places.len();
        let places = match enough {
            true => self.carried_places(view, last, start, &tracks),
            false => self.places_by_motion(view, last, start, &tracks),
        };
        let pixel = |t: &TrackedPlace| Match {
            face: t.face,
            barycentric: t.barycentric,
            pixel: self.working.to_frame(t.place),
        };
        let matches = tracks.iter().chain(places.iter().map(|p| &p.0)).map(pixel).collect();
        FollowedMatches { matches, places: places.into_iter().map(|p| p.1).collect() }
    }

    /// Number of anchors of which the frame may show the whole patch.
    fn could_be(&self, view: &View, look: &Look, start: &[Point3]) -> usize {
        let inside = |a: &&Anchor| {
            let pixel = self.shown_at(start, a.face, a.barycentric);
            pixel.is_some_and(|pixel| whole(&view.seen.open, pixel))
        };
        look.anchors.iter().filter(inside).count()
    }

    /// Where the working camera sees a place of a shape.
    pub(super) fn shown_at(&self, shape: &[Point3], face: u32, at: [f64; 3]) -> Option<Point2> {
        let point = self.template.mesh.topology.point(face, at, shape);
        Some(self.working.camera.project(&point)?.pixel)
    }

    /// Anchors of a rendered shape in the frame, and where too few of them are, those that their
    /// neighbours' motion leads to.
    fn by_look(&self, view: &View, last: &Last, shown: &ShownLook) -> Vec<TrackedPlace> {
        let anchors = &shown.look.anchors;
        let first = |a: &Anchor| self.anchor(view, last, shown, a);
        let found: Vec<_> = anchors.par_iter().map(first).collect();
        let tracks = self.consistent(found.iter().flatten().copied().collect());
        if tracks.len() < LEAST || tracks.len() as f64 >= ENOUGH * anchors.len() as f64 {
            return tracks;
        }
        let mut offsets = vec![None; anchors.len()];
        // Both in the order of the anchors.
        let mut rest = tracks.iter().peekable();
        for (a, offset) in anchors.iter().zip(&mut offsets) {
            let own = |t: &&TrackedPlace| t.face == a.face && t.barycentric == a.barycentric;
            *offset = rest.next_if(own).map(|t| t.place - a.pixel);
        }
        let near = Neighbours::of(anchors.iter().map(|a| a.pixel.coords.into()).collect());
        let again = |(i, a): (usize, &Anchor)| -> Option<(f64, TrackedPlace)> {
            if offsets[i].is_some() {
                return found[i];
            }
            let moved = typical(&near.nearest(i, 3 * NEIGHBOURS), &offsets)?;
            let (render, frame) = (&shown.look.render, &view.seen.pyramid);
            let place = settle(render, frame, a.pixel, a.pixel + moved)?;
            self.accepted(view, last, shown, a, place)
        };
        let found: Vec<_> = anchors.par_iter().enumerate().map(again).collect();
        self.consistent(found.into_iter().flatten().collect())
    }

    /// One anchor in the frame, with how unlike it is.
    fn anchor(
        &self,
        view: &View,
        last: &Last,
        shown: &ShownLook,
        a: &Anchor,
    ) -> Option<(f64, TrackedPlace)> {
        let (render, frame) = (&shown.look.render, &view.seen.pyramid);
        let start = self.shown_at(shown.start, a.face, a.barycentric)?;
        let accepted = |place: Point2| self.accepted(view, last, shown, a, place);
        // Mostly the last motion can be extrapolated; only where it does not must coarser levels
        // tell.
        settle(render, frame, a.pixel, start).and_then(accepted).or_else(|| {
            let elsewhere = (start - a.pixel).norm() > APART_PX;
            let place = follow(render, frame, a.pixel, start);
            let still = || follow(render, frame, a.pixel, a.pixel);
            place.or_else(|| elsewhere.then(still).flatten()).and_then(accepted)
        })
    }

    /// An anchor at a place of the frame, where that may be used and looks like it.
    fn accepted(
        &self,
        view: &View,
        last: &Last,
        shown: &ShownLook,
        a: &Anchor,
        place: Point2,
    ) -> Option<(f64, TrackedPlace)> {
        let frame = &view.seen.pyramid.levels[0];
        let clear = whole(&view.seen.usable, place);
        (clear || whole(&view.seen.open, place)).then_some(())?;
        let alike = correlation(&shown.look.render.levels[0], a.pixel, frame, place)?;
        let least = self.options.correlation;
        let least = if clear { least } else { least.max(PALE) };
        let glare = || !clear && self.glare(last, a, frame, place);
        (alike >= least && !glare()).then_some(())?;
        let (face, barycentric) = (a.face, a.barycentric);
        let offset = place - self.shown_at(&last.vertices, face, barycentric)?;
        Some((1.0 - alike, TrackedPlace { face, barycentric, place, offset }))
    }

    /// Whether what the frame shows at a place was there before in the image, when the tissue was
    /// elsewhere.
    fn glare(&self, last: &Last, a: &Anchor, frame: &Plane, place: Point2) -> bool {
        let was = self.shown_at(&last.earlier.vertices, a.face, a.barycentric);
        let earlier = &last.earlier.pyramid.levels[0];
        was.is_none_or(|was| stays(earlier, Vector2::zeros(), was, frame, place))
    }

    /// The anchors again, where the motion of the whole that the matches tell is another than
    /// expected: of the last look where patches look the same after it, else rendered anew.
    fn turned(
        &self,
        view: &View,
        last: &Last,
        start: &[Point3],
        tracks: &[TrackedPlace],
    ) -> Option<Vec<TrackedPlace>> {
        let motion = self.motion(start, tracks)?;
        let shape: Vec<Point3> = start.iter().map(|v| motion * v).collect();
        let whole = align_rigid_few(&last.vertices, &shape)?;
        let depth = |s: &[Point3]| s.iter().map(|p| p.z).sum::<f64>() / s.len().max(1) as f64;
        let nearer = (depth(&shape) / depth(&last.vertices) - 1.0).abs() > NEARER;
        if whole.rotation.angle() < TURNED && !nearer {
            return None;
        }
        let rest = &self.template.mesh;
        let look = Look::new(&self.working, rest, &shape, &self.lit(&shape), &self.albedo);
        Some(self.by_look(view, last, &ShownLook { look: &look, start: &shape }))
    }

    /// The rigid motion of a shape that tracks tell; `None` of too few.
    fn motion(&self, start: &[Point3], tracks: &[TrackedPlace]) -> Option<Isometry> {
        if tracks.len() < LEAST {
            return None;
        }
        let pixels: Vec<Point2> = tracks.iter().map(|t| self.working.to_frame(t.place)).collect();
        let topology = &self.template.mesh.topology;
        let points: Vec<Point3> =
            tracks.iter().map(|t| topology.point(t.face, t.barycentric, start)).collect();
        let options = &self.options.reconstruct.register;
        Some(pose_near(self.camera, &points, &pixels, options, Isometry::identity()).ok()?.pose)
    }

    /// The places that descriptors found, where no anchor tells the same: from where the motion
    /// that the anchors tell puts them, and again from where they do so themselves.
    fn places_by_motion(
        &self,
        view: &View,
        last: &Last,
        start: &[Point3],
        tracks: &[TrackedPlace],
    ) -> Vec<(TrackedPlace, FollowedPlace)> {
        if self.places.is_empty() {
            return Vec::new();
        }
        let moved = |tracks: &[TrackedPlace]| -> Option<Vec<Point3>> {
            let motion = self.motion(start, tracks)?;
            Some(start.iter().map(|v| motion * v).collect())
        };
        let shape = moved(tracks);
        let found = self.carried_places(view, last, shape.as_deref().unwrap_or(start), tracks);
        if found.len() as f64 >= ENOUGH * self.places.len() as f64 {
            return found;
        }
        let all: Vec<TrackedPlace> =
            tracks.iter().copied().chain(found.iter().map(|f| f.0)).collect();
        let Some(shape) = moved(&all) else { return found };
        let again = self.carried_places(view, last, &shape, tracks);
        if again.len() > found.len() { again } else { found }
    }

    /// The places near where a shape has them.
    fn carried_places(
        &self,
        view: &View,
        last: &Last,
        start: &[Point3],
        tracks: &[TrackedPlace],
    ) -> Vec<(TrackedPlace, FollowedPlace)> {
        let rest = &self.template.mesh;
        let moved = align_rigid_few(&last.vertices, start).unwrap_or_default();
        let pose = moved * last.pose;
        // A motion that nobody expected is that of the anchors.
        let shifts: Vec<Option<Vector2>> = tracks
            .iter()
            .map(|t| Some(t.place - self.shown_at(start, t.face, t.barycentric)?))
            .collect();
        let shift = typical(&(0..shifts.len()).collect::<Vec<_>>(), &shifts).unwrap_or_default();
        let covered = CoveredCells::of(self.working.camera.size, tracks.iter().map(|t| t.place));
        let one = |p: &FollowedPlace| -> Option<(TrackedPlace, FollowedPlace)> {
            let (face, barycentric) = (p.found.face, p.found.barycentric);
            let start = self.shown_at(start, face, barycentric)? + shift;
            (!covered.at(start)).then_some(())?;
            let turn = p.turn(&self.working.camera, rest, &pose);
            let (place, alike) = p.follow(&view.seen.pyramid, start, turn)?;
            let frame = &view.seen.pyramid.levels[0];
            let clear = whole(&view.seen.usable, place);
            // What a fresh search would take: the place itself, not all around it, is clear.
            let usable = whole(&view.seen.open, place) && view.seen.usable.at_pixel(&place);
            let least = self.options.correlation;
            let good = alike >= if clear { least } else { least.max(PALE) };
            (usable && good && (clear || !p.stays(frame, place))).then_some(())?;
            let offset = place - self.shown_at(&last.vertices, face, barycentric)?;
            Some((TrackedPlace { face, barycentric, place, offset }, p.clone()))
        };
        let found: Vec<_> = self.places.par_iter().map(one).collect();
        let found: Vec<(TrackedPlace, FollowedPlace)> = found.into_iter().flatten().collect();
        let all: Vec<TrackedPlace> =
            tracks.iter().copied().chain(found.iter().map(|f| f.0)).collect();
        let agreeing = self.agreeing(&all, SOUGHT_STRAY_PX);
        let kept = agreeing.into_iter().filter_map(|i| i.checked_sub(tracks.len()));
        kept.map(|i| found[i].clone()).collect()
    }

    /// What is not much less alike than most, and moves like its neighbours.
    fn consistent(&self, found: Vec<(f64, TrackedPlace)>) -> Vec<TrackedPlace> {
        let tracks = alike_enough(found);
        self.agreeing(&tracks, STRAY_PX).into_iter().map(|i| tracks[i]).collect()
    }

    /// Neighbours move alike, so that a patch which settled on another texture stands out.
    fn agreeing(&self, tracks: &[TrackedPlace], slack: f64) -> Vec<usize> {
        let pixels: Vec<Point2> = tracks.iter().map(|t| self.working.to_frame(t.place)).collect();
        let offsets: Vec<_> = tracks.iter().map(|t| Some(t.offset)).collect();
        agreeing(&pixels, &offsets, f64::INFINITY, slack)
    }
}

/// An earlier frame is kept for so many, or until the surface has moved on by more than so many px
/// of the working image.
const EARLIER: (usize, f64) = (12, 12.0);

/// Vertices that this is told by.
const FEW: usize = 40;

impl Tracker<'_> {
    /// This frame with its surface, as later ones compare with it.
    pub(super) fn as_earlier(&self, view: &View, vertices: &[Point3]) -> Arc<Earlier> {
        let (frame, pyramid) = (self.count, view.seen.pyramid.clone());
        Arc::new(Earlier { frame, pyramid, vertices: vertices.to_vec() })
    }

    /// Whether an earlier frame still tells what stays in the image from what moves.
    pub(super) fn still_earlier(&self, earlier: &Earlier, vertices: &[Point3]) -> bool {
        let (frames, most) = EARLIER;
        let camera = &self.working.camera;
        let step = vertices.len().div_ceil(FEW).max(1);
        let pairs = earlier.vertices.iter().zip(vertices).step_by(step);
        let moved = |(a, b): (&Point3, &Point3)| {
            Some((camera.project(a)?.pixel - camera.project(b)?.pixel).norm())
        };
        let typical = median(&mut pairs.filter_map(moved).collect::<Vec<f64>>());
        self.count < earlier.frame + frames && typical.is_some_and(|moved| moved < most)
    }

    /// Keep the places that a surface explains; where it was followed, for a while those too that
    /// it did not show.
    pub(super) fn remember_places(&mut self, held: Vec<FollowedPlace>, followed: bool) {
        let now = self.count;
        if followed {
            self.places.retain(|p| p.lasts(now) && !held.iter().any(|h| h.same(p)));
        } else {
            self.places.clear();
        }
        self.places.extend(held.into_iter().map(|p| p.held_at(now)));
        self.places.retain(|p| p.lasts(now));
    }
}

/// What is not much less alike than most.
fn alike_enough<T>(found: Vec<(f64, T)>) -> Vec<T> {
    let mut unlike: Vec<f64> = found.iter().map(|f| f.0).collect();
    let limit = 2.0 * median(&mut unlike).unwrap_or(0.0);
    found.into_iter().filter(|f| f.0 <= limit).map(|f| f.1).collect()
}

/// Median by axis of the first few known offsets of those that are named; `None` where hardly any
/// is.
fn typical(named: &[usize], offsets: &[Option<Vector2>]) -> Option<Vector2> {
    let known: Vec<Vector2> = named.iter().filter_map(|&i| offsets[i]).collect();
    let axis = |k: usize| median(&mut known.iter().map(|o| o[k]).collect::<Vec<f64>>());
    (known.len() >= 3).then(|| Some(Vector2::new(axis(0)?, axis(1)?)))?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_typical_offset_is_a_median_of_what_is_known() {
        let known = [1.0, 2.0, 9.0].map(|x| Some(Vector2::new(x, -x)));
        let offsets = [&known[..], &[None]].concat();
        assert_eq!(typical(&[0, 1, 2, 3], &offsets), Some(Vector2::new(2.0, -2.0)));
        assert_eq!(typical(&[0, 1, 3], &offsets), None);
    }
}
