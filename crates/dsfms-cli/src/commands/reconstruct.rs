//! `dsfms reconstruct`: frames of the deformed organ to surfaces.

mod args;
mod beside;
mod job;
mod page;

use crate::args::Global;
use crate::exit::{self, Outcome, Usage};
use crate::formats::{Formats, Shape};
use crate::inputs::{self, Source};
use crate::interrupt;
use crate::outputs::{self, FrameFiles, FrameMasks, FrameReport};
use crate::place;
use crate::progress::Reporter;
use crate::report::clip;
use crate::report::data::ShownFrame;
use crate::report::template::{MOST_FRAMES, chosen};
use crate::structures::{Placed, Structures};
use crate::volume::CarriedVolume;
pub use args::{MethodName, ReconstructArgs};
use beside::each_beside;
use dsfms::camera::CameraModel;
use dsfms::geometry::Point3;
use dsfms::image::{Frame, Mask, diagonal};
use dsfms::io::masks::MaskKind;
use dsfms::io::matches::{all_matches, find_matches, read_matches};
use dsfms::io::template::read_template;
use dsfms::pipeline::{
    Method, Observation, Progress, ReconstructError, ReconstructOptions, Reconstruction,
    reconstruct_with,
};
use dsfms::register::{Deformable, Match};
use dsfms::template::Template;
use dsfms::verdict::intrinsics::apart_px;
use dsfms::verdict::{Reason, Thresholds};
use job::Job;
use page::{Paged, failed_frame};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// What one frame leaves for the end.
struct Done {
    report: FrameReport,
    page: Option<ShownFrame>,
    /// Where a format needs it.
    shape: Option<Vec<Point3>>,
}

/// Of frames of which only matches are known.
const GREY: u8 = 128;

/// Run the command.
pub fn run(
    args: &ReconstructArgs,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<Outcome> {
    place::check(&args.output, &places(args))?;
    let mut job = prepare(args, global, reporter)?;
    let sources = job.sources()?;
    let inputs: Vec<String> = sources.iter().map(Source::name).collect();
    let names = outputs::output_names(&inputs);
    place::renew(&args.output, "reconstruct")?;
    let done = AtomicUsize::new(0);
    let shown = if args.no_report { Vec::new() } else { chosen(sources.len()) };
    let beside = !args.no_report && sources.len() > MOST_FRAMES;
    reporter.step("frames", 0, sources.len());
    interrupt::end_softly();
    let done_frames = each_beside(&sources, |i, source| {
        let page = Paged { holds: shown.contains(&i), beside };
        let report = job.frame(source, &names[i], i, page);
        reporter.step("frames", done.fetch_add(1, Ordering::Relaxed) + 1, sources.len());
        report
    });
    let (mut rows, mut frames, mut shapes) = (Vec::new(), Vec::new(), Vec::new());
    let mut failure = None;
    for (i, done) in done_frames {
        let name = names[i].clone();
        let done = match done {
            Ok(done) => done,
            // Its files could not be written; those of the others are not to be lost with it.
            Err(error) => {
                failure.get_or_insert(error);
                continue;
            }
        };
        shapes.extend(done.shape.map(|s| (name.clone(), i as f64, s)));
        frames.extend(done.page);
        rows.push((name, done.report));
    }
    job.formats().write_series(&shapes)?;
    outputs::write_text(&args.output.join("summary.csv"), &outputs::summary_csv(&rows))?;
    if !args.no_report {
        job.write_page(&rows, frames)?;
    }
    reporter.finish();
    failure.map_or(Ok(()), Err)?;
    if interrupt::asked() {
        let (done, all, out) = (rows.len(), sources.len(), args.output.display());
        reporter.error(&format!(
            "stopped; {done} of {all} frames are whole in {out}; give the others, with another -o, to go on"
        ));
    }
    Ok(conclude(&rows, reporter))
}

/// A file of matches is of one frame, and right for others only where nothing moved.
fn one_frame_each(args: &ReconstructArgs, frames: usize, reporter: &Reporter) {
    if let Some(path) = args.matches.as_ref().filter(|path| path.is_file() && frames > 1) {
        let path = path.display();
        reporter.warn(&format!(
            "--matches {path} is taken for all of {frames} frames; a folder holds a CSV for each, of the frame's name or number"
        ));
    }
}

/// Folders and files of the input, apart from which results lie.
fn places(args: &ReconstructArgs) -> Vec<&Path> {
    let optional = [&args.matches, &args.frames.instrument_masks, &args.frames.organ_masks];
    let optional = optional.into_iter().flatten().chain(args.volume.places());
    args.images.iter().chain([&args.template]).chain(optional).map(PathBuf::as_path).collect()
}

fn prepare<'a>(
    args: &'a ReconstructArgs,
    global: &Global,
    reporter: &'a Reporter,
) -> anyhow::Result<Job<'a>> {
    let options = [
        (&args.matches, "--matches"),
        (&args.frames.instrument_masks, "--instrument-masks"),
        (&args.frames.organ_masks, "--organ-masks"),
    ];
    for (path, option) in options.iter().filter_map(|(p, o)| Some((p.as_ref()?, o))) {
        inputs::must_exist(path, option)?;
    }
    let template = read_template(&args.template)?;
    let camera = inputs::frame_camera(args.frames.camera.as_deref(), global, &template)?;
    if let Some(path) = &args.frames.camera {
        warn_of_camera(&template, &camera.file.camera, path, reporter);
    }
    let mut options = match &args.solve.options {
        Some(path) => inputs::options(path, ReconstructOptions::from_toml)?,
        None => ReconstructOptions::default(),
    };
    args.solve.settle(&mut options, global);
    options.literal |= args.literal;
    let method = method(args, &template, reporter);
    let structures = Structures::read(&args.frames.structures, &template, reporter)?;
    let volume = CarriedVolume::read(&args.volume, &template, reporter)?;
    let deformable = Deformable::of(&template.mesh);
    Ok(Job { args, structures, volume, template, deformable, camera, method, options, reporter })
}

