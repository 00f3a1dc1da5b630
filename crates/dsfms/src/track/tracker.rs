//! The state between frames, and one frame's way through find, follow and verdict.

use super::beside::Beside;
use super::busy_wait::busy_wait;
use super::candidate::{Candidate, Last};
use super::clock::Clock;
use super::exposed::{Exposed, Shown};
use super::look::Working;
use super::mips::Mips;
use super::parts::Seeker;
use super::places::FollowedPlace;
use super::prepare::{Preparation, Prepared, Regions, View};
use super::recent::UsualResidual;
use super::search_times::SearchTimes;
use super::surroundings::{ShownFrame, SurroundingsTracker};
use super::{Origin, Surface, TrackError, TrackOptions, TrackStatus, Tracked};
use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point3, align_rigid_few};
use crate::image::{Frame, ToneCurve};
use crate::io::camera::CameraFile;
use crate::light::Coated;
use crate::mesh::laplacian::Laplacian;
use crate::pipeline::inputs::CameraInput;
use crate::pipeline::{CameraSight, Method};
use crate::refine::VideoMemory;
use crate::register::find::Search;
use crate::register::{Deformable, Match, RegisterMemory};
use crate::template::{Exposure, Template};
use crate::verdict::{NoSurface, Reason, Thresholds};
use std::time::Instant;

/// Follows a template through the frames of one camera.
/// [`of_camera`](Self::of_camera) takes everything that a camera file says.
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
    /// What descriptors found, and is followed.
    pub(super) places: Vec<FollowedPlace>,
    pub(super) seeker: Seeker,
    /// Parts of the picture that are sought in the next frame.
    pub(super) next_parts: Vec<usize>,
    surroundings: Option<SurroundingsTracker<'a>>,
    /// The camera of this frame, where they show it.
    pub(super) camera_sight: Option<CameraSight>,
    /// Photometric residuals of the last good frames: the measure for smoke, blur and glare.
    pub(super) usual: UsualResidual,
    pub(super) exposed: Exposed,
    /// Who searches on another thread.
    pub(super) beside: Option<Beside>,
    /// What it found was taken in this frame.
    pub(super) answered: bool,
    /// See [`other_camera`]; of the last search by descriptors.
    pub(super) other_camera: Option<(f64, [f64; 2])>,
    /// Frames given.
    pub(super) count: usize,
    pub(super) search_times: SearchTimes,
}

