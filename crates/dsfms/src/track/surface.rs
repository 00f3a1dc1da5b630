//! The surface that matches give: with nothing known, or from the shape of the previous frame.

use super::candidate::Last;
use super::clock::Clock;
use super::exposed::Shown;
use super::look::edge_px;
use super::prepare::View;
use super::tracker::{Draft, Tracker};
use super::{Origin, TrackOptions};
use crate::camera::Camera;
use crate::geometry::{Isometry, Point2, Point3, align_rigid_few};
use crate::image::diagonal;
use crate::pipeline::{Method, joined};
use crate::refine::{Joined, Near, NearFrame, Photograph, VideoMemory, join_near};
use crate::register::solve::{depth_tolerance, errors_px, explained, kept_matches};
use crate::register::{
    Body, KnownPoses, Match, Posed, RegisterError, Registered, Scene, pose, pose_near, posed_from,
    register_in, register_near,
};
use crate::verdict::NoSurface;
use std::borrow::Cow;

/// Matches that the motion since the last frame is taken from at most.
const FEW: usize = 150;

impl Tracker<'_> {
    /// The surface that matches give with nothing known; the error says why there is none.
    pub(super) fn anew(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        clock: &mut Clock,
    ) -> Result<Draft, NoSurface> {
        self.enough(&matches)?;
        let (rest, options) = (&self.template.mesh, &self.options.reconstruct);
        let posed = clock
            .time("pose", || pose(self.camera, rest, &matches, &options.register, options.seed));
        let posed = posed.and_then(|posed| self.posed_from(&matches, posed));
        let posed = posed?;
        let memory = &mut self.memory.register;
        let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
        let scene = clock.time("register", || Scene::new(self.camera, rest, rigid));
        let body = Body::new(&scene, &self.deformable, options.register.anchor);
        let on_body = body.matches(&matches);
        let coarse = clock.time("register", || {
            register_in(memory, body.scene(), &on_body, &posed, &options.register)
        });
        let mut draft = Draft::of(&body, &posed, &matches, &coarse);
        let mut video = std::mem::take(&mut self.memory.video);
        if let Some(photo) = self.photograph(view, &draft.vertices) {
            let (kept, options) = (kept_matches(&on_body, &coarse.kept), &self.options);
            let joined = clock.time("joint", || match options.brief_search {
                false => {
                    let (start, options) = (&coarse.vertices, &options.reconstruct);
                    joined(&body, &coarse, start, &kept, &photo, options, true)
                }
                true => joined_briefly(&mut video, &body, &coarse, &kept, &photo, options),
            });
            draft.shown = Shown { at_matches: joined.at_matches, changed: joined.exposure_changed };
            (draft.vertices, draft.ambient) = (joined.vertices, joined.ambient);
            draft.photometric = (joined.samples > 0).then_some(joined.residual);
            draft.measure(&scene);
        }
        self.memory.video = video;
        Ok(draft)
    }

    /// The surface near the last one that followed matches give; the error says why there is none.
    pub(super) fn carried(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        origin: Origin,
        clock: &mut Clock,
    ) -> Result<Draft, NoSurface> {
        self.beside_last(view, matches, origin, clock, |tracker, last, matches| {
            let options = &tracker.options.reconstruct.register;
            let to = |matches: &[Match], points: &[Point3], start: Isometry| {
                let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
                pose_near(tracker.camera, &tracker.on(matches, points), &pixels, options, start)
            };
            let (shape, rest) = (tracker.expected(last), &tracker.template.mesh.positions);
            // A start need not come of all.
            let few = matches.iter().step_by(matches.len().div_ceil(FEW)).copied();
            let few: Vec<Match> = few.collect();
            let moved = to(&few, shape, Isometry::identity())?.pose;
            let base = align_rigid_few(&last.vertices, shape).unwrap_or_default();
            let posed = to(matches, rest, moved * base * last.pose)?;
            let posed = tracker.posed_from(matches, posed)?;
            Ok(tracker.near(last, shape, moved, posed, false))
        })
    }

    /// The surface bent as it was last, where the template was found again.
    pub(super) fn again(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        clock: &mut Clock,
    ) -> Result<Draft, NoSurface> {
        self.beside_last(view, matches, Origin::Found, clock, |tracker, last, matches| {
            let options = &tracker.options.reconstruct;
            let (rest, register) = (&tracker.template.mesh, &options.register);
            let posed = pose(tracker.camera, rest, matches, register, options.seed)?;
            let posed = tracker.posed_from(matches, posed)?;
            let motion = posed.pose * last.pose.inverse();
            Ok(tracker.near(last, &last.vertices, motion, posed, true))
        })
    }

    /// The pose of the matches, or that of the camera where it is known: at rest, or by the
    /// surroundings.
    fn posed_from(&self, matches: &[Match], found: Posed) -> Result<Posed, RegisterError> {
        let (rest, options) = (&self.template.mesh, &self.options.reconstruct.register);
        let around = self.camera_sight.filter(|sight| sight.contradicts(&found.pose, rest));
        let around = around.map(|sight| sight.pose);
        let known = KnownPoses { views: &self.template.views, around };
        posed_from(&known, self.camera, rest, matches, found, options)
    }

    /// The surface solved from where `start` puts the last one.
    fn beside_last(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        origin: Origin,
        clock: &mut Clock,
        start: impl FnOnce(&Self, &Last, &[Match]) -> Result<Start, RegisterError>,
    ) -> Result<Draft, NoSurface> {
        self.enough(&matches)?;
        let last = self.last.as_ref().ok_or(NoSurface::NothingToFollow)?;
        let near = clock.time("pose", || start(self, last, &matches))?;
        Ok(self.solved(view, matches, near, origin, clock))
    }

    /// A shape like the last moved by a motion, as a start.
    fn near(
        &self,
        last: &Last,
        shape: &[Point3],
        motion: Isometry,
        posed: Posed,
        gap: bool,
    ) -> Start {
        let shape: Vec<Point3> = shape.iter().map(|v| motion * v).collect();
        let visible = last.look.visible.clone();
        let rest = &self.template.mesh.positions;
        // A near light tells the distance of everything, so the shape knows the pose better than
        // the matches do; under a distant one, and for motion alone, only they hold it.
        let by_shading = self.method == Method::Joint && self.light.light.tells_distance();
        let base = if by_shading && !posed.at_rest {
            let seen = |shape: &[Point3]| -> Vec<Point3> {
                shape.iter().zip(&visible).filter(|s| *s.1).map(|s| *s.0).collect()
            };
            align_rigid_few(&seen(rest), &seen(&shape)).unwrap_or(posed.pose)
        } else {
            posed.pose
        };
        let rigid = rest.iter().map(|p| base * p).collect();
        Start { shape, ambient: last.ambient, gap, posed, rigid, visible }
    }

    fn solved(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        near: Start,
        origin: Origin,
        clock: &mut Clock,
    ) -> Draft {
        let mut memory = std::mem::take(&mut self.memory);
        let rest = &self.template.mesh;
        let scene = clock.time("pose", || {
            let (rigid, visible) = (near.rigid.clone(), near.visible.clone());
            Scene::seen(self.camera, rest, rigid, visible, Cow::Borrowed(&self.laplacian))
        });
        let body = Body::new(&scene, &self.deformable, self.options.reconstruct.register.anchor);
        let draft = match self.photograph(view, &near.shape) {
            None => {
                let (memory, start) = (&mut memory.register, body.restricted(&near.shape));
                let options = &self.options.reconstruct.register;
                let coarse = clock.time("register", || {
                    let on_body = body.matches(&matches);
                    register_near(memory, body.scene(), &on_body, &near.posed, &start, options)
                });
                Draft::of(&body, &near.posed, &matches, &coarse)
            }
            Some(photo) => clock.time("joint", || {
                self.shaded(&mut memory.video, &body, &matches, &near, &photo, origin)
            }),
        };
        self.memory = memory;
        draft
    }

    /// The joint solve from a start.
    fn shaded(
        &self,
        memory: &mut VideoMemory,
        body: &Body,
        matches: &[Match],
        near: &Start,
        photo: &Photograph,
        origin: Origin,
    ) -> Draft {
        let (options, video) = (&self.options.reconstruct, &self.options.video);
        let (scene, posed) = (body.scene(), &near.posed);
        let (on_body, start) = (body.matches(matches), body.restricted(&near.shape));
        let jumped = self.out_of_reach(scene, &on_body, &start);
        let depth_sigma = depth_tolerance(scene, &on_body, posed, &start, &options.register);
        let by_matches: Vec<Point3> = scene.rest.positions.iter().map(|p| posed.pose * p).collect();
        let frame = NearFrame { body, matches: &on_body, posed: &by_matches, depth_sigma, photo };
        let near = Near { shape: &start, ambient: near.ambient, gap: near.gap || jumped };
        let found = join_near(memory, &frame, near, &options.joint, video);
        let (kept, residual_px) = explained(scene, &on_body, &found.vertices, &options.register);
        let vertices = match origin {
            Origin::Followed => found.vertices,
            Origin::Found => {
                let kept = kept_matches(&on_body, &kept);
                options.comparison(body, &kept, photo).kept(&scene.posed, found.vertices)
            }
        };
        let mut draft = Draft {
            vertices: body.carried(&vertices).into_owned(),
            pose: posed.pose,
            matches: matches.iter().copied().zip(kept).collect(),
            residual_px,
            reprojection_px: 0.0,
            depth_uncertainty: depth_sigma / scene.radius(),
            photometric: (found.samples > 0).then_some(found.residual),
            ambient: found.ambient,
            shown: Shown { at_matches: found.at_matches, changed: found.exposure_changed },
            jumped,
        };
        draft.measure(body.full());
        draft
    }

    /// Whether a tenth of the matches moved on from a shape by more than the blur of its solve:
    /// shading must be brought within reach by coarser ones.
    fn out_of_reach(&self, scene: &Scene, matches: &[Match], shape: &[Point3]) -> bool {
        let mut errors = errors_px(scene, matches, shape);
        errors.sort_unstable_by(f64::total_cmp);
        let tenth = errors.get(9 * errors.len() / 10);
        tenth.is_some_and(|&e| e > self.options.video.blur * diagonal(self.camera.size()))
    }

    /// The points of matches on a shape.
    pub(super) fn on(&self, matches: &[Match], shape: &[Point3]) -> Vec<Point3> {
        let topology = &self.template.mesh.topology;
        matches.iter().map(|m| topology.point(m.face, m.barycentric, shape)).collect()
    }

    fn enough(&self, matches: &[Match]) -> Result<(), NoSurface> {
        let (found, needed) = (matches.len(), self.options.reconstruct.verdict.matches[0]);
        if found < needed {
            return Err(NoSurface::FewMatches { found, needed });
        }
        Ok(())
    }

    /// The frame as shading is read from it; `None` for the method without.
    pub(super) fn photograph<'b>(
        &'b self,
        view: &'b View,
        shape: &[Point3],
    ) -> Option<Photograph<'b>> {
        let camera = &self.working.photo;
        let edge = edge_px(camera, self.template.mesh.mean_edge_length(), shape);
        (self.method == Method::Joint).then(|| Photograph {
            camera,
            picture: &view.photo.picture,
            usable: &view.photo.usable,
            outline: None,
            light: &self.light,
            albedo: &self.albedo.for_edge(edge).texels,
            exposure: self.expected_exposure(),
        })
    }
}

