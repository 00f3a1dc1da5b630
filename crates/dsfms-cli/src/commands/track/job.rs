//! The frames of a run, one after the other, and everything that they leave.

use super::again::Plan;
use super::args::TrackArgs;
use super::input::is_address;
use super::item::{Content, FrameItem, Ready};
use super::link::Link;
use super::live::{ToldFrame, tell};
use super::outputs;
use super::record::Recording;
use super::run_file::{RunFile, Taken};
use super::source::Reading;
use crate::exit::Outcome;
use crate::formats::{Formats, Shape};
use crate::interrupt;
use crate::outputs::{FrameMasks, write_json, write_png, write_text};
use crate::poses::ImagePose;
use crate::progress::Reporter;
use crate::report::track::{RunEntry, TrackReport};
use crate::structures::Structures;
use crate::volume::CarriedVolume;
use dsfms::camera::CameraModel;
use dsfms::expected_error::ExpectedErrors;
use dsfms::geometry::Point3;
use dsfms::image::Frame;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::pipeline::Progress;
use dsfms::template::Template;
use dsfms::track::shapes::ShapeFile;
use dsfms::track::{Prepared, Surface, TrackStatus, Tracked, Tracker};
use image::RgbImage;
use std::path::PathBuf;
use std::time::{Instant, SystemTime};

/// What the frames share.
pub struct TrackJob<'a> {
    pub args: &'a TrackArgs,
    pub template: &'a Template,
    pub camera: &'a CameraModel,
    pub reporter: &'a Reporter,
    pub tracker: Tracker<'a>,
    pub shapes: ShapeFile,
    pub report: Option<TrackReport<'a>>,
    /// Name, seconds and shape of every frame that has one, where a format needs them.
    pub kept: Vec<(String, f64, Vec<Point3>)>,
    pub live: bool,
    /// Frames a second.
    pub rate: f64,
    pub summary: String,
    /// Last good surface, for `--keep-lost`.
    pub last: Option<Vec<Point3>>,
    /// Pictures written.
    pub overlays: Vec<PathBuf>,
    pub dropped: usize,
    pub counts: [usize; 3],
    pub structures: Option<Structures>,
    pub volume: Option<CarriedVolume>,
    /// Programs that are told while it runs.
    pub link: Option<Link>,
    pub recording: Option<Recording>,
    /// The camera of every frame in which what lies around the organ shows it.
    pub poses: Vec<ImagePose>,
    /// What is kept for `dsfms replay`.
    pub run: RunFile,
}

/// A frame that was taken.
enum TakenFrame {
    Whole(Box<Prepared>),
    /// Black, in the place of one that could not be read.
    Unread(Frame),
}

impl TakenFrame {
    fn frame(&self) -> &Frame {
        match self {
            Self::Whole(prepared) => &prepared.frame,
            Self::Unread(frame) => frame,
        }
    }
}

/// A frame's way through the tracker.
struct FrameDone<'t> {
    number: usize,
    /// When it was made, or came.
    time: SystemTime,
    came: Instant,
    tracked: &'t Tracked,
    masks: &'t FrameMasks,
    dropped: usize,
    ms: f64,
}

impl<'a> TrackJob<'a> {
    /// Every frame of the input, or of it what an earlier run took. Whatever ends it, what was done
    /// by then is written.
    pub fn finish(mut self, reading: Reading, mut plan: Option<Plan>) -> anyhow::Result<Outcome> {
        let ended = self.all(reading, &mut plan);
        self.conclude(ended)
    }

    fn all(&mut self, mut reading: Reading, plan: &mut Option<Plan>) -> anyhow::Result<()> {
        while !interrupt::asked() {
            let next = reading.next()?;
            let ended = next.is_none();
            let items = match (plan.as_mut(), next) {
                (None, None) => Vec::new(),
                (None, Some(next)) => vec![next],
                (Some(plan), None) => plan.rest().into_iter().map(|item| (item, 0)).collect(),
                (Some(plan), Some((item, _))) => {
                    plan.of(item).into_iter().map(|item| (item, 0)).collect()
                }
            };
            items.into_iter().try_for_each(|(item, dropped)| self.take(item, dropped))?;
            if ended || plan.as_ref().is_some_and(|plan| plan.0.is_empty()) {
                break;
            }
        }
        Ok(())
    }