/// What outlives a frame, for speed alone.
#[derive(Default)]
pub(super) struct Memory {
    pub(super) register: RegisterMemory,
    pub(super) video: VideoMemory,
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
        // A brief search does not read shading at the blurs of single frames.
        let single = if options.brief_search { &[][..] } else { &options.reconstruct.joint.blurs };
        let finest = single.iter().copied().fold(options.video.blur, f64::min);
        let working = Working::of(camera, finest, options.video.least_blur_px);
        let preparation = Preparation::new(camera, tone, &working, options.awake);
        Self::of(template, camera, method, options, working, preparation)
    }

    /// A tracker of the frames of a camera file: its tone curve, its light where the template knows
    /// none, and its own vignetting, as [`CameraInput::observation`] has them.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of_camera(
        template: &'a Template,
        input: &'a CameraInput,
        method: Method,
        options: TrackOptions,
    ) -> Result<Self, TrackError> {
        let CameraFile { camera, light, vignetting, .. } = &input.file;
        let tracker = Self::new(template, camera, &input.tone, method, options)?;
        Ok(Self { light: template.lighting_of(light.as_ref(), *vignetting), ..tracker })
    }

    /// Another tracker of the same, which has seen nothing.
    pub(super) fn twin(&self) -> Self {
        let (options, working) = (self.options.clone(), self.working.clone());
        let preparation = self.preparation.clone();
        let of = Self::of(self.template, self.camera, self.method, options, working, preparation);
        // What it searches are frames far apart.
        let light = self.light.clone();
        Self { surroundings: None, light, ..of.expect("the template was enough for this one") }
    }

    fn of(
        template: &'a Template,
        camera: &'a CameraModel,
        method: Method,
        options: TrackOptions,
        working: Working,
        preparation: Preparation,
    ) -> Result<Self, TrackError> {
        let features = template.features.as_ref().ok_or(TrackError::NoDescriptors)?;
        let search = Search::new(&template.mesh, features);
        Ok(Self {
            template,
            albedo: Mips::new(template.albedo.as_ref().ok_or(TrackError::NoAlbedo)?),
            seeker: Seeker::new(search.places(), working.camera.size),
            surroundings: SurroundingsTracker::of(template, &working)
                .filter(|_| options.surroundings),
            camera_sight: None,
            search,
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
            places: Vec::new(),
            next_parts: Vec::new(),
            usual: UsualResidual::default(),
            exposed: Exposed::default(),
            beside: None,
            answered: false,
            other_camera: None,
            count: 0,
            search_times: SearchTimes::default(),
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
        let pool = self.beside.as_ref().and_then(Beside::pool);
        let mut tracked = match pool {
            Some(pool) => pool.install(|| self.solve_on_pool(prepared)),
            None => self.solve_on_pool(prepared),
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

    fn solve_on_pool(&mut self, prepared: &Prepared) -> Tracked {
        if self.options.awake {
            busy_wait(|| self.solve_here(prepared))
        } else {
            // On a thread of the pool its many small parallel loops cost no hand-over.
            rayon::scope(|_| self.solve_here(prepared))
        }
    }

    /// [`solve`](Self::solve) as in an earlier run: `answered` is [`Tracked::answered`] of this
    /// frame there. Where it is `true`, what the [`searcher`](Self::searcher) finds is waited for.
    pub fn solve_again(&mut self, prepared: &Prepared, answered: bool) -> Tracked {
        if let Some(beside) = &mut self.beside {
            beside.as_before = Some(answered);
        }
        self.solve(prepared)
    }

    fn solve_here(&mut self, prepared: &Prepared) -> Tracked {
        self.count += 1;
        self.answered = false;
        let mut clock = Clock(vec![("prepare", prepared.seconds)]);
        let Some(view) = &prepared.view else {
            let brightest = prepared.brightest;
            let reasons = vec![Reason::Black { brightest }];
            let (status, answered) = (TrackStatus::Lost, false);
            let (surface, camera) = (None, None);
            return Tracked { status, reasons, surface, camera, answered, stages: clock.0 };
        };
        self.camera_sight =
            clock.time("surroundings", || self.surroundings_followed(&prepared.frame, view));
        let sought = self.next_sought(&prepared.frame, view);
        // The features of parts need no surface, and what does leaves other threads idle for a
        // while.
        let (outcome, sought) =
            rayon::join(|| self.attempts(&prepared.frame, view, &mut clock), sought);
        let (status, reasons, surface) = self.settle(outcome, view);
        if let Some(surface) = surface.as_ref().filter(|s| s.origin == Origin::Followed) {
            clock.time("seek", || self.seek(&sought, view, surface));
        }
        clock.time("surroundings", || {
            self.seek_surroundings(&prepared.frame, view, surface.as_ref());
        });
        let (camera, answered) = (self.camera_sight, self.answered);
        Tracked { status, reasons, surface, camera, answered, stages: clock.0 }
    }

    /// The camera as the surroundings show it.
    fn surroundings_followed(&mut self, frame: &Frame, view: &View) -> Option<CameraSight> {
        let Self { working, camera, options, count, .. } = self;
        let shown = ShownFrame { frame, seen: view.around(), working, camera, number: *count };
        let register = &options.reconstruct.register;
        self.surroundings.as_mut()?.followed(&shown, options.correlation, register)
    }

    /// Places of the surroundings, sought where the camera has them: the one that they show, or
    /// else that of the organ.
    fn seek_surroundings(&mut self, frame: &Frame, view: &View, surface: Option<&Surface>) {
        let Self { working, camera, count, .. } = self;
        let shown = ShownFrame { frame, seen: view.around(), working, camera, number: *count };
        let pose = self.camera_sight.map(|sight| sight.pose).or(surface.map(|s| s.pose));
        let organ = surface.map_or(&[][..], |s| &s.vertices);
        if let (Some(surroundings), Some(pose)) = (&mut self.surroundings, pose) {
            surroundings.seek(&shown, pose, organ);
        }
    }

    /// Where this frame may show the last shape.
    pub(super) fn expected<'b>(&self, last: &'b Last) -> &'b [Point3] {
        if last.frame + 1 == self.count { &last.ahead } else { &last.vertices }
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
        outcome: Result<Candidate, NoSurface>,
        view: &View,
    ) -> (TrackStatus, Vec<Reason>, Option<Surface>) {
        let lost = |reasons| (TrackStatus::Lost, reasons, None);
        let c = match outcome {
            Err(why) => return lost(vec![Reason::NoSurface { why }]),
            Ok(c) if c.verdict.level == TrackStatus::Lost => return lost(c.verdict.reasons),
            Ok(c) => c,
        };
        if let (TrackStatus::Ok, Some(residual)) = (c.verdict.level, c.surface.photometric) {
            self.usual.add(residual);
        }
        self.exposed.add(&c.shown);
        let followed = c.surface.origin == Origin::Followed;
        self.remember_places(c.places, followed);
        let before = self.last.take().filter(|l| l.frame + 1 == self.count && followed);
        let vertices = c.surface.vertices.clone();
        let ahead = before.as_ref().and_then(|l| ahead(&l.vertices, &vertices));
        let earlier = before.map(|l| l.earlier).filter(|e| self.still_earlier(e, &vertices));
        self.last = Some(Last {
            frame: self.count,
            ahead: ahead.unwrap_or_else(|| vertices.clone()),
            earlier: earlier.unwrap_or_else(|| self.as_earlier(view, &vertices)),
            vertices,
            pose: c.surface.pose,
            ambient: c.ambient,
            look: c.look,
        });
        (c.verdict.level, c.verdict.reasons, Some(c.surface))
    }
}

/// Part of the change of shape that is extrapolated.
const GOES_ON: f64 = 0.7;

/// A shape moved and bent on as since the one before.
fn ahead(before: &[Point3], now: &[Point3]) -> Option<Vec<Point3>> {
    let motion = align_rigid_few(before, now)?;
    let on = |(before, now): (&Point3, &Point3)| {
        motion * now + motion.rotation * (now - motion * before) * GOES_ON
    };
    Some(before.iter().zip(now).map(on).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::LightModel;
    use crate::pipeline::{Exploration, Silent, TemplateOptions, template_from_posed_frames};
    use crate::synth::Case;
    use crate::template::LengthUnit;

    /// As `pipeline::inputs` has them for single frames.
    #[test]
    fn a_camera_file_says_what_the_template_does_not_know() {
        let case = Case::example(1);
        let (frames, poses) = case.explore(2);
        let poses: Vec<_> = poses.into_iter().map(Some).collect();
        let (mesh, unit) = (case.template.mesh.clone(), LengthUnit::Millimetre);
        let (seen, options) = (Exploration::new(&frames, &case.camera), TemplateOptions::default());
        let built = template_from_posed_frames(&seen, mesh, unit, &poses, &options, &Silent);
        let known = built.unwrap().template;
        let unknown = Template { light: None, ..known.clone() };
        let (light, vignetting) = (Some(LightModel::Collinear), Some(-0.2));
        let file = CameraFile { camera: case.camera.clone(), tone: None, light, vignetting };
        let input = CameraInput::new(file, None);
        for (template, light) in [(&known, &known.light), (&unknown, &input.file.light)] {
            let tracker =
                Tracker::of_camera(template, &input, Method::Dsfm, TrackOptions::default());
            let tracker = tracker.unwrap();
            assert_eq!(Some(&tracker.light.light), light.as_ref());
            assert_eq!(tracker.light.coat.vignetting, -0.2);
            assert_eq!(tracker.twin().light, tracker.light);
        }
    }
}
