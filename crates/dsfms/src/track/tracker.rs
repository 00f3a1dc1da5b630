//! The state between frames, and one frame's way through find, follow and verdict.

use super::flow::{correlation, follow};
use super::look::{Look, Seen, Working, whole};
use super::prepare::{Preparation, Prepared};
use super::verdict::judge;
use super::{Surface, TrackError, TrackOptions, TrackStatus, Tracked, Way};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point3, align_rigid_robust, point_at};
use crate::image::{Frame, Mask, Picture, ToneCurve};
use crate::light::LightModel;
use crate::pipeline::Method;
use crate::refine::{Photograph, join};
use crate::register::objective::errors_px;
use crate::register::{
    Match, Posed, RegisterMemory, RegisterOptions, Scene, find, pose, register_in,
};
use crate::template::{Features, SurfaceTexels, Template};
use rayon::prelude::*;
use std::time::Instant;

/// Follows a template through the frames of one camera.
pub struct Tracker<'a> {
    template: &'a Template,
    albedo: &'a SurfaceTexels,
    features: &'a Features,
    light: LightModel,
    camera: &'a CameraModel,
    options: TrackOptions,
    working: Working,
    memory: RegisterMemory,
    preparation: Preparation,
    last: Option<Last>,
    /// Frames given.
    count: usize,
    /// Frame of the last search by descriptors beside a degraded surface.
    searched: Option<usize>,
}

/// The last surface that was not lost.
struct Last {
    frame: usize,
    vertices: Vec<Point3>,
    look: Look,
    /// Rigid motion from the frame before it to it.
    motion: Isometry,
}

/// A surface with its judgement.
struct Candidate {
    status: TrackStatus,
    reasons: Vec<String>,
    surface: Surface,
    look: Look,
}

/// What a frame offers to every attempt.
struct View<'f> {
    frame: &'f Frame,
    usable: &'f Mask,
    seen: &'f Seen,
    /// For the joint method.
    picture: Option<&'f Picture>,
}

