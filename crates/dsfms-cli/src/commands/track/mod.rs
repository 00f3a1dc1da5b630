//! `dsfms track`: a video of the deforming organ, frame after frame.

mod again;
mod args;
mod bare;
mod capture;
mod incoming;
mod input;
mod item;
mod job;
mod link;
mod live;
mod outputs;
mod queue;
mod record;
mod run_file;
mod source;

use super::view;
use crate::args::Global;
use crate::exit::Outcome;
use crate::inputs;
use crate::interrupt;
use crate::place;
use crate::progress::Reporter;
use crate::report::track::TrackReport;
use crate::stdout::to_stdout;
use crate::structures::Structures;
use crate::volume::CarriedVolume;
pub use again::Again;
use again::Plan;
use args::check;
pub use args::{TrackArgs, size};
use dsfms::camera::CameraModel;
use dsfms::io::masks::MaskKind;
use dsfms::pipeline::Method;
use dsfms::template::Template;
use dsfms::track::shapes::ShapeFile;
use dsfms::track::{Searcher, TrackOptions, Tracker};
use incoming::Stream;
use job::TrackJob;
use link::Link;
pub use record::number_of;
use record::{Recorder, Recording};
pub use run_file::{RunFile, Taken, digest, target};
use source::{FrameSource, MaskFiles};
use std::path::{Path, PathBuf};

/// Run the command.
pub fn run(args: &TrackArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    follow(args, global, reporter, None)
}

/// Run with the options and the frames of an earlier run.
pub fn track_again(
    args: &TrackArgs,
    global: &Global,
    reporter: &Reporter,
    again: &Again,
) -> anyhow::Result<()> {
    follow(args, global, reporter, Some(again)).map(drop)
}

fn follow(
    args: &TrackArgs,
    global: &Global,
    reporter: &Reporter,
    again: Option<&Again>,
) -> anyhow::Result<Outcome> {
    let live = args.input == [PathBuf::from("-")];
    check(args, live)?;
    place::check(&args.output, &places(args))?;
    let stream = Stream::of(args)?;
    let record = |folder: &PathBuf| Recording::start(folder, args.realtime);
    let recording = args.record.as_ref().map(record).transpose()?;
    let sources = if live { Vec::new() } else { inputs::look(&args.input)? };
    let (template, input) = known(args, global, reporter)?;
    let camera = &input.file.camera;
    check_files(args, &sources, camera)?;
    let run = run_file(args, global, again)?;
    let options = run.options.clone();
    let mut tracker = Tracker::of_camera(&template, &input, args.method.into(), options)?;
    let searcher = tracker.searcher();
    let structures = Structures::read(&args.frames.structures, &template, reporter)?;
    let volume = CarriedVolume::read(&args.volume, &template, reporter)?;
    let link = Link::open(&args.link, &template, camera, reporter)?;
    let mut source = source(args, live, stream, recording.as_ref().map(Recording::recorder));
    source.numbered = again.is_some_and(|again| again.recorded);
    let rate = args.rate.or_else(|| source.rate()).unwrap_or(RATE);
    interrupt::end_softly();
    // A source without a frame leaves nothing, and what an older run left stays.
    let reading = source.start(rate, tracker.preparation()).with_first();
    let reading = reading.map_err(|error| place::untouched(&args.output, error))?;
    place::renew(&args.output, "track")?;
    run.write(&args.output)?;
    let shapes = shape_file(&args.output, &template)?;
    let report = report(args, &template, camera)?;
    watch(args, live)?;
    let job = TrackJob {
        args,
        report,
        kept: Vec::new(),
        template: &template,
        camera,
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
        volume,
        link,
        recording,
        poses: Vec::new(),
        run,
    };
    beside(searcher, || job.finish(reading, again.map(|again| Plan(&again.run.frames))))
}

/// Work with somebody who searches on another thread; where that one panics, frames are searched as
/// they come.
fn beside<T>(searcher: Option<Searcher>, work: impl FnOnce() -> T) -> T {
    std::thread::scope(|scope| {
        let search = searcher.map(|searcher| scope.spawn(move || searcher.run()));
        let ended = work();
        search.map(|search| search.join().ok());
        ended
    })
}

