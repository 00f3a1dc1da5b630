//! `dsfms track`: a video of the deforming organ, frame after frame.

mod args;
mod capture;
mod incoming;
mod link;
mod live;
mod outputs;
mod queue;
mod record;
mod source;

use super::reconstruct::method_name;
use crate::args::Global;
use crate::exit::Outcome;
use crate::formats::{Formats, Shape};
use crate::inputs;
use crate::interrupt;
use crate::outputs::{write_png, write_text};
use crate::place;
use crate::progress::Reporter;
use crate::report::track::TrackReport;
use crate::structures::Structures;
pub use args::{TrackArgs, size};
use args::{TrackMethod, check};
use dsfms::camera::CameraModel;
use dsfms::geometry::Point3;
use dsfms::image::Frame;
use dsfms::io::masks::MaskKind;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::io::template::read_template;
use dsfms::pipeline::{Method, Progress};
use dsfms::register::Prior;
use dsfms::template::Template;
use dsfms::track::shapes::ShapeFile;
use dsfms::track::{TrackOptions, TrackStatus, Tracked, Tracker};
use image::RgbImage;
use incoming::Stream;
use link::Link;
use live::{Told, tell};
use record::{Recorder, Recording};
use source::{Content, Item, MaskFiles, Source};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Run the command.
pub fn run(args: &TrackArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let live = args.input == [PathBuf::from("-")];
    check(args, live)?;
    place::check(&args.output, &places(args))?;
    let mut template = read_template(&args.template)?;
    let (camera, tone) = inputs::frame_camera(args.camera.as_deref(), global, &mut template)?;
    if !live {
        let sources = inputs::look(&args.input)?;
        let file = args.camera.as_deref().unwrap_or(&args.template);
        inputs::check_sizes(&sources, &camera, file)?;
        let masks = [&args.instrument_masks, &args.organ_masks, &args.masks].map(|m| m.as_deref());
        let kinds = [MaskKind::Instrument, MaskKind::Organ, MaskKind::Valid];
        for (masks, kind) in masks.into_iter().zip(kinds) {
            inputs::check_masks(&sources, masks, kind)?;
        }
    }
    let base = if args.realtime { TrackOptions::realtime() } else { TrackOptions::default() };
    let mut options = match &args.options {
        Some(path) => inputs::options(path, |text| base.with_toml(text))?,
        None => base,
    };
    options.reconstruct.seed = global.seed;
    if let Some(prior) = args.prior.map(Prior::from) {
        let solves = &mut options.reconstruct;
        (solves.register.prior.kind, solves.joint.prior.kind) = (prior, prior);
    }
    let method = match args.method {
        TrackMethod::Dsfm => Method::Dsfm,
        TrackMethod::Joint => Method::Joint,
    };
    let tracker = Tracker::new(&template, &camera, &tone, method, options)?;
    let structures = Structures::read(&args.structures, &template, reporter)?;
    place::renew(&args.output, "track")?;
    let path = args.output.join("vertices.npz");
    let shapes = ShapeFile::create(&path, template.mesh.positions.len())?;
    let name = args.template.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let page = args.output.join("report.html");
    let report = TrackReport::new(page, name, &template, &camera, method_name(method))?;
    let link = Link::open(&args.link, &template, &camera, reporter)?;
    let record = |folder: &PathBuf| Recording::start(folder, args.realtime);
    let recording = args.record.as_ref().map(record).transpose()?;
    let source = source(args, live, recording.as_ref().map(Recording::recorder))?;
    let rate = args.rate.or_else(|| source.rate()).unwrap_or(RATE);
    let mut job = Job {
        args,
        report: (!args.no_report).then_some(report),
        kept: Vec::new(),
        template: &template,
        camera: &camera,
        reporter,
        tracker,
        shapes,
        live,
        rate,
        summary: outputs::COLUMNS.to_owned(),
        last: None,
        overlays: Vec::new(),
        dropped: 0,
        counts: [0; 3],
        structures,
        link,
        recording,
    };
    let reading = source.start(rate, job.tracker.preparation());
    interrupt::end_softly();
    let ended = loop {
        if interrupt::asked() {
            break Ok(());
        }
        match reading.next() {
            Ok(Some((item, dropped))) => {
                if let Err(error) = job.take(item, dropped) {
                    break Err(error);
                }
            }
            Ok(None) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    job.conclude(ended)
}

/// Folders and files of the input, apart from which results lie.
fn places(args: &TrackArgs) -> Vec<&Path> {
    let masks = args.masks().map(|(path, _)| path);
    let files = args.input.iter().filter(|input| !incoming::is_address(input));
    files.chain([&args.template]).chain(masks).map(PathBuf::as_path).collect()
}

/// Frames a second where nothing says so.
const RATE: f64 = 25.0;

fn source(args: &TrackArgs, live: bool, recorder: Option<Recorder>) -> anyhow::Result<Source> {
    let stream = Stream::of(args)?;
    let files = !live && stream.is_none();
    Ok(Source {
        inputs: if files { args.input.clone() } else { Vec::new() },
        stream,
        recorder,
        format: args.input_format,
        size: args.size.unwrap_or_default(),
        masks: MaskFiles {
            instrument: args.instrument_masks.clone(),
            organ: args.organ_masks.clone(),
            valid: args.masks.clone(),
        },
        stride: args.stride as usize,
        realtime: args.realtime,
    })
}

/// What the frames share.
struct Job<'a> {
    args: &'a TrackArgs,
    template: &'a Template,
    camera: &'a CameraModel,
    reporter: &'a Reporter,
    tracker: Tracker<'a>,
    shapes: ShapeFile,
    report: Option<TrackReport<'a>>,
    /// Name, seconds and shape of every frame that has one, where a format needs them.
    kept: Vec<(String, f64, Vec<Point3>)>,
    live: bool,
    /// Frames a second.
    rate: f64,
    summary: String,
    /// Last good surface, for `--keep-lost`.
    last: Option<Vec<Point3>>,
    /// Pictures written.
    overlays: Vec<PathBuf>,
    dropped: usize,
    counts: [usize; 3],
    structures: Option<Structures>,
    /// Programs that are told while it runs.
    link: Option<Link>,
    recording: Option<Recording>,
}

/// A frame's way through the tracker.
struct Done<'t> {
    number: usize,
    /// When it came.
    time: SystemTime,
    tracked: &'t Tracked,
    dropped: usize,
    ms: f64,
}

