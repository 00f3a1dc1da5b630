//! `dsfms track`: a video of the deforming organ, frame after frame.

use super::reconstruct::method_name;
use crate::args::Global;
use crate::draw;
use crate::exit::{Outcome, Usage};
use crate::formats::{Format, Formats, Shape};
use crate::inputs;
use crate::outputs::{self, quoted};
use crate::progress::Reporter;
use crate::report::track::TrackReport;
use anyhow::Context;
use clap::{Args, ValueEnum};
use dsfms::camera::CameraModel;
use dsfms::image::{Frame, ToneCurve};
use dsfms::io::images::{find_frames, read_frame};
use dsfms::io::masks::MaskKind;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::io::template::read_template;
use dsfms::pipeline::{Method, Progress};
use dsfms::register::scene::visibility;
use dsfms::template::Template;
use dsfms::track::shapes::ShapeFile;
use dsfms::track::{TrackOptions, TrackStatus, Tracked, Tracker, Way};
use dsfms::video::{each_frame, is_video};
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const EXAMPLES: &str = "\
Examples:
  # A video, motion only
  dsfms track organ.template clip.mp4 --camera camera.json -o out
  # Motion and shading, pictures of every frame
  dsfms track organ.template frames/ --camera camera.json --method joint --overlay -o out
  # A live source: raw RGB frames in, one line of JSON a frame out
  capture | dsfms track organ.template - --size 1280x720 --camera camera.json -o out

Every frame ends ok, degraded (a surface with reservations, in the column reasons) or lost (no
surface).

Written to OUT: vertices.npz (vertices: frames x vertices x 3 in camera axes, NaN where lost; status: 0
ok, 1 degraded, 2 lost); summary.csv; report.html, one page with plots and up to 96 frames in 3D, written
anew every few seconds, so that `dsfms view OUT` shows a running video; with --ply frame_NNN.ply; with --formats frame_NNN.vtp, .obj, .stl, and frames.glb, an
animation at 25 frames a second; with --overlay overlay/frame_NNN.png
and, where ffmpeg is installed, overlay.mp4. NNN is the place in the sequence.";

/// Follow the template through a video.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct TrackArgs {
    /// Template folder.
    #[arg(value_name = "TEMPLATE")]
    template: PathBuf,
    /// A video, image files, folders of them, or - for raw RGB frames on standard input.
    #[arg(required = true, value_name = "VIDEO")]
    input: Vec<PathBuf>,
    /// Intrinsics of these frames; default the template's own camera.
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// What to do.
    #[arg(long, value_enum, default_value_t = TrackMethod::Dsfm)]
    method: TrackMethod,
    /// Masks of the instruments, white = instrument.
    #[arg(long, value_name = "DIR")]
    instrument_masks: Option<PathBuf>,
    /// Take every so-manieth frame.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    stride: u32,
    /// Write the last good surface for lost frames too; their status stays lost.
    #[arg(long)]
    keep_lost: bool,
    /// Size of the frames on standard input, px.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[usize; 2]>,
    /// A PLY for every frame.
    #[arg(long)]
    ply: bool,
    /// A picture of every frame with the surface, and a video of them where ffmpeg is installed.
    #[arg(long)]
    overlay: bool,
    /// Further files, for other programs.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "FORMATS")]
    formats: Vec<Format>,
    /// Leave out OUT/report.html.
    #[arg(long)]
    no_report: bool,
    /// Thresholds and weights, as TOML.
    #[arg(long, value_name = "FILE")]
    options: Option<PathBuf>,
    /// Folder for the results.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum TrackMethod {
    /// Motion (eq. 3).
    Dsfm,
    /// Motion, prior and shading in one problem; several times slower.
    Joint,
}