/// The file that the surfaces of all frames go to.
fn shape_file(output: &Path, template: &Template) -> anyhow::Result<ShapeFile> {
    let vertices = template.mesh.positions.len();
    Ok(ShapeFile::create(&output.join("vertices.npz"), vertices)?)
}

/// What is written down of this run; of an earlier one its words and options.
fn run_file(args: &TrackArgs, global: &Global, again: Option<&Again>) -> anyhow::Result<RunFile> {
    match again {
        Some(again) => Ok(RunFile { frames: Vec::new(), ..again.run.clone() }),
        None => RunFile::of(args, &options(args, global)?),
    }
}

/// The page that grows with the frames; `None` where none is wanted.
fn report<'a>(
    args: &TrackArgs,
    template: &'a Template,
    camera: &'a CameraModel,
) -> anyhow::Result<Option<TrackReport<'a>>> {
    if args.no_report {
        return Ok(None);
    }
    let name = args.template.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let page = args.output.join("report.html");
    let method = Method::from(args.method).name();
    Ok(Some(TrackReport::new(page, name, template, camera, method)?))
}

/// The template, and the camera of the frames.
fn known(
    args: &TrackArgs,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<(Template, inputs::CameraInput)> {
    let template = bare::template(args, global, reporter)?;
    let camera = inputs::frame_camera(args.frames.camera.as_deref(), global, &template)?;
    Ok((template, camera))
}

/// Refuse files that cannot be tracked, before anything is written.
fn check_files(
    args: &TrackArgs,
    sources: &[inputs::Source],
    camera: &CameraModel,
) -> anyhow::Result<()> {
    let file = args.frames.camera.as_deref().unwrap_or(&args.template);
    inputs::check_sizes(sources, camera, file)?;
    let masks = [&args.frames.instrument_masks, &args.frames.organ_masks, &args.masks]
        .map(|m| m.as_deref());
    let kinds = [MaskKind::Instrument, MaskKind::Organ, MaskKind::Valid];
    for (masks, kind) in masks.into_iter().zip(kinds) {
        inputs::check_masks(sources, masks, kind)?;
    }
    Ok(())
}

/// The options that the arguments ask for.
fn options(args: &TrackArgs, global: &Global) -> anyhow::Result<TrackOptions> {
    let base = if args.realtime { TrackOptions::realtime() } else { TrackOptions::default() };
    let mut options = match &args.solve.options {
        Some(path) => inputs::options(path, |text| base.with_toml(text))?,
        None => base,
    };
    args.solve.settle(&mut options.reconstruct, global);
    Ok(options)
}

/// Serve the page of the run while it runs, and say where, if that is asked for.
fn watch(args: &TrackArgs, live: bool) -> anyhow::Result<()> {
    if !args.view {
        return Ok(());
    }
    let url = view::serve_running(&args.output, args.view_port)?;
    let text = format!("watch it at {url}\n");
    match live {
        // Standard output holds results.
        true => eprint!("{text}"),
        false => to_stdout(&text)?,
    }
    Ok(())
}

/// Folders and files of the input, apart from which results lie.
fn places(args: &TrackArgs) -> Vec<&Path> {
    let masks = args.masks().map(|(path, _)| path);
    let files = args.input.iter().filter(|input| !input::is_address(input));
    let others = [&args.template].into_iter().chain(&args.poses).chain(args.volume.places());
    files.chain(others).chain(masks).map(PathBuf::as_path).collect()
}

/// Frames a second where nothing says so.
const RATE: f64 = 25.0;

fn source(
    args: &TrackArgs,
    live: bool,
    stream: Option<Stream>,
    recorder: Option<Recorder>,
) -> FrameSource {
    let files = !live && stream.is_none();
    FrameSource {
        inputs: if files { args.input.clone() } else { Vec::new() },
        stream,
        recorder,
        format: args.input_format.unwrap_or_default(),
        size: args.size.unwrap_or_default(),
        masks: MaskFiles {
            instrument: args.frames.instrument_masks.clone(),
            organ: args.frames.organ_masks.clone(),
            valid: args.masks.clone(),
        },
        stride: args.stride as usize,
        realtime: args.realtime,
        numbered: false,
    }
}
