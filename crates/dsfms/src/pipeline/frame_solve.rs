//! The solves of a frame that deforms: eq. 3, then eq. 4 or the joint problem from its shape.

use super::logging;
use super::sight::{Described, Sight};
use super::stage_log::StageLog;
use super::{Method, ReconstructError, ReconstructOptions, Reconstruction};
use crate::geometry::Point3;
use crate::image::diagonal;
use crate::image::segment::{Segment, segment};
use crate::raster::rasterize;
use crate::refine::{Joined, Photograph, Refined, join, moved_texture, refine, refine_printed};
use crate::register::scene::visibility;
use crate::register::solve::{explained, kept_matches};
use crate::register::{
    Body, Deformable, Match, Posed, RegisterMemory, Registered, register, register_in,
    register_printed,
};
use crate::solver::Summary;

/// How far from where a shape of the coarse blurs shows a feature of the template it is looked for,
/// of the image's diagonal. Twice that is no better (two choosing scenes,
/// `docs/results/choices.md`).
const REACH: f64 = 0.03;

/// Brightness is unexplained where it costs more than this fraction of its weight after the second
/// look: of seven frames that followed texture mends, six are at 0.43 and more
/// (`docs/results/choices.md`).
const UNEXPLAINED: f64 = 0.4;
/// Fewer places that moved are not followed: on a bare sheet at its true shape five slide. Other
/// values are not measured.
const FOLLOWED: usize = 20;

/// The solves of one frame, on the mesh of `body`.
pub(super) struct FrameSolve<'a> {
    pub(super) sight: &'a Sight<'a>,
    /// Where matches are to be found.
    pub(super) described: Option<&'a Described<'a>>,
    pub(super) body: &'a Body<'a>,
    pub(super) options: &'a ReconstructOptions,
}

/// One look at a frame by the joint solve.
struct JointLook<'a> {
    options: &'a ReconstructOptions,
    /// Matches of followed texture beside those of the frame; none in the second of two looks, so
    /// that what is followed wrong does not hold the shape.
    followed: &'a [Match],
    /// The organ about the shape that the frame is known by so far.
    outline: Option<Segment>,
    /// Whether it is the last of the frame.
    last: bool,
}

/// What two looks from the shape of eq. 3 begin with.
struct TwoLooks<'a> {
    described: &'a Described<'a>,
    coarse: &'a Registered,
    photo: &'a Photograph<'a>,
    /// Of the first and of the second.
    options: [ReconstructOptions; 2],
    /// The organ about the shape of eq. 3.
    outline: Option<Segment>,
}