/// `1280x720`.
pub fn size(text: &str) -> Result<[usize; 2], String> {
    let parts: Option<Vec<usize>> = text.split('x').map(|n| n.parse().ok()).collect();
    match parts.as_deref() {
        Some(&[w, h]) if (1..65536).contains(&w) && (1..65536).contains(&h) => Ok([w, h]),
        _ => Err("expected WIDTHxHEIGHT, for example 1280x720".into()),
    }
}

/// Run the command.
pub fn run(args: &TrackArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let live = args.input == [PathBuf::from("-")];
    if live && args.size.is_none() {
        return Err(Usage("frames on standard input need --size WxH".into()).into());
    }
    if let Some(masks) = &args.instrument_masks {
        inputs::must_exist(masks, "--instrument-masks")?;
    }
    outputs::prepare_folder(&args.output)?;
    let template = read_template(&args.template)?;
    let (camera, tone) = camera(args, global, &template)?;
    let mut options = match &args.options {
        Some(path) => inputs::options(path, TrackOptions::from_toml)?,
        None => TrackOptions::default(),
    };
    options.reconstruct.seed = global.seed;
    let method = match args.method {
        TrackMethod::Dsfm => Method::Dsfm,
        TrackMethod::Joint => Method::Joint,
    };
    let tracker = Tracker::new(&template, &camera, &tone, method, options)?;
    let path = args.output.join("vertices.npz");
    let shapes = ShapeFile::create(&path, template.mesh.positions.len())?;
    let name = args.template.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let page = args.output.join("report.html");
    let report = TrackReport::new(page, name, &template, &camera, method_name(method))?;
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
        summary: COLUMNS.to_owned(),
        last: None,
        seen: 0,
        counts: [0; 3],
    };
    if live {
        job.live()?
    } else {
        job.files()?
    }
    job.conclude()
}

/// Frames a second of the animation and the overlay.
const RATE: f64 = 25.0;

const COLUMNS: &str = "frame,input,status,way,reasons,matches,matches_kept,residual_px,depth,agreement,\
                       places,ms,prepare_ms,follow_ms,find_ms,pose_ms,register_ms,joint_ms,look_ms,\
                       agree_ms\n";

/// Stages in the order of the columns.
const STAGES: [&str; 8] =
    ["prepare", "follow", "find", "pose", "register", "joint", "look", "agree"];

fn camera(
    args: &TrackArgs,
    global: &Global,
    template: &Template,
) -> anyhow::Result<(CameraModel, ToneCurve)> {
    if let Some(path) = &args.camera {
        let input = inputs::camera(path, global)?;
        return Ok((input.file.camera, input.tone));
    }
    let camera = template.camera.clone();
    let camera =
        camera.context("the template holds no camera; give the frames' camera with --camera")?;
    Ok((camera, global.tone.map_or(template.tone.clone(), Into::into)))
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
    kept: Vec<(String, f64, Vec<dsfms::geometry::Point3>)>,
    live: bool,
    summary: String,
    /// Last surface, for `--keep-lost`.
    last: Option<Vec<dsfms::geometry::Point3>>,
    /// Frames read, of which every `stride`th is taken.
    seen: usize,
    counts: [usize; 3],
}

/// A line of a live run.
#[derive(Serialize)]
struct Line<'a> {
    frame: usize,
    status: TrackStatus,
    reasons: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    pose: Option<[[f64; 4]; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    residual_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    agreement: Option<f64>,
    ms: f64,
}

impl<'a> Job<'a> {
    fn files(&mut self) -> anyhow::Result<()> {
        for input in &self.args.input {
            if input.is_file() && is_video(input) {
                let mut failed = None;
                each_frame(input, &mut |frame, total| {
                    if failed.is_none() {
                        failed = self.offer(&frame, None, total).err();
                    }
                })?;
                failed.map_or(Ok(()), Err)?;
            } else {
                let paths = find_frames(std::slice::from_ref(input))?;
                for path in &paths {
                    let frame = read_frame(path)?;
                    self.offer(&frame, Some(path), Some(paths.len()))?;
                }
            }
        }
        Ok(())
    }

