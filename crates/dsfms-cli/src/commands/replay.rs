//! `dsfms replay`: a run of `dsfms track` once more from what it kept, and whether it gives the
//! same bits.

use super::track::{Again, RunFile, TrackArgs, digest, number_of, target, track_again};
use crate::args::{Global, VERSION};
use crate::exit::{Outcome, Usage};
use crate::frame_args::FrameArgs;
use crate::interrupt;
use crate::place;
use crate::progress::Reporter;
use crate::stdout::to_stdout;
use anyhow::Context;
use clap::Args;
use dsfms::geometry::Point3;
use dsfms::io::images::find_frames;
use dsfms::pipeline::Progress;
use dsfms::track::shapes::read_shapes;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  dsfms track organ.template clip.mp4 --record frames -o out
  dsfms replay out
  # The recording was moved
  dsfms replay out --frames archive/frames

Runs `dsfms track` again as OUT/run.json says: the same options, template and
camera (told by their digests), the frames of the recording (--record) or,
where there is none, the files of the first run; of a live run the frames that
were not dropped. Says whether the surfaces have the same bits.

Exit codes: 0 the same bits; 2 they differ, from the frame that is named;
1 it cannot be replayed.";

/// Run a tracked video again and compare the surfaces.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct ReplayArgs {
    /// Output folder of `dsfms track`.
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// The frames, if they are no longer where they were: the folder of --record, or the files.
    #[arg(long, value_name = "PATH")]
    frames: Option<PathBuf>,
    /// The template, if it is no longer where it was.
    #[arg(long, value_name = "TEMPLATE")]
    template: Option<PathBuf>,
    /// The camera file, if it is no longer where it was.
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Keep the results of the second run in this folder.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    keep: Option<PathBuf>,
}

/// Reads a command line of `dsfms track`.
type ReadLine = dyn Fn(&[&str]) -> anyhow::Result<(TrackArgs, Global)>;

/// Run the command.
pub fn run(args: &ReplayArgs, read: &ReadLine, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let absolute = |path: &Path| std::path::absolute(path).context("the current folder");
    let first = absolute(&args.output)?;
    let run = RunFile::read(&first)?;
    let line = std::iter::once("dsfms").chain(run.arguments.iter().map(String::as_str));
    let (mut track, global) = read(&line.collect::<Vec<_>>())?;
    let moved = |path: &Option<PathBuf>| path.as_deref().map(absolute).transpose();
    let (frames, template, camera) =
        (moved(&args.frames)?, moved(&args.template)?, moved(&args.camera)?);
    let temporary = tempfile::tempdir()?;
    track.output = moved(&args.keep)?.unwrap_or_else(|| temporary.path().join("out"));
    if place::same(&track.output, &first) {
        let text =
            "-o is the run that is replayed, which would be overwritten; choose another folder";
        return Err(Usage(text.into()).into());
    }
    track.template = template.unwrap_or_else(|| run.folder.join(&track.template));
    track.frames.camera =
        camera.or_else(|| track.frames.camera.take().map(|path| run.folder.join(path)));
    track.poses = track.poses.take().map(|path| run.folder.join(path));
    unchanged(&run, &track, reporter)?;
    let recorded = source(&mut track, frames, &run)?;
    plain(&mut track, &run.folder);
    let again = Again { run: &run, recorded };
    track_again(&track, &global, reporter, &again)?;
    if interrupt::asked() {
        return Ok(Outcome::Nothing);
    }
    compare(&first, &track.output, &run)
}

/// Template and camera must be those of the first run; another program may give other bits.
fn unchanged(run: &RunFile, track: &TrackArgs, reporter: &Reporter) -> anyhow::Result<()> {
    let same = |path: &Path, expected: &str, option: &str| -> anyhow::Result<()> {
        let found = digest(path).with_context(|| format!("{option} gives another place"))?;
        anyhow::ensure!(
            found == expected,
            "{} has changed since (digest {found}, then {expected}); {option} gives another one",
            path.display()
        );
        Ok(())
    };
    same(&track.template, &run.template, "--template")?;
    if let (Some(path), Some(expected)) = (&track.frames.camera, &run.camera) {
        same(path, expected, "--camera")?;
    }
    if let (Some(path), Some(expected)) = (&track.poses, &run.poses) {
        same(path, expected, "no option")?;
    }
    let own = (VERSION, target());
    if (run.version.as_str(), &run.target) != (own.0, &own.1) {
        reporter.warn(&format!(
            "the run is of dsfms {} ({}), this is {VERSION} ({}): the bits may differ",
            run.version, run.target, own.1
        ));
    }
    Ok(())
}

