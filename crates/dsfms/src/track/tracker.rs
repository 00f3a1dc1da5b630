//! The state between frames, and one frame's way through find, follow and verdict.

use super::flow::{correlation, follow};
use super::look::{Anchor, Look, Working, whole};
use super::prepare::{Preparation, Prepared, View};
use super::verdict::judge;
use super::{Surface, TrackError, TrackOptions, TrackStatus, Tracked, Way};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point3, align_rigid_robust, point_at};
use crate::image::{Frame, Mask, ToneCurve};
use crate::light::Coated;
use crate::mesh::laplacian::Laplacian;
use crate::pipeline::Method;
use crate::refine::VideoMemory;
use crate::register::{Match, RegisterMemory, find};
use crate::template::{Features, SurfaceTexels, Template};
use rayon::prelude::*;
use std::time::Instant;

/// Follows a template through the frames of one camera.
pub struct Tracker<'a> {
    pub(super) template: &'a Template,
    pub(super) albedo: &'a SurfaceTexels,
    features: &'a Features,
    pub(super) light: Coated,
    pub(super) camera: &'a CameraModel,
    pub(super) options: TrackOptions,
    pub(super) working: Working,
    /// Of the rest shape.
    pub(super) laplacian: Laplacian,
    pub(super) memory: Memory,
    preparation: Preparation,
    pub(super) last: Option<Last>,
    /// Frames given.
    count: usize,
    /// Frame of the last search by descriptors beside a degraded surface.
    searched: Option<usize>,
}

/// What outlives a frame, for speed alone.
#[derive(Default)]
pub(super) struct Memory {
    pub(super) register: RegisterMemory,
    pub(super) video: VideoMemory,
}

/// The last surface that was not lost.
pub(super) struct Last {
    frame: usize,
    pub(super) vertices: Vec<Point3>,
    /// `camera_from_template` of its matches.
    pub(super) pose: Isometry,
    pub(super) ambient: f64,
    pub(super) look: Look,
    /// Rigid motion from the frame before it to it.
    pub(super) motion: Isometry,
}

/// A surface before anybody has looked at it.
pub(super) struct Draft {
    pub(super) vertices: Vec<Point3>,
    pub(super) pose: Isometry,
    pub(super) matches: Vec<(Match, bool)>,
    pub(super) residual_px: f64,
    pub(super) reprojection_px: f64,
    pub(super) depth_uncertainty: f64,
    pub(super) photometric: Option<f64>,
    pub(super) ambient: f64,
}

/// A surface with its judgement.
struct Candidate {
    status: TrackStatus,
    reasons: Vec<String>,
    surface: Surface,
    look: Look,
    ambient: f64,
}

/// Wall times.
pub(super) struct Clock(Vec<(&'static str, f64)>);

impl Clock {
    pub(super) fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
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
        let blurs = options.video.blurs.iter().chain(&options.reconstruct.joint.blurs);
        let working = Working::of(camera, blurs.copied().fold(f64::INFINITY, f64::min));
        let shading = method == Method::Joint;
        let preparation = Preparation::new(camera, tone, &working, shading);
        Ok(Self {
            template,
            albedo: template.albedo.as_ref().ok_or(TrackError::NoAlbedo)?,
            features: template.features.as_ref().ok_or(TrackError::NoDescriptors)?,
            light: template.lighting(),
            camera,
            options,
            working,
            laplacian: Laplacian::new(&template.mesh),
            memory: Memory::default(),
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
        let Some(view) = &prepared.view else {
            let brightest = prepared.brightest;
            let reasons = vec![format!("the frame is black (brightest pixel {brightest} of 255)")];
            return Tracked { status: TrackStatus::Lost, reasons, surface: None, stages: clock.0 };
        };
        let outcome = self.attempts(&prepared.frame, view, &mut clock);
        self.settle(outcome, clock.0)
    }

    /// Follow, and find where that is not good enough; the better of both.
    fn attempts(
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
                let draft = self.carried(view, matches, clock);
                draft.map(|draft| self.judged(view, draft, Way::Followed, clock))
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
            let usable = view.usable_in(frame);
            find(self.camera, &self.template.mesh, self.features, frame, &usable, options, seed)
        });
        let found = matches
            .map_err(|error| error.to_string())
            .and_then(|matches| self.anew(view, matches, clock))
            .map(|draft| self.judged(view, draft, Way::Found, clock));
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
        let one = |a: &Anchor| -> Option<Match> {
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

    /// Look at a surface and judge it.
    fn judged(&self, view: &View, draft: Draft, way: Way, clock: &mut Clock) -> Candidate {
        let rest = &self.template.mesh;
        let look =
            clock.time("look", || Look::new(&self.working, rest, &draft.vertices, self.albedo));
        let [agreeing, places] =
            clock.time("agree", || look.agreement(&view.seen, self.options.verdict.correlation));
        let ambient = draft.ambient;
        let surface = Surface {
            vertices: draft.vertices,
            pose: draft.pose,
            matches: draft.matches,
            residual_px: draft.residual_px,
            reprojection_px: draft.reprojection_px,
            photometric: draft.photometric,
            depth_uncertainty: draft.depth_uncertainty,
            agreement: agreeing as f64 / places.max(1) as f64,
            places,
            way,
        };
        let last = self.last.as_ref().filter(|l| way == Way::Followed && l.frame + 1 == self.count);
        let before = last.map(|l| l.vertices.as_slice());
        let (status, reasons) = judge(rest, &surface, before, &self.options.verdict);
        Candidate { status, reasons, surface, look, ambient }
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
                    pose: c.surface.pose,
                    ambient: c.ambient,
                    look: c.look,
                    motion: motion.unwrap_or_else(Isometry::identity),
                });
                (c.status, c.reasons, Some(c.surface))
            }
        };
        Tracked { status, reasons, surface, stages }
    }
}