    fn live(&mut self) -> anyhow::Result<()> {
        let [w, h] = self.args.size.unwrap_or_default();
        let mut input = std::io::stdin().lock();
        let mut bytes = vec![0; 3 * w * h];
        let mut frame = Frame { name: String::new(), size: [w, h], rgb: Vec::new() };
        loop {
            let mut filled = 0;
            while filled < bytes.len() {
                match input.read(&mut bytes[filled..]).context("standard input")? {
                    0 if filled == 0 => return Ok(()),
                    0 => anyhow::bail!(
                        "standard input ends within a frame: {filled} of {} bytes; check --size",
                        bytes.len()
                    ),
                    n => filled += n,
                }
            }
            frame.name = format!("frame_{:03}", self.seen);
            frame.rgb.clear();
            frame.rgb.extend_from_slice(bytes.as_chunks::<3>().0);
            self.offer(&frame, None, None)?;
        }
    }

    /// A frame, if it is one of those that are taken.
    fn offer(
        &mut self,
        frame: &Frame,
        path: Option<&Path>,
        total: Option<usize>,
    ) -> anyhow::Result<()> {
        let number = self.seen;
        self.seen += 1;
        self.reporter.step("frames", self.seen, total.unwrap_or(self.seen));
        if !number.is_multiple_of(self.args.stride as usize) {
            return Ok(());
        }
        let masks = self.args.instrument_masks.as_ref();
        let read =
            |p: &PathBuf| inputs::mask_of(frame, path, p, MaskKind::Instrument, self.reporter);
        let instrument = masks.map(read).transpose()?;
        let start = std::time::Instant::now();
        let tracked = self.tracker.next(frame, instrument.as_ref())?;
        self.keep(number, frame, &tracked, 1e3 * start.elapsed().as_secs_f64())
    }

