//! The state between frames, and one frame's way through find, follow and verdict.

use super::baseline::BaselineResidual;
use super::busy_wait::busy_wait;
use super::exposed::{Exposed, Shown};
use super::judged::Candidate;
use super::look::{Anchor, Look, Working};
use super::mips::Mips;
use super::prepare::{Preparation, Prepared, Regions, View};
use super::{Origin, TrackError, TrackOptions, TrackStatus, Tracked};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, Vector2, align_rigid_robust, median, point_at};
use crate::image::flow::{correlation, follow, settle, whole};
use crate::image::{Frame, ToneCurve};
use crate::light::Coated;
use crate::mesh::laplacian::Laplacian;
use crate::pipeline::Method;
use crate::refine::VideoMemory;
use crate::register::find::{Search, agreeing};
use crate::register::{Deformable, Match, RegisterMemory};
use crate::template::{Exposure, Template};
use crate::verdict::{Reason, Thresholds};
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// A followed place moves like its neighbours within this and a third of their motion, px of the
/// working image.
const STRAY_PX: f64 = 1.5;

/// Where a place was last is another start than where it is expected, px of the working image.
const APART_PX: f64 = 4.0;

/// Follows a template through the frames of one camera.
///
/// ```
/// use dsfms::pipeline::template_from_posed_frames;
/// use dsfms::{Exploration, LengthUnit, Method, Silent, TemplateOptions, TrackOptions, Tracker};
/// use dsfms::{image::ToneCurve, synth::Case};
///
/// let case = Case::example(1);
/// let (frames, poses) = case.explore(2);
/// let poses: Vec<_> = poses.into_iter().map(Some).collect();
/// let exploration = Exploration::new(&frames, &case.camera);
/// let (mesh, unit) = (case.template.mesh.clone(), LengthUnit::Millimetre);
/// let options = TemplateOptions::default();
/// let template =
///     template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent)?.template;
///
/// let (tone, options) = (ToneCurve::Srgb, TrackOptions::default());
/// let mut tracker = Tracker::new(&template, &case.camera, &tone, Method::Dsfm, options)?;
/// let tracked = tracker.next(&case.frame, None)?;
/// println!("{:?}: {:?}", tracked.status, tracked.reasons);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[doc(alias("visual tracking", "video"))]
pub struct Tracker<'a> {
    pub(super) template: &'a Template,
    pub(super) albedo: Mips,
    pub(super) search: Search<'a>,
    pub(super) light: Coated,
    pub(super) camera: &'a CameraModel,
    pub(super) method: Method,
    pub(super) options: TrackOptions,
    pub(super) working: Working,
    /// Of the rest shape.
    pub(super) laplacian: Laplacian,
    pub(super) deformable: Deformable,
    pub(super) memory: Memory,
    preparation: Preparation,
    pub(super) last: Option<Last>,
    pub(super) usual: BaselineResidual,
    exposed: Exposed,
    /// See [`other_camera`]; of the last search by descriptors.
    pub(super) other_camera: Option<(f64, [f64; 2])>,
    /// Frames given.
    pub(super) count: usize,
    /// Frame of the last search by descriptors beside a degraded surface.
    pub(super) searched: Option<usize>,
    /// How much rarer such searches have become, since they found nothing better.
    pub(super) rarer: usize,
}

/// What outlives a frame, for speed alone.
#[derive(Default)]
pub(super) struct Memory {
    pub(super) register: RegisterMemory,
    pub(super) video: VideoMemory,
}