impl<'a> Job<'a> {
    /// The next frame of the input.
    fn take(&mut self, item: Item, dropped: usize) -> anyhow::Result<()> {
        let Item { number, time, total, warnings, content } = item;
        self.reporter.step("frames", number + 1, total.unwrap_or(number + 1));
        warnings.iter().for_each(|w| self.reporter.warn(w));
        self.dropped += dropped;
        let start = std::time::Instant::now();
        let (frame, tracked) = match content {
            Content::Frame(prepared, reservation) => {
                let mut tracked = self.tracker.solve(&prepared);
                reservation.into_iter().for_each(|why| tracked.reserve(why));
                (prepared.frame, tracked)
            }
            Content::Unreadable(name, reason) => {
                self.reporter.warn(&format!("{name} is lost: {reason}"));
                let size = self.camera.size;
                let frame = Frame { name, size, rgb: vec![[0; 3]; size[0] * size[1]] };
                (frame, Tracked::unread(reason))
            }
        };
        let ms = 1e3 * start.elapsed().as_secs_f64();
        self.keep(&frame, &Done { number, time, tracked: &tracked, dropped, ms })
    }

    /// Everything that one frame leaves.
    fn keep(&mut self, frame: &Frame, done: &Done) -> anyhow::Result<()> {
        let &Done { number, time, tracked, dropped, ms } = done;
        self.counts[tracked.status as usize] += 1;
        self.summary += &outputs::row(number, &frame.name, tracked, dropped, ms);
        if let (TrackStatus::Ok, Some(surface)) = (tracked.status, &tracked.surface) {
            self.last = Some(surface.vertices.clone());
        }
        let kept = self.last.clone().filter(|_| self.args.keep_lost);
        let surface = tracked.surface.as_ref();
        let shape = surface.map(|s| s.vertices.as_slice()).or(kept.as_deref());
        if self.live {
            let vertices = self.args.live_vertices.then_some(shape);
            tell(&Told { number, tracked, dropped, ms, vertices }, &mut std::io::stdout())?;
        }
        if let Some(link) = &self.link {
            let told = Told { number, tracked, dropped, ms, vertices: None };
            link.send(&told, frame, time, shape, self.reporter)?;
        }
        // Of a shape that is only kept nothing is known to be seen.
        let visible = surface.map_or(&[][..], |s| s.visible.as_slice());
        self.shapes.push(shape, visible, tracked.status as u8)?;
        if let Some(report) = &mut self.report {
            report.add(number, frame, tracked, ms)?;
        }
        if let Some(shape) = shape {
            let shape = Shape {
                vertices: shape,
                visible: surface.map(|s| s.visible.as_slice()),
                regions: surface.map(|s| s.regions.as_slice()),
                ..Default::default()
            };
            self.write_shape(number, tracked.status, &shape)?;
        }
        if self.args.overlay {
            let path = self.args.output.join(format!("overlay/frame_{number:03}.png"));
            let mut picture = outputs::picture(self.template, self.camera, frame, tracked);
            self.draw_structures(&mut picture, tracked)?;
            write_png(&path, &picture)?;
            self.overlays.push(path);
        }
        Ok(())
    }

    /// The hidden structures where the surface carries them.
    fn draw_structures(&self, picture: &mut RgbImage, tracked: &Tracked) -> anyhow::Result<()> {
        if let (Some(structures), Some(surface)) = (&self.structures, &tracked.surface) {
            let places = structures.carry(&surface.vertices, None)?;
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
            let (visible, region) = (shape.visible, shape.regions);
            let extras = PlyExtras { comments: &comments, visible, region, ..Default::default() };
            let path = self.args.output.join(format!("{name}.ply"));
            let (topology, unit) = (&self.template.mesh.topology, self.template.unit);
            write_ply(&path, topology, shape.vertices, unit, &extras)?;
            if let Some(structures) = &self.structures {
                let places = structures.carry(shape.vertices, None)?;
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

    /// Whatever ended the run, what was done by then is written.
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