    /// Everything that one frame leaves.
    fn keep(
        &mut self,
        number: usize,
        frame: &Frame,
        tracked: &Tracked,
        ms: f64,
    ) -> anyhow::Result<()> {
        self.counts[tracked.status as usize] += 1;
        self.row(number, frame, tracked, ms);
        if let Some(report) = &mut self.report {
            report.add(number, frame, tracked, ms)?;
        }
        let surface = tracked.surface.as_ref();
        if let Some(surface) = surface {
            self.last = Some(surface.vertices.clone());
        }
        let kept = if self.args.keep_lost { self.last.as_deref() } else { None };
        let shape = surface.map(|s| s.vertices.as_slice()).or(kept);
        self.shapes.push(shape, tracked.status as u8)?;
        let name = format!("frame_{number:03}");
        if let Some(shape) = shape.filter(|_| self.args.ply) {
            let comments = [format!("camera axes of the frame; status {}", tracked.status.label())];
            let extras = PlyExtras { comments: &comments, ..Default::default() };
            let path = self.args.output.join(format!("{name}.ply"));
            write_ply(&path, &self.template.mesh.topology, shape, self.template.unit, &extras)?;
        }
        if let Some(vertices) = shape.filter(|_| !self.args.formats.is_empty()) {
            let seconds = number as f64 / RATE;
            let formats = self.formats();
            formats.write_frame(&name, seconds, &Shape { vertices, ..Default::default() })?;
            let vertices = if formats.animated() { vertices.to_vec() } else { Vec::new() };
            self.kept.push((name.clone(), seconds, vertices));
        }
        if self.args.overlay {
            let path = self.args.output.join("overlay").join(format!("{name}.png"));
            outputs::write_png(&path, &self.picture(frame, tracked))?;
        }
        if self.live {
            let matrix = surface.map(|s| s.pose.to_homogeneous());
            let line = Line {
                frame: number,
                status: tracked.status,
                reasons: &tracked.reasons,
                pose: matrix.map(|m| std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))),
                residual_px: surface.map(|s| s.residual_px),
                agreement: surface.map(|s| s.agreement),
                ms,
            };
            super::to_stdout(&(serde_json::to_string(&line)? + "\n"))?;
        }
        Ok(())
    }

    fn formats(&self) -> Formats<'a> {
        let Self { args, template, .. } = self;
        Formats { folder: &args.output, template, list: &args.formats }
    }

    fn row(&mut self, number: usize, frame: &Frame, tracked: &Tracked, ms: f64) {
        let (status, reasons) = (tracked.status.label(), quoted(&tracked.reasons.join("; ")));
        let name = quoted(&frame.name);
        // Writing to a string cannot fail.
        let _ = match &tracked.surface {
            Some(s) => {
                let way = if s.way == Way::Found { "found" } else { "followed" };
                let kept = s.matches_kept();
                let total = s.matches.len();
                write!(
                    self.summary,
                    "{number},{name},{status},{way},{reasons},{total},{kept},{:.3},{:.3},{:.3},{},{ms:.1}",
                    s.residual_px, s.depth_uncertainty, s.agreement, s.places
                )
            }
            None => write!(self.summary, "{number},{name},{status},,{reasons},,,,,,,{ms:.1}"),
        };
        for stage in STAGES {
            let seconds: f64 =
                tracked.stages.iter().filter(|s| s.0 == stage).fold(0.0, |sum, s| sum + s.1);
            let _ = write!(self.summary, ",{:.1}", 1e3 * seconds);
        }
        self.summary.push('\n');
    }

    /// The frame with the surface, under a bar of the status' colour.
    fn picture(&self, frame: &Frame, tracked: &Tracked) -> image::RgbImage {
        let mut picture = match &tracked.surface {
            Some(s) => {
                let mesh = &self.template.mesh;
                let visible = visibility(self.camera, mesh, &s.vertices);
                let topology = &mesh.topology;
                draw::overlay(frame, self.camera, topology, &s.vertices, &visible, &s.matches)
            }
            None => draw::picture(frame),
        };
        let colour = match tracked.status {
            TrackStatus::Ok => [40, 200, 90],
            TrackStatus::Degraded => [240, 180, 30],
            TrackStatus::Lost => [220, 40, 40],
        };
        let bar = (picture.height() / 60).max(2);
        for y in 0..bar.min(picture.height()) {
            for x in 0..picture.width() {
                picture.put_pixel(x, y, image::Rgb(colour));
            }
        }
        picture
    }

    fn conclude(self) -> anyhow::Result<Outcome> {
        self.reporter.finish();
        let total: usize = self.counts.iter().sum();
        anyhow::ensure!(total > 0, "the input holds no frame");
        self.formats().write_series(&self.kept)?;
        self.shapes.finish()?;
        outputs::write_text(&self.args.output.join("summary.csv"), &self.summary)?;
        self.report.map_or(Ok(()), TrackReport::finish)?;
        if self.args.overlay && !film(&self.args.output, self.args.stride) {
            self.reporter.warn("overlay.mp4 needs ffmpeg; the pictures are in OUT/overlay");
        }
        let [ok, degraded, lost] = self.counts;
        self.reporter.say(&format!("{ok} frame(s) ok, {degraded} degraded, {lost} lost"));
        Ok(match () {
            () if ok == total => Outcome::Ok,
            () if lost == total => Outcome::Nothing,
            () => Outcome::Degraded,
        })
    }
}

/// `OUT/overlay.mp4` of the pictures; whether it was made.
fn film(folder: &Path, stride: u32) -> bool {
    let rate = (RATE / f64::from(stride)).to_string();
    let status = Command::new("ffmpeg")
        .args(["-y", "-v", "error", "-nostdin", "-framerate", &rate, "-pattern_type", "glob", "-i"])
        .arg(folder.join("overlay/frame_*.png"))
        .args(["-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p"])
        .arg(folder.join("overlay.mp4"))
        .stdin(Stdio::null())
        .status();
    status.is_ok_and(|s| s.success())
}