/// The joint solve from eq. 3 by the steps of a followed frame.
fn joined_briefly(
    memory: &mut VideoMemory,
    body: &Body,
    coarse: &Registered,
    kept: &[Match],
    photo: &Photograph,
    options: &TrackOptions,
) -> Joined {
    let (scene, depth_sigma) = (body.scene(), coarse.depth_sigma);
    let frame = NearFrame { body, matches: kept, posed: &scene.posed, depth_sigma, photo };
    let near = Near { shape: &coarse.vertices, ambient: 0.0, gap: true };
    join_near(memory, &frame, near, &options.reconstruct.joint, &options.video).settled(body)
}

/// Where the solve of a frame begins.
struct Start {
    shape: Vec<Point3>,
    ambient: f64,
    /// The shape is that of many frames ago.
    gap: bool,
    /// The rest shape by its matches.
    posed: Posed,
    /// The rest shape from which bending is counted.
    rigid: Vec<Point3>,
    visible: Vec<bool>,
}

impl Draft {
    fn of(body: &Body, posed: &Posed, matches: &[Match], coarse: &Registered) -> Self {
        let settled = body.settled(coarse.vertices.clone());
        let mut draft = Self {
            vertices: body.carried(&settled).into_owned(),
            pose: posed.pose,
            matches: matches.iter().copied().zip(coarse.kept.iter().copied()).collect(),
            residual_px: coarse.residual_px,
            reprojection_px: 0.0,
            depth_uncertainty: coarse.depth_sigma / body.scene().radius(),
            photometric: None,
            ambient: 0.0,
            shown: Shown::default(),
            jumped: false,
        };
        draft.measure(body.full());
        draft
    }

    fn kept(&self) -> Vec<Match> {
        self.matches.iter().filter(|m| m.1).map(|m| m.0).collect()
    }

    /// Mean distance of the kept matches.
    fn measure(&mut self, scene: &Scene) {
        let errors = errors_px(scene, &self.kept(), &self.vertices);
        self.reprojection_px = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    }
}