/// Put the frames in place of the input; `true` where they are a recording, numbered by their
/// names.
fn source(track: &mut TrackArgs, given: Option<PathBuf>, run: &RunFile) -> anyhow::Result<bool> {
    let within = |path: &PathBuf| run.folder.join(path);
    let recording = given.or_else(|| track.record.as_ref().map(within));
    // Masks go by the names of the files.
    let masked = [&track.frames.instrument_masks, &track.frames.organ_masks, &track.masks]
        .iter()
        .any(|m| m.is_some());
    let files = track.takes_files();
    match recording {
        Some(folder) if !(files && masked && folder.join("times.csv").is_file()) => {
            anyhow::ensure!(
                folder.exists(),
                "the frames are not in {}; --frames gives another place",
                folder.display()
            );
            let recorded = folder.join("times.csv").is_file();
            if recorded {
                complete(&folder, run)?;
                // Every one of its frames was taken.
                track.stride = 1;
            }
            track.input = vec![folder];
            Ok(recorded)
        }
        _ if files => {
            track.input = track.input.iter().map(within).collect();
            Ok(false)
        }
        _ => Err(Usage(
            "the frames of this run were not kept; track with --record to be able to replay".into(),
        )
        .into()),
    }
}

/// Refuse a recording that lacks frames that were tracked.
fn complete(folder: &Path, run: &RunFile) -> anyhow::Result<()> {
    let found = find_frames(&[folder.to_owned()])?;
    let there: std::collections::HashSet<usize> =
        found.iter().filter_map(|path| number_of(path)).collect();
    let lacks = |t: &&super::track::Taken| t.unread.is_none() && !there.contains(&t.number);
    let lacking: Vec<usize> = run.frames.iter().filter(lacks).map(|t| t.number).collect();
    anyhow::ensure!(
        lacking.is_empty(),
        "the recording lacks {} of {} frames (the first is {}): what the disk could not keep up with was left \
         out, so it cannot be replayed",
        lacking.len(),
        run.frames.len(),
        lacking.first().copied().unwrap_or_default()
    );
    Ok(())
}

/// No further outputs, and paths from the folder of the first run.
fn plain(track: &mut TrackArgs, folder: &Path) {
    let FrameArgs { instrument_masks, organ_masks, .. } = &mut track.frames;
    for path in
        [instrument_masks, organ_masks, &mut track.masks].into_iter().filter_map(Option::as_mut)
    {
        *path = folder.join(&path);
    }
    track.without_outputs();
}

/// Tell whether both runs gave the same surfaces.
fn compare(first: &Path, second: &Path, run: &RunFile) -> anyhow::Result<Outcome> {
    let [one, two] = [first, second].map(|folder| read_shapes(&folder.join("vertices.npz")));
    let (one, two) = (one?, two?);
    match difference(&one, &two) {
        None => {
            to_stdout(&format!("{} frame(s): the same bits\n", one.1.len()))?;
            Ok(Outcome::Ok)
        }
        Some((place, what)) => {
            let number = run.frames.get(place).map_or(place, |t| t.number);
            to_stdout(&format!("differs first in frame {number}: {what}\n"))?;
            Ok(Outcome::Degraded)
        }
    }
}

/// Surfaces and status of all frames.
type Shapes = (Vec<Vec<Point3>>, Vec<u8>);

/// The first frame in which two runs differ, and how.
fn difference(one: &Shapes, two: &Shapes) -> Option<(usize, String)> {
    let words = ["ok", "degraded", "lost"];
    let word = |status: u8| words.get(usize::from(status)).copied().unwrap_or("unknown");
    for place in 0..one.1.len().min(two.1.len()) {
        if one.1[place] != two.1[place] {
            let text = format!("it was {}, now {}", word(one.1[place]), word(two.1[place]));
            return Some((place, text));
        }
        let (a, b) = (&one.0[place], &two.0[place]);
        let same = |(a, b): (&Point3, &Point3)| {
            a.iter()
                .zip(b.iter())
                .all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
        };
        if a.len() != b.len() || !a.iter().zip(b).all(same) {
            let far = a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            return Some((place, format!("surfaces are up to {far:.3e} apart")));
        }
    }
    let (then, now) = (one.1.len(), two.1.len());
    (then != now).then(|| (then.min(now), format!("there were {then} frames, now there are {now}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_difference_is_named() {
        let shape = |x: f64| vec![Point3::new(x, 2.0, 3.0), Point3::new(f64::NAN, 0.0, 0.0)];
        let one: Shapes = (vec![shape(1.0), shape(2.0)], vec![0, 1]);
        assert_eq!(difference(&one, &one), None);
        let moved: Shapes = (vec![shape(1.0), shape(2.5)], vec![0, 1]);
        let (place, what) = difference(&one, &moved).unwrap();
        assert!(place == 1 && what.contains("5.000e-1"), "{what}");
        let told: Shapes = (vec![shape(1.0), shape(2.5)], vec![2, 1]);
        assert_eq!(difference(&one, &told), Some((0, "it was ok, now lost".into())));
        let short: Shapes = (vec![shape(1.0)], vec![0]);
        assert_eq!(difference(&one, &short).unwrap().0, 1);
    }
}