/// Wall times.
struct Clock(Vec<(&'static str, f64)>);

impl Clock {
    fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let value = work();
        self.0.push((name, start.elapsed().as_secs_f64()));
        value
    }
}

impl<'a> Tracker<'a> {
    /// A tracker that has seen nothing yet.
    ///
    /// # Errors
    /// A template without descriptors or albedo; a method other than motion or joint.
    pub fn new(
        template: &'a Template,
        camera: &'a CameraModel,
        tone: &'a ToneCurve,
        method: Method,
        options: TrackOptions,
    ) -> Result<Self, TrackError> {
        if !matches!(method, Method::Dsfm | Method::Joint) {
            return Err(TrackError::Method(method));
        }
        let working = Working::of(camera);
        let preparation = Preparation::new(camera, tone, &working, method);
        Ok(Self {
            template,
            albedo: template.albedo.as_ref().ok_or(TrackError::NoAlbedo)?,
            features: template.features.as_ref().ok_or(TrackError::NoDescriptors)?,
            light: template.light.clone().unwrap_or_default(),
            camera,
            options,
            working,
            memory: RegisterMemory::default(),
            preparation,
            last: None,
            count: 0,
            searched: None,
        })
    }

    /// Prepares this tracker's frames; may live on another thread. It counts frames by itself: take
    /// one, and give it every frame that [`solve`](Self::solve) gets.
    pub fn preparation(&self) -> Preparation {
        self.preparation.clone()
    }

    /// The next frame; `instrument`: `true` where an instrument covers the organ.
    ///
    /// # Errors
    /// A frame or mask of another size than the camera's. Anything else that goes wrong makes the
    /// frame lost.
    pub fn next(
        &mut self,
        frame: &Frame,
        instrument: Option<&Mask>,
    ) -> Result<Tracked, TrackError> {
        let prepared = self.preparation.prepare(frame.clone(), instrument)?;
        Ok(self.solve(&prepared))
    }

    /// The next frame, prepared by [`preparation`](Self::preparation).
    pub fn solve(&mut self, prepared: &Prepared) -> Tracked {
        self.count += 1;
        let mut clock = Clock(vec![("prepare", prepared.seconds)]);
        let Some(seen) = &prepared.seen else {
            let brightest = prepared.brightest;
            let reasons = vec![format!("the frame is black (brightest pixel {brightest} of 255)")];
            return Tracked { status: TrackStatus::Lost, reasons, surface: None, stages: clock.0 };
        };
        let Prepared { frame, usable, picture, .. } = prepared;
        let view = View { frame, usable, seen, picture: picture.as_ref() };
        let outcome = self.attempts(&view, &mut clock);
        self.settle(outcome, clock.0)
    }

    /// Follow, and find where that is not good enough; the better of both.
    fn attempts(&mut self, view: &View, clock: &mut Clock) -> Result<Candidate, String> {
        let fresh =
            |last: &Last| (self.count - last.frame <= self.options.patience).then_some(last.frame);
        let followed = match self.last.as_ref().and_then(fresh) {
            Some(_) => {
                let matches = clock.time("follow", || self.followed(view));
                self.surface(view, matches, Way::Followed, clock)
            }
            None => Err("not found yet".to_owned()),
        };
        let due = |at: usize| self.count >= at + self.options.search_every;
        match &followed {
            Ok(c) if c.status == TrackStatus::Ok => return followed,
            Ok(c) if c.status == TrackStatus::Degraded && !self.searched.is_none_or(due) => {
                return followed;
            }
            _ => {}
        }
        if matches!(&followed, Ok(c) if c.status == TrackStatus::Degraded) {
            self.searched = Some(self.count);
        }
        let seed = self.options.reconstruct.seed;
        let matches = clock.time("find", || {
            let options = &self.options.reconstruct.register;
            let (rest, frame) = (&self.template.mesh, view.frame);
            find(self.camera, rest, self.features, frame, &view.usable, options, seed)
        });
        let found = matches
            .map_err(|error| error.to_string())
            .and_then(|matches| self.surface(view, matches, Way::Found, clock));
        let rank = |c: &Result<Candidate, String>| {
            c.as_ref().map_or(0.0, |c| match c.status {
                TrackStatus::Ok => 2.0 + c.surface.agreement,
                TrackStatus::Degraded => 1.0 + c.surface.agreement,
                TrackStatus::Lost => 0.0,
            })
        };
        if rank(&followed) >= rank(&found) && rank(&followed) > 0.0 { followed } else { found }
    }

    /// Matches of the last shape's anchors, carried on by its motion and then by their look.
    fn followed(&self, view: &View) -> Vec<Match> {
        let Some(last) = &self.last else { return Vec::new() };
        let faces = &self.template.mesh.topology.faces;
        let (render, frame) = (&last.look.render, &view.seen.pyramid);
        let one = |a: &super::look::Anchor| -> Option<Match> {
            let corners = faces[a.face as usize].map(|v| &last.vertices[v as usize]);
            let ahead = last.motion * point_at(corners, a.barycentric);
            let start = self.working.camera.project(&ahead)?.pixel;
            let place = follow(render, frame, a.pixel, start)
                .or_else(|| follow(render, frame, a.pixel, a.pixel))?;
            whole(&view.seen.usable, place).then_some(())?;
            let alike = correlation(&render.levels[0], a.pixel, &frame.levels[0], place)?;
            (alike >= self.options.correlation).then(|| Match {
                face: a.face,
                barycentric: a.barycentric,
                pixel: self.working.to_frame(place),
            })
        };
        last.look.anchors.par_iter().map(one).collect::<Vec<_>>().into_iter().flatten().collect()
    }

    /// The surface that matches give, judged; the error says why there is none.
    fn surface(
        &mut self,
        view: &View,
        matches: Vec<Match>,
        way: Way,
        clock: &mut Clock,
    ) -> Result<Candidate, String> {
        let needed = self.options.verdict.matches[0];
        if matches.len() < needed {
            let found = matches.len();
            return Err(format!("only {found} matches, at least {needed} are needed"));
        }
        let options = &self.options.reconstruct;
        let rest = &self.template.mesh;
        let posed = clock
            .time("pose", || pose(self.camera, rest, &matches, &options.register, options.seed));
        let posed = posed.map_err(|error| error.to_string())?;
        let memory = &mut self.memory;
        let (scene, coarse) = clock.time("register", || {
            let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
            let scene = Scene::new(self.camera, rest, rigid);
            let options = match way {
                Way::Found => options.register.clone(),
                Way::Followed => narrowed(&options.register, &posed),
            };
            let coarse = register_in(memory, &scene, &matches, &posed, &options);
            (scene, coarse)
        });
        let matches: Vec<(Match, bool)> =
            matches.into_iter().zip(coarse.kept.iter().copied()).collect();
        let mut vertices = coarse.vertices;
        if let Some(picture) = view.picture {
            let kept: Vec<Match> = matches.iter().filter(|m| m.1).map(|m| m.0).collect();
            let start = (vertices.as_slice(), coarse.depth_sigma);
            vertices =
                clock.time("joint", || self.joined(view.usable, picture, &scene, start, &kept));
        }
        let look = clock.time("look", || Look::new(&self.working, rest, &vertices, self.albedo));
        let [agreeing, places] =
            clock.time("agree", || look.agreement(view.seen, self.options.verdict.correlation));
        let agreement = agreeing as f64 / places.max(1) as f64;
        let residual_px = coarse.residual_px;
        let kept: Vec<Match> = matches.iter().filter(|m| m.1).map(|m| m.0).collect();
        let errors = errors_px(&scene, &kept, &vertices);
        let reprojection_px = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        let depth_uncertainty = coarse.depth_sigma / scene.radius();
        let surface = Surface {
            vertices,
            pose: posed.pose,
            matches,
            residual_px,
            reprojection_px,
            photometric: None,
            depth_uncertainty,
            agreement,
            places,
            way,
        };
        let last = self.last.as_ref().filter(|l| way == Way::Followed && l.frame + 1 == self.count);
        let before = last.map(|l| l.vertices.as_slice());
        let (status, reasons) = judge(rest, &surface, before, &self.options.verdict);
        Ok(Candidate { status, reasons, surface, look })
    }

    fn joined(
        &self,
        usable: &Mask,
        picture: &Picture,
        scene: &Scene,
        (start, depth_sigma): (&[Point3], f64),
        kept: &[Match],
    ) -> Vec<Point3> {
        let photo = Photograph {
            camera: self.camera,
            picture,
            usable,
            light: &self.light,
            albedo: self.albedo,
            expected_log_gain: (!self.template.views.is_empty()).then_some(0.0),
        };
        join(scene, start, depth_sigma, kept, &photo, &self.options.reconstruct.joint).vertices
    }

    /// Remember a surface that holds.
    fn settle(
        &mut self,
        outcome: Result<Candidate, String>,
        stages: Vec<(&'static str, f64)>,
    ) -> Tracked {
        let lost = |reasons| (TrackStatus::Lost, reasons, None);
        let (status, reasons, surface) = match outcome {
            Err(reason) => lost(vec![reason]),
            Ok(c) if c.status == TrackStatus::Lost => lost(c.reasons),
            Ok(c) => {
                let before = self
                    .last
                    .as_ref()
                    .filter(|l| l.frame + 1 == self.count && c.surface.way == Way::Followed);
                let motion =
                    before.and_then(|l| align_rigid_robust(&l.vertices, &c.surface.vertices));
                self.last = Some(Last {
                    frame: self.count,
                    vertices: c.surface.vertices.clone(),
                    look: c.look,
                    motion: motion.unwrap_or_else(Isometry::identity),
                });
                (c.status, c.reasons, Some(c.surface))
            }
        };
        Tracked { status, reasons, surface, stages }
    }
}

/// Followed matches are few px off where they are wrong, so that the annealing need not start further
/// than what the rigid pose leaves of nine in ten of them.
fn narrowed(options: &RegisterOptions, posed: &Posed) -> RegisterOptions {
    let mut left = posed.residuals_px.clone();
    left.sort_unstable_by(f64::total_cmp);
    let most = left.get(left.len() * 9 / 10).copied().unwrap_or(f64::INFINITY);
    let [coarse, fine] = options.robust_px;
    let start = (2.0 * most).min(coarse).max(fine);
    RegisterOptions { robust_px: [start, fine], ..options.clone() }
}