    /// The next frame of the input.
    fn take(&mut self, item: FrameItem, dropped: usize) -> anyhow::Result<()> {
        let FrameItem { number, time, came, total, warnings, content } = item;
        self.reporter.step("frames", number + 1, total.unwrap_or(number + 1));
        warnings.iter().for_each(|w| self.reporter.warn(w));
        self.dropped += dropped;
        let start = Instant::now();
        let mut taken = Taken { number, unread: None, reserved: None, answered: false };
        let (taken_frame, tracked, masks) = match content {
            Content::Frame(ready) => {
                let Ready { prepared, masks, reservation, answered } = *ready;
                taken.reserved.clone_from(&reservation);
                let mut tracked = match answered {
                    Some(answered) => self.tracker.solve_again(&prepared, answered),
                    None => self.tracker.solve(&prepared),
                };
                taken.answered = tracked.answered;
                reservation.into_iter().for_each(|why| tracked.reserve(why));
                (TakenFrame::Whole(Box::new(prepared)), tracked, masks)
            }
            Content::Unreadable(name, reason) => {
                self.reporter.warn(&format!("{name} is lost: {reason}"));
                taken.unread = Some(reason.clone());
                let size = self.camera.size;
                let frame = Frame { name, size, rgb: vec![[0; 3]; size[0] * size[1]] };
                (TakenFrame::Unread(frame), Tracked::unread(reason), FrameMasks::default())
            }
        };
        let ms = 1e3 * start.elapsed().as_secs_f64();
        self.run.frames.push(taken);
        let tracked = &tracked;
        self.keep(
            &taken_frame,
            &FrameDone { number, time, came, tracked, masks: &masks, dropped, ms },
        )
    }

    /// Everything that one frame leaves.
    fn keep(&mut self, taken_frame: &TakenFrame, done: &FrameDone) -> anyhow::Result<()> {
        let &FrameDone { number, time, tracked, masks, dropped, ms, .. } = done;
        let frame = taken_frame.frame();
        self.counts[tracked.status as usize] += 1;
        self.summary += &outputs::row(number, &frame.name, tracked, dropped, ms);
        if let Some(camera) = &tracked.camera {
            self.poses.push(ImagePose::of(frame.name.clone(), &camera.pose));
        }
        if let (TrackStatus::Ok, Some(surface)) = (tracked.status, &tracked.surface) {
            self.last = Some(surface.vertices.clone());
        }
        let kept = self.last.clone().filter(|_| self.args.keep_lost);
        let surface = tracked.surface.as_ref();
        let shape = surface.map(|s| s.vertices.as_slice()).or(kept.as_deref());
        if self.live {
            let vertices = self.args.live_vertices.then_some(shape);
            tell(&ToldFrame { number, tracked, dropped, ms, vertices }, &mut std::io::stdout())?;
        }
        if let Some(link) = &self.link {
            let told = ToldFrame { number, tracked, dropped, ms, vertices: None };
            link.send(&told, frame, time, shape, self.reporter)?;
        }
        // Of a shape that is only kept nothing is known to be seen.
        let visible = surface.map_or(&[][..], |s| s.visible.as_slice());
        self.shapes.push(shape, visible, tracked.status as u8)?;
        let expected = self.expected_errors(taken_frame, surface);
        let errors = expected.as_ref().map(|e| e.errors.as_slice());
        self.show(taken_frame, done, errors)?;
        if let Some(shape) = shape {
            let shape = Shape {
                vertices: shape,
                visible: surface.map(|s| s.visible.as_slice()),
                expected_error: errors,
                observed: expected.as_ref().map(|e| e.observed.as_slice()),
                regions: surface.map(|s| s.regions.as_slice()),
            };
            self.write_shape(number, tracked.status, &shape)?;
        }
        if let (Some(volume), Some(surface)) = (&self.volume, surface) {
            let surface = (surface.vertices.as_slice(), self.template.unit);
            let name = format!("frame_{number:03}");
            volume.write(&self.args.output, &name, surface, self.reporter)?;
        }
        if self.args.overlay {
            let path = self.args.output.join(format!("overlay/frame_{number:03}.png"));
            let mut picture = outputs::picture(self.template, self.camera, frame, tracked);
            masks.outline(&mut picture);
            self.draw_structures(&mut picture, tracked, errors)?;
            write_png(&path, &picture)?;
            self.overlays.push(path);
        }
        Ok(())
    }

    /// Whether frames come when they are made, and wait for nobody.
    fn arrives(&self) -> bool {
        let args = self.args;
        self.live
            || args.realtime
            || args.device.is_some()
            || args.input.iter().any(|i| is_address(i))
    }

    /// How far the surface may be off, where somebody watches it or reads its file: it takes its
    /// time.
    fn expected_errors(
        &self,
        taken_frame: &TakenFrame,
        surface: Option<&Surface>,
    ) -> Option<ExpectedErrors> {
        let args = self.args;
        let files = args.ply || !args.formats.is_empty();
        let read = args.view || files || self.structures.is_some();
        match taken_frame {
            TakenFrame::Whole(prepared) if read => self.tracker.expected_errors(prepared, surface?),
            _ => None,
        }
    }