/// The method asked for, or the best that the template allows.
fn method(args: &ReconstructArgs, template: &Template, reporter: &Reporter) -> Method {
    if let Some(name) = args.method {
        return name.into();
    }
    if template.albedo.is_none() {
        reporter.warn("the template holds no albedo: motion alone is solved (--method dsfm)");
    }
    Method::best_for(template)
}

impl Job<'_> {
    /// The frames, after a look at them and at their matches and masks.
    fn sources(&mut self) -> anyhow::Result<Vec<Source>> {
        let (args, reporter) = (self.args, self.reporter);
        let sources = match (args.images.is_empty(), &args.matches) {
            (true, Some(matches)) => self.without_images(matches)?,
            _ => inputs::sources(&args.images, inputs::Purpose::Reconstruct, reporter)?,
        };
        inputs::check_sizes(&sources, self.lens(), self.camera_file())?;
        let faces = self.template.mesh.topology.faces.len();
        inputs::check_matches(&sources, args.matches.as_deref(), faces, self.lens())?;
        let instrument = args.frames.instrument_masks.as_deref();
        inputs::check_masks(&sources, instrument, MaskKind::Instrument)?;
        inputs::check_masks(&sources, args.frames.organ_masks.as_deref(), MaskKind::Organ)?;
        one_frame_each(args, sources.len(), reporter);
        Ok(sources)
    }

    /// A plain grey frame for every match file; only methods that look at no image remain.
    fn without_images(&mut self, matches: &Path) -> anyhow::Result<Vec<Source>> {
        match (self.args.method, self.method) {
            (_, Method::Rigid | Method::Dsfm) => {}
            (None, _) => self.method = Method::Dsfm,
            (Some(_), method) => {
                let name = method.name();
                return Err(Usage(format!(
                    "--method {name} looks at images; give them, or --method dsfm or rigid, which need matches alone"
                ))
                .into());
            }
        }
        if self.args.frames.instrument_masks.is_some() || self.args.frames.organ_masks.is_some() {
            return Err(Usage("masks belong to images; give the images too".into()).into());
        }
        // There is no picture to compare it with.
        self.template.albedo = None;
        let size = self.lens().size;
        let grey = |path: PathBuf| {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            Source::Decoded(Frame { name, size, rgb: vec![[GREY; 3]; size[0] * size[1]] }, None)
        };
        Ok(all_matches(matches)?.into_iter().map(grey).collect())
    }

    fn lens(&self) -> &CameraModel {
        &self.camera.file.camera
    }

    /// Where the camera comes from.
    fn camera_file(&self) -> &Path {
        self.args.frames.camera.as_deref().unwrap_or(&self.args.template)
    }

    fn formats(&self) -> Formats<'_> {
        let Self { args, template, .. } = self;
        Formats { folder: &args.output, template, list: &args.formats }
    }

    /// One frame: its files are written whatever happens; an error means that they could not be.
    fn frame(&self, source: &Source, name: &str, i: usize, page: Paged) -> anyhow::Result<Done> {
        let input = source.name();
        let method = self.method;
        let files = FrameFiles { folder: &self.args.output, name };
        let (mut shown, mut shape) = (None, None);
        let report = match self.attempt(source) {
            Ok((frame, result, masks)) => {
                files.write_surface(&self.template, &frame, self.lens(), &result, &masks)?;
                let mut report = FrameReport::of(&input, method, self.template.unit, &result);
                if let Some(reason) = source.reservation() {
                    report.status = "degraded";
                    report.reasons.push(reason.into());
                    report.doubts.push(Reason::Input { why: reason.into() });
                }
                let places = self.carry_structures(name, &frame, &result)?;
                self.carry_volume(name, &result)?;
                if page.wants() {
                    shown = Some(self.shown(name, &frame, (&report, &result), &places)?);
                }
                self.formats().write_frame(
                    name,
                    i as f64,
                    &Shape {
                        vertices: &result.vertices,
                        visible: Some(&result.visible),
                        expected_error: result.expected_error.as_deref(),
                        observed: result.observed.as_deref(),
                        regions: Some(&result.regions),
                    },
                )?;
                shape = (!self.args.formats.is_empty()).then_some(result.vertices);
                report
            }
            Err(error) => {
                let unit = self.template.unit;
                let report = match error.downcast_ref::<ReconstructError>() {
                    Some(ReconstructError::Refused(found)) => {
                        FrameReport::of(&input, method, unit, found)
                    }
                    _ => FrameReport::failed(&input, method, unit, exit::advised(&error)),
                };
                if page.wants() {
                    shown = Some(failed_frame(name, source, &report)?);
                }
                report
            }
        };
        if let Some(shown) = shown.as_ref().filter(|_| page.beside) {
            clip::write(&self.args.output, shown)?;
        }
        files.write_report(&report)?;
        for reason in &report.reasons {
            let what = format!("{name} ({input}) {}: {reason}", report.status);
            match report.status {
                "failed" => self.reporter.error(&what),
                _ => self.reporter.warn(&what),
            }
        }
        Ok(Done { report, page: shown.filter(|_| page.holds), shape })
    }

    /// Places of the hidden structures; their files and picture.
    fn carry_structures(
        &self,
        name: &str,
        frame: &Frame,
        result: &Reconstruction,
    ) -> anyhow::Result<Vec<Placed>> {
        let Some(structures) = &self.structures else { return Ok(Vec::new()) };
        let places = structures.carry(&result.vertices, result.expected_error.as_deref())?;
        structures.write(&self.args.output, name, &self.template, &places)?;
        let picture = structures.overlay(frame, self.lens(), result, &places);
        outputs::write_png(&self.args.output.join(format!("{name}_structures.png")), &picture)?;
        Ok(places)
    }

    /// Files of the volume.
    fn carry_volume(&self, name: &str, result: &Reconstruction) -> anyhow::Result<()> {
        let Some(volume) = &self.volume else { return Ok(()) };
        let surface = (result.vertices.as_slice(), self.template.unit);
        volume.write(&self.args.output, name, surface, self.reporter)
    }

    fn attempt(&self, source: &Source) -> anyhow::Result<(Frame, Reconstruction, FrameMasks)> {
        let frame = source.frame()?;
        inputs::check_size(&frame, self.lens(), self.camera_file())?;
        let matches = self.matches(&frame)?;
        let mask = |option: &Option<PathBuf>, kind| -> anyhow::Result<Option<Mask>> {
            let read = |p: &PathBuf| inputs::mask_of(&frame, source.path(), p, kind, self.reporter);
            Ok(option.as_ref().map(read).transpose()?)
        };
        let instrument = mask(&self.args.frames.instrument_masks, MaskKind::Instrument)?;
        let organ = mask(&self.args.frames.organ_masks, MaskKind::Organ)?;
        let observation =
            self.camera.observation(&frame).instrument(instrument.as_ref()).organ(organ.as_ref());
        let observation = Observation { matches: matches.as_deref(), ..observation };
        let Self { template, deformable, options, .. } = self;
        let result = reconstruct_with(template, deformable, &observation, self.method, options)?;
        Ok((frame, result, FrameMasks { instrument, organ }))
    }

    fn matches(&self, frame: &Frame) -> anyhow::Result<Option<Vec<Match>>> {
        let faces = self.template.mesh.topology.faces.len();
        let read = |source: &Path| {
            let path = find_matches(source, &frame.name)?;
            read_matches(&path, faces, frame.size)
        };
        Ok(self.args.matches.as_deref().map(read).transpose()?)
    }
}

/// Say where the frames' camera is not the template's own.
fn warn_of_camera(template: &Template, given: &CameraModel, path: &Path, reporter: &Reporter) {
    let Some(own) = &template.camera else { return };
    let apart = apart_px(given, own);
    if apart > Thresholds::default().camera * diagonal(given.size) {
        reporter.warn(&format!(
            "{} is not the camera of the template: sightlines differ by up to {apart:.0} px; \
             leave --camera out if the frames are of the same camera",
            path.display()
        ));
    }
}

fn conclude(rows: &[(String, FrameReport)], reporter: &Reporter) -> Outcome {
    let count = |status: &str| rows.iter().filter(|(_, r)| r.status == status).count();
    let (ok, degraded, failed) = (count("ok"), count("degraded"), count("failed"));
    reporter.say(&format!("{ok} frame(s) ok, {degraded} degraded, {failed} failed"));
    match () {
        () if ok == rows.len() => Outcome::Ok,
        () if failed == rows.len() => Outcome::Nothing,
        () => Outcome::Degraded,
    }
}