impl FrameSolve<'_> {
    /// Eq. 3, and from its shape what the method asks for; into `result`.
    pub(super) fn solve(
        &self,
        method: Method,
        matches: &[Match],
        posed: &Posed,
        result: &mut Reconstruction,
        log: &mut StageLog,
    ) -> Result<(), ReconstructError> {
        let on_body = self.body.matches(matches);
        let coarse = log.time("register (eq. 3)", || self.registered(method, &on_body, posed));
        log.attach(&coarse.summary);
        self.take_coarse(matches, &coarse, result);
        if method == Method::Dsfm {
            return Ok(());
        }
        let photo = self.sight.photograph().ok_or(ReconstructError::NoAlbedo(method))?;
        if method == Method::Joint {
            self.joint(&coarse, &photo, result, log);
            return Ok(());
        }
        let kept = kept_matches(&on_body, &coarse.kept);
        let refined = log.time("refine (eq. 4)", || self.refined(&coarse, &kept, &photo));
        log.attach(&refined.summary);
        result.vertices = refined.vertices;
        (result.gain, result.ambient) = (refined.gain, refined.ambient);
        result.shaded = Some(refined.diffuse_vertices);
        Ok(())
    }

    /// Eq. 3, of matches on the mesh of `body`.
    fn registered(&self, method: Method, matches: &[Match], posed: &Posed) -> Registered {
        let (scene, options) = (self.body.scene(), &self.options.register);
        match method {
            _ if self.options.literal => register_printed(scene, matches, posed, options),
            Method::Dsfm => register(scene, matches, posed, options),
            _ => register_in(&mut RegisterMemory::default(), scene, matches, posed, options),
        }
    }

    fn take_coarse(&self, matches: &[Match], coarse: &Registered, result: &mut Reconstruction) {
        let Self { body, .. } = self;
        result.vertices = body.carried(&body.settled(coarse.vertices.clone())).into_owned();
        result.matches = matches.iter().copied().zip(coarse.kept.iter().copied()).collect();
    }

    /// Eq. 4 from the shape of eq. 3.
    fn refined(&self, coarse: &Registered, kept: &[Match], photo: &Photograph) -> Refined {
        let Self { body, options, .. } = self;
        let start = &coarse.vertices;
        if options.literal {
            return refine_printed(body, start, kept, photo, &options.refine);
        }
        let mut refined = refine(body, start, kept, photo, &options.refine);
        // Eq. 3 follows the noise of its matches too: what explains no more than rest does stays at
        // rest.
        let comparison = options.comparison(body, kept, photo);
        let beyond_motion = comparison.kept_beyond(start, refined.vertices);
        refined.vertices = comparison.kept(&body.scene().posed, beyond_motion);
        refined.settled(body)
    }

    /// Motion and shading in one problem. Where that leaves brightness unexplained, texture that
    /// moved farther than descriptors and blurs reach is followed, if it is to be, and the frame is
    /// solved once more with it; the lower cost stays.
    fn joint(
        &self,
        coarse: &Registered,
        photo: &Photograph,
        result: &mut Reconstruction,
        log: &mut StageLog,
    ) {
        let outline = self.segmented(&result.vertices, photo, log);
        let Some((described, looks)) = self.described.zip(self.options.joint.looks()) else {
            let look = JointLook { options: self.options, followed: &[], outline, last: true };
            self.join_from(coarse, &coarse.vertices, photo, look, result, log);
            return;
        };
        let options = looks.map(|joint| ReconstructOptions { joint, ..self.options.clone() });
        let two = TwoLooks { described, coarse, photo, options, outline };
        let by_texture = self.options.joint.follow_texture.then(|| result.clone());
        let found = self.look_twice(&two, &[], result, log);
        let shading = found.term("shading").map_or(0.0, |t| t.after);
        let unexplained = shading > UNEXPLAINED * self.options.joint.shading;
        let Some(mut led) = by_texture.filter(|_| unexplained) else { return };
        let mesh = &self.sight.template.mesh;
        let moved = log.time("texture", || moved_texture(mesh, &led.vertices, photo));
        if moved.len() < FOLLOWED {
            return;
        }
        let other = self.look_twice(&two, &moved, &mut led, log);
        if other.cost().1 < found.cost().1 {
            *result = led;
        }
    }

    /// By the coarse blurs from the shape of eq. 3, led by what is `followed`; then by the fine
    /// ones from where that leads, with the matches that are found about it, the outline about its
    /// silhouette, on a control mesh that is finer where it bends if it is to be. The report of
    /// the second.
    fn look_twice(
        &self,
        two: &TwoLooks,
        followed: &[Match],
        result: &mut Reconstruction,
        log: &mut StageLog,
    ) -> Summary {
        let TwoLooks { described, coarse, photo, options: [first, second], outline } = two;
        let outline = outline.clone();
        let look = JointLook { options: first, followed, outline, last: false };
        self.join_from(coarse, &coarse.vertices, photo, look, result, log);
        log.time("matching again", || self.match_again(described, result));
        let outline = self.segmented(&result.vertices, photo, log);
        let look = JointLook { options: second, followed: &[], outline, last: true };
        let finer = || log.time("finer control mesh", || self.finer(photo, result));
        let Some(finer) = self.options.joint.finer_control.then(finer).flatten() else {
            let found = self.body.restricted(&result.vertices).into_owned();
            return self.join_from(coarse, &found, photo, look, result, log);
        };
        let body = &Body::new(self.body.full(), &finer, self.options.register.anchor);
        let on_finer = |full: &[Point3]| body.restricted(full).into_owned();
        let vertices = on_finer(&self.body.carried(&coarse.vertices));
        let coarse = Registered { vertices, ..(*coarse).clone() };
        let found = on_finer(&result.vertices);
        FrameSolve { body, ..*self }.join_from(&coarse, &found, photo, look, result, log)
    }

    /// What deforms, its control mesh finer where the shape of `result` bends, as far as the frame
    /// asks for that; `None` where it bends little, or explains no more than rest does.
    fn finer(&self, photo: &Photograph, result: &Reconstruction) -> Option<Deformable> {
        let body = self.body;
        let kept = body.matches(&matches_kept(result)).into_owned();
        let found = body.restricted(&result.vertices).into_owned();
        let comparison = self.options.comparison(body, &kept, photo);
        body.finer(&comparison.kept(&body.scene().posed, found))
    }

    /// The joint solve of a look after `coarse`, from `start`, by the matches of `result` that are
    /// kept and those followed, into `result`. Its report.
    fn join_from(
        &self,
        coarse: &Registered,
        start: &[Point3],
        photo: &Photograph,
        JointLook { options, followed, outline, last }: JointLook,
        result: &mut Reconstruction,
        log: &mut StageLog,
    ) -> Summary {
        let body = self.body;
        let mut kept = matches_kept(result);
        kept.extend(followed);
        let kept = body.matches(&kept);
        let photo = match &outline {
            Some(Segment { outline, usable, .. }) => {
                Photograph { outline: Some(outline), usable, ..*photo }
            }
            None => *photo,
        };
        let joined =
            log.time("joint", || joined(body, coarse, start, &kept, &photo, options, last));
        log.attach(&joined.summary);
        result.vertices = joined.vertices;
        (result.gain, result.ambient) = (joined.gain, joined.ambient);
        result.shaded = Some(joined.samples);
        result.outline = outline.map(|segment| segment.outline);
        joined.summary
    }

    /// The matches that descriptors find about the shape of `result`, in the place of those found
    /// before, if they are more; the given ones stay. Kept are those that the shape explains.
    fn match_again(&self, described: &Described, result: &mut Reconstruction) {
        let Described { search, seen } = described;
        let (observation, mesh) = (self.sight.observation, &self.sight.template.mesh);
        let visible = visibility(observation.camera, mesh, &result.vertices);
        let expected = search.expected(observation.camera, mesh, &result.vertices, &visible);
        let found = search.near(seen, &expected, REACH * diagonal(observation.frame.size));
        let given = observation.matches.map_or(0, <[Match]>::len);
        let before = result.matches[given..].iter().filter(|m| m.1).count();
        if found.len() <= before {
            return;
        }
        let given = result.matches[..given].iter().map(|m| m.0);
        let all: Vec<Match> = given.chain(found).collect();
        let (body, register) = (self.body, &self.options.register);
        let shape = body.restricted(&result.vertices);
        let (kept, _) = explained(body.scene(), &body.matches(&all), &shape, register);
        result.matches = all.into_iter().zip(kept).collect();
    }

    /// The organ by its colours, about the silhouette of `shape` (camera axes), if it is asked for
    /// and no mask says.
    fn segmented(
        &self,
        shape: &[Point3],
        photo: &Photograph,
        log: &mut StageLog,
    ) -> Option<Segment> {
        let Self { sight, options, .. } = self;
        if !options.joint.find_outline || sight.observation.organ.is_some() {
            return None;
        }
        let found = log.time("outline", || {
            let rough = rasterize(photo.camera, &sight.template.mesh.topology, shape).silhouette();
            segment(&photo.picture.linear, &rough, photo.usable)
        })?;
        logging::outline(sight.observation.frame, found.marked);
        Some(found)
    }
}

/// The matches of a result that its shape explains.
fn matches_kept(result: &Reconstruction) -> Vec<Match> {
    result.matches.iter().filter(|m| m.1).map(|m| m.0).collect()
}

/// Motion and shading in one problem, from `start`, after the shape of eq. 3; `kept`: the matches
/// that it explains, on the mesh of `body`. After the `last` solve of a frame what explains no more
/// than rest does stays at rest.
pub(crate) fn joined(
    body: &Body,
    coarse: &Registered,
    start: &[Point3],
    kept: &[Match],
    photo: &Photograph,
    options: &ReconstructOptions,
    last: bool,
) -> Joined {
    let shapes = [&coarse.vertices, start];
    let mut joined = join(body, shapes, coarse.depth_sigma, kept, photo, &options.joint);
    if last {
        let still = &body.scene().posed;
        joined.vertices = options.comparison(body, kept, photo).kept(still, joined.vertices);
    }
    joined.settled(body)
}
