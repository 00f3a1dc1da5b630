//! `dsfms synth --video`: a clip of known truth, and the template to track it with.

use super::claim::Claim;
use crate::args::Global;
use crate::commands::experiment::pace::Paced;
use crate::draw::picture;
use crate::exit::Outcome;
use crate::outputs::{encode_png, prepare_folder, quoted, write_json, write_text};
use crate::poses::ImagePose;
use crate::progress::Reporter;
use clap::ValueEnum;
use dsfms::eval::deformed_zone;
use dsfms::eval::zone::extent;
use dsfms::experiment::SeriesOrgan;
use dsfms::geometry::Isometry;
use dsfms::image::{Frame, Mask, ToneCurve};
use dsfms::io::atomic::write_atomic;
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::io::clip_truth::{ClipTruth, write_clip_truth};
use dsfms::io::images::{find_frames, read_frame};
use dsfms::io::ply::{PlyExtras, Precision, write_ply};
use dsfms::io::template::write_template;
use dsfms::pipeline::{Exploration, Progress, TemplateOptions, template_from_posed_frames};
use dsfms::synth::ClipOptions;
use dsfms::synth::clip::{Clip, ClipFrame, ClipMoment, EXPLORATION, RATE};
use dsfms::template::LengthUnit;
use rayon::prelude::*;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Files of the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FrameFormat {
    /// Without loss, about 2 MB a frame of 1280x720.
    Png,
    /// Quality 95, a fifth of that.
    Jpeg,
}

/// What lies in the folder of a clip.
const OWN: [&str; 6] =
    ["frames", "exploration", "truth", "camera.json", "rest.ply", "organ.template"];

/// Frames that are made before any of them is put in order.
const BATCH: usize = 8;

/// Parameters of a clip.
pub struct VideoArgs<'a> {
    pub organ: &'a SeriesOrgan,
    pub vertices: usize,
    pub options: ClipOptions,
    pub format: FrameFormat,
    pub folder: &'a Path,
}

impl VideoArgs<'_> {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn picture_path(&self, folder: &str, number: usize) -> PathBuf {
        let ending = if self.format == FrameFormat::Png { "png" } else { "jpg" };
        self.path(&format!("{folder}/frame_{number:03}.{ending}"))
    }

    fn write_frame(&self, path: &Path, frame: &Frame) -> anyhow::Result<()> {
        let picture = picture(frame);
        let bytes = match self.format {
            FrameFormat::Png => encode_png(&picture)?,
            FrameFormat::Jpeg => {
                let mut bytes = Vec::new();
                image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
                    .encode_image(&picture)?;
                bytes
            }
        };
        Ok(write_atomic(path, |w| w.write_all(&bytes))?)
    }
}

/// Make the clip; frames that lie in the folder already are kept.
pub fn make(args: &VideoArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let seed = args.options.seed;
    let part = args.organ.part(args.vertices, seed)?;
    claim(args)?;
    for part in ["frames", "exploration", "truth/instruments", "truth"] {
        prepare_folder(&args.path(part))?;
    }
    let clip = Clip::new(&part, &args.options);
    let tone = Some(ToneCurve::Srgb);
    let camera = CameraFile { camera: clip.camera.clone(), tone, light: None, vignetting: None };
    write_camera(&args.path("camera.json"), &camera)?;
    let extras = PlyExtras { precision: Precision::Double, ..Default::default() };
    let (topology, unit) = (&clip.rest.topology, LengthUnit::Millimetre);
    write_ply(&args.path("rest.ply"), topology, &clip.rest.positions, unit, &extras)?;
    let progress = Paced::new(reporter);
    let explored = exploration(args, &clip, &progress)?;
    let poses = frames(args, &clip, &progress)?;
    let list = |poses: &[Isometry]| {
        let named = |(k, pose)| ImagePose::of(format!("frame_{k:03}"), pose);
        poses.iter().enumerate().map(named).collect::<Vec<ImagePose>>()
    };
    let known = json!({ "exploration": list(&explored), "deformed": list(&poses) });
    write_json(&args.path("truth/poses.json"), &known)?;
    let light = json!({ "light": clip.light.light, "coat": clip.light.coat });
    write_json(&args.path("truth/light.json"), &light)?;
    template(args, &clip, &explored, global, reporter)?;
    Ok(Outcome::Ok)
}

/// A folder belongs to one clip.
fn claim(args: &VideoArgs) -> anyhow::Result<()> {
    let parameters = json!({
        "organ": args.organ.name(),
        "vertices": args.vertices,
        "frames": args.options.frames,
        "size": args.options.size,
        "seed": args.options.seed,
        "format": if args.format == FrameFormat::Png { "png" } else { "jpeg" },
        "frames_a_second": RATE,
    });
    let clip = Claim { name: "clip.json", parameters, other: "another clip" };
    clip.take(args.folder, |name| OWN.contains(&name))
}

