//! Speed, latency and memory of tracking a video that lies in memory, and its accuracy on a
//! synthetic one:
//!
//! ```sh
//! cargo run --release --example track_speed -- organ.template frames/ --method joint
//! cargo run --release --example track_speed -- synthetic --frames 120 --method joint
//! cargo run --release --example track_speed -- organ.template frames/ --loop 10000
//! ```
//!
//! Frames are decoded first, so that decoding does not count; they are prepared on one thread and
//! solved on another, as `dsfms track --realtime` does, whose options they are where `--options`
//! names no others. `--rate 25` offers a frame every 40 ms, which gives the
//! latency of a live source, with searches beside the frames; without it frames follow as fast as
//! they are solved and wait for searches. `--loop N` goes
//! forth and back through the frames until N have been tracked, and watches memory.

mod clip;
// Worker threads as `dsfms track --realtime` has them.
#[path = "../../../dsfms-cli/src/cores.rs"]
mod cores;
mod measure;

use clip::Clip;
use dsfms::image::Frame;
use dsfms::io::images::{find_frames, read_frame};
use dsfms::io::template::read_template;
use dsfms::pipeline::Method;
use dsfms::track::{TrackOptions, Tracked, Tracker};
use measure::{Meter, cpu_seconds};
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

/// What the command line asks for.
struct Args {
    inputs: Vec<String>,
    method: Method,
    frames: usize,
    rounds: Option<usize>,
    rate: Option<f64>,
    vertices: usize,
    cold_every: usize,
    options: TrackOptions,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args = args()?;
    if args.options.awake {
        cores::start_threads(None, true)?;
    }
    let clip = match &args.inputs[..] {
        [one] if one == "synthetic" => Clip::synthetic(args.vertices, args.frames),
        [template, frames] => read(template, frames, args.frames)?,
        _ => return Err("expected TEMPLATE FRAMES or synthetic; see the head of the source".into()),
    };
    let count = args.rounds.unwrap_or(clip.frames.len());
    let (meter, tracked) = run(&clip, &args, count)?;
    meter.print();
    clip.print_errors(&tracked);
    clip.print_matches(&tracked);
    if args.cold_every > 0 {
        clip.print_cold(&tracked, args.method, args.cold_every);
    }
    Ok(())
}

fn args() -> Result<Args, Box<dyn std::error::Error>> {
    let mut all = std::env::args().skip(1);
    let mut args = Args {
        inputs: Vec::new(),
        method: Method::Joint,
        frames: usize::MAX,
        rounds: None,
        rate: None,
        vertices: 1000,
        cold_every: 0,
        options: TrackOptions::realtime(),
    };
    while let Some(arg) = all.next() {
        if !arg.starts_with("--") {
            args.inputs.push(arg);
            continue;
        }
        let value = all.next().ok_or_else(|| format!("{arg} needs a value"))?;
        match arg.as_str() {
            "--method" if value == "dsfm" => args.method = Method::Dsfm,
            "--method" if value == "joint" => args.method = Method::Joint,
            "--frames" => args.frames = value.parse()?,
            "--loop" => args.rounds = Some(value.parse()?),
            "--rate" => args.rate = Some(value.parse()?),
            "--vertices" => args.vertices = value.parse()?,
            "--options" => {
                args.options = args.options.with_toml(&std::fs::read_to_string(value)?)?
            }
            "--cold-every" => args.cold_every = value.parse()?,
            _ => return Err(format!("{arg} {value} is not understood").into()),
        }
    }
    Ok(args)
}

fn read(template: &str, frames: &str, most: usize) -> Result<Clip, Box<dyn std::error::Error>> {
    let template = read_template(&PathBuf::from(template))?;
    let camera = template.camera.clone().ok_or("the template holds no camera")?;
    let paths = find_frames(&[PathBuf::from(frames)])?;
    let frames: Result<Vec<Frame>, _> = paths.iter().take(most).map(|p| read_frame(p)).collect();
    Ok(Clip { camera, template, frames: frames?, truth: Vec::new(), zone: Vec::new() })
}

/// Place in a clip of `n` of the `k`th frame of a walk forth and back.
fn forth_and_back(k: usize, n: usize) -> usize {
    let around = k % (2 * n - 1).saturating_sub(1).max(1);
    if around < n { around } else { 2 * (n - 1) - around }
}

/// What was measured, and what was tracked first, through all frames once.
type Run = (Meter, Vec<Tracked>);

fn run(clip: &Clip, args: &Args, count: usize) -> Result<Run, Box<dyn std::error::Error>> {
    let options = args.options.clone();
    let tone = clip.template.tone.clone();
    let mut tracker = Tracker::new(&clip.template, &clip.camera, &tone, args.method, options)?;
    let mut preparation = tracker.preparation();
    // Where frames wait for their turn, none would be lost to a search that runs beside them.
    let searcher = args.rate.and_then(|_| tracker.searcher());
    let (mut meter, mut kept) = (Meter::new(count), Vec::new());
    let (sender, receiver) = sync_channel(1);
    let start = Instant::now();
    let cpu = cpu_seconds();
    std::thread::scope(|scope| {
        let mut tracker = tracker;
        searcher.map(|searcher| scope.spawn(move || searcher.run()));
        scope.spawn(move || {
            for k in 0..count {
                let frame = clip.frames[forth_and_back(k, clip.frames.len())].clone();
                if let Some(rate) = args.rate {
                    let due = start + Duration::from_secs_f64(k as f64 / rate);
                    std::thread::sleep(due.saturating_duration_since(Instant::now()));
                }
                let given = args.rate.map_or(Instant::now(), |rate| {
                    start + Duration::from_secs_f64(k as f64 / rate)
                });
                let prepared = preparation.prepare(frame, None).expect("frames fit the camera");
                if sender.send((given, prepared)).is_err() {
                    break;
                }
            }
        });
        for (given, prepared) in receiver {
            let begun = Instant::now();
            let tracked = tracker.solve(&prepared);
            meter.add(given.elapsed(), begun.elapsed(), &tracked);
            if kept.len() < clip.frames.len() {
                kept.push(tracked);
            }
        }
    });
    meter.finish(start.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    Ok((meter, kept))
}