    /// The frame on the page.
    fn show(
        &mut self,
        taken_frame: &TakenFrame,
        done: &FrameDone,
        expected: Option<&[f64]>,
    ) -> anyhow::Result<()> {
        let &FrameDone { number, came, tracked, ms, .. } = done;
        let answer_ms = self.arrives().then(|| 1e3 * came.elapsed().as_secs_f64());
        let frame = taken_frame.frame();
        self.report.as_mut().map_or(Ok(()), |report| {
            report.add(&RunEntry { number, frame, tracked, ms, answer_ms, expected })
        })
    }

    /// The hidden structures where the surface carries them.
    fn draw_structures(
        &self,
        picture: &mut RgbImage,
        tracked: &Tracked,
        expected: Option<&[f64]>,
    ) -> anyhow::Result<()> {
        if let (Some(structures), Some(surface)) = (&self.structures, &tracked.surface) {
            let places = structures.carry(&surface.vertices, expected)?;
            structures.draw(picture, self.camera, &surface.vertices, &places);
        }
        Ok(())
    }

    /// The files of a shape that were asked for.
    fn write_shape(
        &mut self,
        number: usize,
        status: TrackStatus,
        shape: &Shape,
    ) -> anyhow::Result<()> {
        let name = format!("frame_{number:03}");
        if self.args.ply {
            let comments = [format!("camera axes of the frame; status {}", status.label())];
            let extras = PlyExtras {
                comments: &comments,
                visible: shape.visible,
                expected_error: shape.expected_error,
                observed: shape.observed,
                region: shape.regions,
                ..Default::default()
            };
            let path = self.args.output.join(format!("{name}.ply"));
            let (topology, unit) = (&self.template.mesh.topology, self.template.unit);
            write_ply(&path, topology, shape.vertices, unit, &extras)?;
            if let Some(structures) = &self.structures {
                let places = structures.carry(shape.vertices, shape.expected_error)?;
                structures.write(&self.args.output, &name, self.template, &places)?;
            }
        }
        if !self.args.formats.is_empty() {
            let seconds = number as f64 / self.rate;
            let formats = self.formats();
            formats.write_frame(&name, seconds, shape)?;
            let vertices = if formats.animated() { shape.vertices.to_vec() } else { Vec::new() };
            self.kept.push((name, seconds, vertices));
        }
        Ok(())
    }

    fn formats(&self) -> Formats<'a> {
        let Self { args, template, .. } = self;
        Formats { folder: &args.output, template, list: &args.formats }
    }

    fn conclude(mut self, ended: anyhow::Result<()>) -> anyhow::Result<Outcome> {
        self.reporter.finish();
        if let Some(link) = self.link.take() {
            link.finish(self.reporter);
        }
        match self.recording.take().map(Recording::finish) {
            Some(Ok([written, left_out])) => {
                let text = format!("{written} frame(s) recorded, {left_out} left out to keep up");
                self.reporter.say(&text);
            }
            Some(Err(error)) => self.reporter.error(&crate::exit::describe(&error)),
            None => {}
        }
        let total: usize = self.counts.iter().sum();
        if interrupt::asked() {
            let out = self.args.output.display();
            self.reporter
                .error(&format!("stopped; the {total} frame(s) so far are whole in {out}"));
        }
        if total == 0 {
            ended?;
            anyhow::bail!("the input holds no frame");
        }
        if let Err(error) = &ended {
            let why = crate::exit::describe(error);
            self.reporter.error(&format!("{why}; the {total} frame(s) before are written"));
        }
        self.formats().write_series(&self.kept)?;
        self.shapes.finish()?;
        write_text(&self.args.output.join("summary.csv"), &self.summary)?;
        if !self.poses.is_empty() {
            write_json(&self.args.output.join("camera_poses.json"), &self.poses)?;
        }
        self.run.write(&self.args.output)?;
        self.report.map_or(Ok(()), TrackReport::finish)?;
        if self.args.overlay {
            let rate = self.rate / f64::from(self.args.stride);
            if let Err(why) = outputs::film(&self.args.output, &self.overlays, rate) {
                self.reporter.warn(&format!("overlay.mp4 {why}; the pictures are in OUT/overlay"));
            }
        }
        let [ok, degraded, lost] = self.counts;
        let dropped = match self.dropped {
            0 => String::new(),
            n => format!(", {n} dropped to keep up"),
        };
        self.reporter.say(&format!("{ok} frame(s) ok, {degraded} degraded, {lost} lost{dropped}"));
        Ok(match () {
            () if ok == total && ended.is_ok() => Outcome::Ok,
            () if lost == total => Outcome::Nothing,
            () => Outcome::Degraded,
        })
    }
}