/// The organ at rest; returns the poses.
fn exploration(args: &VideoArgs, clip: &Clip, progress: &Paced) -> anyhow::Result<Vec<Isometry>> {
    (0..EXPLORATION)
        .map(|i| {
            progress.step("exploration", i, EXPLORATION);
            let path = args.picture_path("exploration", i);
            let (moment, shot) = clip.explore(i);
            if !path.exists() {
                args.write_frame(&path, &shot.frame)?;
            }
            Ok(moment.pose)
        })
        .collect()
}

/// Frames, masks and their truth, which is written last; returns the poses.
fn frames(args: &VideoArgs, clip: &Clip, progress: &Paced) -> anyhow::Result<Vec<Isometry>> {
    let count = args.options.frames;
    let complete = args.path("truth/clip.npz");
    if complete.exists() {
        return Ok((0..count).map(|k| clip.moment(k).pose).collect());
    }
    let mut truth = ClipTruth::default();
    let mut poses = Vec::new();
    let mut csv = "frame,gain,covered,instrument_share,visible_vertices,zone_vertices,\
                   largest_displacement_mm\n"
        .to_owned();
    for first in (0..count).step_by(BATCH) {
        progress.step("frames", first, count);
        let batch: Vec<(ClipMoment, ClipFrame)> = (first..(first + BATCH).min(count))
            .into_par_iter()
            .map(|k| {
                let moment = clip.moment(k);
                let shot = clip.shoot(k, &moment);
                let path = args.picture_path("frames", k);
                let mask = args.path(&format!("truth/instruments/frame_{k:03}.png"));
                if !(path.exists() && mask.exists()) {
                    write_mask(&mask, &shot.instrument)?;
                    args.write_frame(&path, &shot.frame)?;
                }
                Ok((moment, shot))
            })
            .collect::<anyhow::Result<_>>()?;
        for (k, (moment, shot)) in (first..).zip(batch) {
            let moved = &moment.displacement;
            let zone = deformed_zone(moved, Some(&shot.visible), extent(&clip.rest.positions));
            let largest = moved.iter().copied().fold(0.0, f64::max);
            let count = |flags: &[bool]| flags.iter().filter(|f| **f).count();
            // Writing to a string cannot fail.
            let _ = writeln!(
                csv,
                "{k},{:.4},{},{:.4},{},{},{largest:.3}",
                moment.gain,
                u8::from(moment.covered),
                shot.instrument.coverage(),
                count(&shot.visible),
                count(&zone)
            );
            truth.push(&moment.vertices, moved, &shot.visible, &zone);
            poses.push(moment.pose);
        }
    }
    progress.step("frames", count, count);
    write_text(&args.path("truth/frames.csv"), &csv)?;
    write_text(&args.path("truth/events.csv"), &events(clip, count))?;
    write_clip_truth(&complete, &truth)?;
    Ok(poses)
}

fn events(clip: &Clip, frames: usize) -> String {
    let line = |e: &dsfms::synth::clip::Event| {
        let kind = serde_json::to_value(e.event).unwrap_or_default();
        format!("{},{},{}\n", quoted(kind.as_str().unwrap_or_default()), e.first, e.last)
    };
    let lines: String = clip.script.events(frames).iter().map(line).collect();
    format!("event,first,last\n{lines}")
}

fn write_mask(path: &Path, mask: &Mask) -> anyhow::Result<()> {
    use image::ImageEncoder;
    let [w, h] = mask.size.map(|s| s as u32);
    let bytes: Vec<u8> = mask.data.iter().map(|&m| if m { 255 } else { 0 }).collect();
    let mut png = Vec::new();
    image::codecs::png::PngEncoder::new(&mut png).write_image(
        &bytes,
        w,
        h,
        image::ExtendedColorType::L8,
    )?;
    Ok(write_atomic(path, |file| file.write_all(&png))?)
}

/// `organ.template`, measured in the written exploration frames: light, albedo and descriptors are
/// estimates, only mesh and poses are the truth.
fn template(
    args: &VideoArgs,
    clip: &Clip,
    poses: &[Isometry],
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<()> {
    let path = args.path("organ.template");
    if path.exists() {
        return Ok(());
    }
    let frames = find_frames(&[args.path("exploration")])?
        .iter()
        .map(|p| read_frame(p))
        .collect::<Result<Vec<_>, _>>()?;
    let exploration = Exploration::new(&frames, &clip.camera);
    let poses: Vec<Option<Isometry>> = poses.iter().map(|p| Some(*p)).collect();
    let mut options = TemplateOptions::default();
    options.sfm.seed = global.seed();
    let (mesh, unit) = (clip.rest.clone(), LengthUnit::Millimetre);
    let built = template_from_posed_frames(&exploration, mesh, unit, &poses, &options, reporter)?;
    Ok(write_template(&path, &built.template)?)
}