/// The last surface that was not lost.
pub(super) struct Last {
    pub(super) frame: usize,
    pub(super) vertices: Vec<Point3>,
    /// `camera_from_template` of its matches.
    pub(super) pose: Isometry,
    pub(super) ambient: f64,
    pub(super) look: Arc<Look>,
    /// Where the next frame may show it.
    pub(super) ahead: Vec<Point3>,
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
    pub(super) shown: Shown,
    /// The matches moved on from the last shape by more than the blur of its solve.
    pub(super) jumped: bool,
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
        options.validate()?;
        if !matches!(method, Method::Dsfm | Method::Joint) {
            return Err(TrackError::Method(method));
        }
        let features = template.features.as_ref().ok_or(TrackError::NoDescriptors)?;
        let blurs = options.reconstruct.joint.blurs.iter();
        let finest = blurs.copied().fold(options.video.blur, f64::min);
        let working = Working::of(camera, finest, options.video.least_blur_px);
        let preparation = Preparation::new(camera, tone, &working, options.awake);
        Ok(Self {
            template,
            albedo: Mips::new(template.albedo.as_ref().ok_or(TrackError::NoAlbedo)?),
            search: Search::new(&template.mesh, features),
            light: template.lighting(),
            camera,
            method,
            options,
            working,
            laplacian: Laplacian::new(&template.mesh),
            deformable: Deformable::of(&template.mesh),
            memory: Memory::default(),
            preparation,
            last: None,
            usual: BaselineResidual::default(),
            exposed: Exposed::default(),
            other_camera: None,
            count: 0,
            searched: None,
            rarer: 1,
        })
    }

    /// Prepares this tracker's frames; may live on another thread. It counts frames by itself: take
    /// one, and give it every frame that [`solve`](Self::solve) gets.
    pub fn preparation(&self) -> Preparation {
        self.preparation.clone()
    }

    /// The next frame; of the masks that of the instruments, or more (see [`Regions`]).
    ///
    /// # Errors
    /// A frame or mask of another size than the camera's. Anything else that goes wrong makes the
    /// frame lost.
    pub fn next<'m>(
        &mut self,
        frame: &Frame,
        regions: impl Into<Regions<'m>>,
    ) -> Result<Tracked, TrackError> {
        let prepared = self.preparation.prepare(frame.clone(), regions)?;
        Ok(self.solve(&prepared))
    }

    /// The next frame, prepared by [`preparation`](Self::preparation).
    pub fn solve(&mut self, prepared: &Prepared) -> Tracked {
        let start = Instant::now();
        let mut tracked = if self.options.awake {
            busy_wait(|| self.solve_here(prepared))
        } else {
            // On a thread of the pool its many small parallel loops cost no hand-over.
            rayon::scope(|_| self.solve_here(prepared))
        };
        let named: f64 = tracked.stages.iter().map(|s| s.1).sum();
        let all = prepared.seconds + start.elapsed().as_secs_f64();
        tracked.stages.push(("other", all - named));
        tracing::debug!(
            frame = %prepared.frame.name,
            status = tracked.status.label(),
            reasons = ?tracked.reasons,
            stages = ?tracked.stages,
            "tracked"
        );
        tracked
    }

    fn solve_here(&mut self, prepared: &Prepared) -> Tracked {
        self.count += 1;
        let mut clock = Clock(vec![("prepare", prepared.seconds)]);
        let Some(view) = &prepared.view else {
            let brightest = prepared.brightest;
            let reasons = vec![Reason::Black { brightest }];
            return Tracked { status: TrackStatus::Lost, reasons, surface: None, stages: clock.0 };
        };
        let outcome = self.attempts(&prepared.frame, view, &mut clock);
        self.settle(outcome, clock.0)
    }

    /// Where this frame may show the last shape.
    pub(super) fn expected<'b>(&self, last: &'b Last) -> &'b [Point3] {
        if last.frame + 1 == self.count { &last.ahead } else { &last.vertices }
    }

    /// Matches of the last shape's anchors, carried on by its motion and then by their look.
    pub(super) fn followed(&self, view: &View) -> Vec<Match> {
        let Some(last) = &self.last else { return Vec::new() };
        let (faces, start) = (&self.template.mesh.topology.faces, self.expected(last));
        let (render, frame) = (&last.look.render, &view.seen.pyramid);
        let one = |a: &Anchor| -> Option<(f64, (Match, Vector2))> {
            let corners = faces[a.face as usize].map(|v| &start[v as usize]);
            let start = self.working.camera.project(&point_at(corners, a.barycentric))?.pixel;
            let alike = |place: Point2| -> Option<(Point2, f64)> {
                whole(&view.seen.usable, place).then_some(())?;
                let alike = correlation(&render.levels[0], a.pixel, &frame.levels[0], place)?;
                (alike >= self.options.correlation).then_some((place, alike))
            };
            // Mostly the last motion can be extrapolated; only where it does not must coarser levels tell.
            let (place, alike) =
                settle(render, frame, a.pixel, start).and_then(alike).or_else(|| {
                    let elsewhere = (start - a.pixel).norm() > APART_PX;
                    let place = follow(render, frame, a.pixel, start);
                    let still = || follow(render, frame, a.pixel, a.pixel);
                    place.or_else(|| elsewhere.then(still).flatten()).and_then(alike)
                })?;
            let pixel = self.working.to_frame(place);
            let found = Match { face: a.face, barycentric: a.barycentric, pixel };
            Some((1.0 - alike, (found, place - a.pixel)))
        };
        let found: Vec<_> = last.look.anchors.par_iter().map(one).collect();
        let matches = alike_enough(found.into_iter().flatten().collect());
        let (matches, offsets): (Vec<Match>, Vec<Option<Vector2>>) =
            matches.into_iter().map(|(m, offset)| (m, Some(offset))).unzip();
        // Neighbours move alike, so that a patch which settled on another texture stands out.
        let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
        let agreeing = agreeing(&pixels, &offsets, f64::INFINITY, STRAY_PX);
        agreeing.into_iter().map(|i| matches[i]).collect()
    }

    /// What is known of the exposure of this frame.
    pub(super) fn expected_exposure(&self) -> Option<Exposure> {
        self.exposed.expected(self.template.exposure())
    }

    pub(super) fn limits(&self) -> &Thresholds {
        &self.options.reconstruct.verdict
    }

    /// Remember a surface that holds.
    fn settle(
        &mut self,
        outcome: Result<Candidate, String>,
        stages: Vec<(&'static str, f64)>,
    ) -> Tracked {
        let lost = |reasons| (TrackStatus::Lost, reasons, None);
        let (status, reasons, surface) = match outcome {
            Err(why) => lost(vec![Reason::NoSurface { why }]),
            Ok(c) if c.verdict.level == TrackStatus::Lost => lost(c.verdict.reasons),
            Ok(c) => {
                if let (TrackStatus::Ok, Some(residual)) = (c.verdict.level, c.surface.photometric)
                {
                    self.usual.add(residual);
                }
                self.exposed.add(&c.shown);
                let before = self
                    .last
                    .as_ref()
                    .filter(|l| l.frame + 1 == self.count && c.surface.origin == Origin::Followed);
                let vertices = c.surface.vertices.clone();
                let ahead = before.and_then(|l| ahead(&l.vertices, &vertices));
                self.last = Some(Last {
                    frame: self.count,
                    ahead: ahead.unwrap_or_else(|| vertices.clone()),
                    vertices,
                    pose: c.surface.pose,
                    ambient: c.ambient,
                    look: c.look,
                });
                (c.verdict.level, c.verdict.reasons, Some(c.surface))
            }
        };
        Tracked { status, reasons, surface, stages }
    }
}

/// Part of the change of shape that is extrapolated.
const GOES_ON: f64 = 0.7;

/// A shape moved and bent on as since the one before.
fn ahead(before: &[Point3], now: &[Point3]) -> Option<Vec<Point3>> {
    let motion = align_rigid_robust(before, now)?;
    let on = |(before, now): (&Point3, &Point3)| {
        motion * now + motion.rotation * (now - motion * before) * GOES_ON
    };
    Some(before.iter().zip(now).map(on).collect())
}

/// What is not much less alike than most.
fn alike_enough<T>(found: Vec<(f64, T)>) -> Vec<T> {
    let mut unlike: Vec<f64> = found.iter().map(|f| f.0).collect();
    let limit = 2.0 * median(&mut unlike).unwrap_or(0.0);
    found.into_iter().filter(|f| f.0 <= limit).map(|f| f.1).collect()
}
