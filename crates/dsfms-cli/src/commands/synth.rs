//! `dsfms synth`: synthetic cases, clips and chessboards as files that the other commands read.

mod chessboard;
mod claim;
mod video;

use super::calibrate::{board_size, length_mm};
use super::experiment::pace::Paced;
use super::experiment::series::{SeriesArgs, percent};
use crate::args::{Global, Tone};
use crate::draw::picture;
use crate::exit::{Outcome, Usage};
use crate::outputs::{prepare_folder, write_json, write_png, write_text};
use crate::progress::Reporter;
use claim::Claim;
use clap::{ArgGroup, Args};
use dsfms::calibrate::Board;
use dsfms::experiment::SeriesOrgan;
use dsfms::geometry::Point2;
use dsfms::image::{ColorImage, ToneCurve};
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::io::matches::write_matches;
use dsfms::io::obj::{ObjExtras, write_obj};
use dsfms::io::ply::{PlyExtras, Precision, write_ply};
use dsfms::io::vertex_truth::{VertexTruth, write_vertex_truth};
use dsfms::mesh::Mesh;
use dsfms::pipeline::Progress;
use dsfms::synth::render::encoder;
use dsfms::synth::{Case, Cell, ChessboardOptions, ClipOptions};
use dsfms::template::bake::bake;
use dsfms::template::{Flattening, LengthUnit, SurfaceTexels};
use image::RgbImage;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

const EXAMPLES: &str = "\
Examples:
  dsfms synth --organ uterus --ext 0,10,20 --count 5 --seed 1 -o cases
  cd cases/ext10/case_0000
  dsfms template --mesh rest.obj --albedo albedo.png -o organ.template
  dsfms reconstruct organ.template frame_000.png --camera camera.json \\
      --matches matches.csv --method joint -o out
  dsfms evaluate out truth --camera camera.json
  # A clip of 500 frames to track, of a part of a uterus
  dsfms synth --video --organ uterus --seed 1 -o clip
  dsfms track clip/organ.template clip/frames --camera clip/camera.json -o out
  # The same pictures as a video file
  ffmpeg -framerate 25 -i clip/frames/frame_%03d.png -crf 15 \\
      -pix_fmt yuv420p clip.mp4
  # A chessboard of 15 x 11 squares, and the camera that is found in it
  dsfms synth --chessboard 14x10 --square 3mm -o board
  dsfms calibrate board --board 14x10 --square 3mm -o board/camera.json

Written for every case: frame_000.png, camera.json (with the light),
matches.csv, rest.obj (mm, with UV) and albedo.png, truth/frame_000.ply (camera
axes, the order of rest.obj) with truth/frame_000_vertices.npz, vertices.csv
(vertex,zone,visible,displacement; the zone is what moved by more than a tenth
of the largest displacement) and case.json. series.json says of which series
the cases are; more of the same may be added.

With --video: frames/frame_NNN.png, exploration/ (24 frames at rest),
camera.json, rest.ply (mm), organ.template (mesh and poses given; light, albedo
and descriptors measured in exploration/), clip.json and truth/: clip.npz
(vertices: frames x vertices x 3 in camera axes, displacement in mm, visible,
zone: what moved by at least half of the largest visible displacement),
events.csv (event,first,last frame), frames.csv, instruments/ (masks),
poses.json, light.json. The organ is pulled and pushed in turn, instruments
touch and pass, the exposure jumps, the lens is covered for 10 frames, one cut
changes view and shape. A run that was stopped goes on where it was.

With --chessboard: board_NNN.png (the board at all tilts under a light beside
the lens, through the lens's distortion, blurred and with noise), board.json,
truth/camera.json, which calibrate should find, and truth/poses.json (board to
camera, mm). The true camera is printed.

series.json, clip.json or board.json is the mark of the folder: one that holds
files or folders of the other names without it is refused.";

/// Write synthetic cases: deformed organs with image, matches and truth (paper, section 8.1).
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
#[command(group = ArgGroup::new("pictures"))]
pub struct SynthArgs {
    #[command(flatten)]
    series: SeriesArgs,
    /// Extensions, percent.
    #[arg(long, value_delimiter = ',', default_value = "0,5,10,15,20", value_parser = percent)]
    ext: Vec<f64>,
    /// Write one clip instead of cases; of the options above it takes --organ and --vertices.
    #[arg(long, group = "pictures")]
    video: bool,
    /// Write pictures of a chessboard instead of cases; inner corners along both sides.
    #[arg(long, value_name = "COLUMNSxROWS", group = "pictures", value_parser = board_size,
        conflicts_with_all = OF_CASES)]
    chessboard: Option<[usize; 2]>,
    /// Side of a square of the chessboard, as 3mm or 0.3cm; a plain number is mm; default 3mm.
    #[arg(long, value_name = "LENGTH", value_parser = length_mm)]
    square: Option<f64>,
    /// Frames of the clip, 25 a second, or pictures of the chessboard; default 500, and 15.
    #[arg(long, value_name = "N", value_parser = frames, requires = "pictures")]
    frames: Option<usize>,
    /// Size of the pictures of clip or chessboard, px.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = super::track::size,
        requires = "pictures")]
    size: [usize; 2],
    /// Files of the clip's frames.
    #[arg(long, value_enum, default_value_t = video::FrameFormat::Png, requires = "video",
        conflicts_with = "chessboard")]
    frame_format: video::FrameFormat,
    /// Folder for the cases, the clip or the chessboard.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

/// What a chessboard has not.
const OF_CASES: [&str; 11] = [
    "organ",
    "count",
    "noise",
    "matches",
    "light",
    "vertices",
    "extension_of",
    "attractions",
    "reach",
    "height",
    "ext",
];

/// Side of the albedo picture, px.
const ALBEDO_SIDE: usize = 1024;

/// Run the command.
pub fn run(args: &SynthArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    check(args, global)?;
    if let Some(corners) = args.chessboard {
        let options = ChessboardOptions {
            board: Board { corners, square: args.square.unwrap_or(3.0) },
            size: args.size,
            pictures: args.frames.unwrap_or(15),
            seed: global.seed(),
        };
        return chessboard::make(&options, &args.output, global, reporter);
    }
    let organ = args.series.organ()?;
    if args.video {
        return clip(args, &organ, global, reporter);
    }
    let protocol = args.series.protocol(global.seed());
    // A surface without a part that can be used is told before anything is made.
    organ.part(protocol.vertices, protocol.case_seed(0))?;
    // More cases and other extensions of the same series may be added.
    let parameters = serde_json::json!({ "organ": organ.name(), "protocol": protocol });
    let series = Claim { name: "series.json", parameters, other: "cases of another series" };
    series.take(&args.output, |name| name.strip_prefix("ext").is_some_and(is_cell))?;
    let cells = args.ext.iter().flat_map(|&extension| {
        args.series.noise.iter().map(move |&noise| Cell { extension, noise })
    });
    let jobs: Vec<(Cell, usize)> =
        cells.flat_map(|cell| (0..args.series.count).map(move |i| (cell, i))).collect();
    let progress = Paced::new(reporter);
    let done = AtomicUsize::new(0);
    progress.step("cases", 0, jobs.len());
    jobs.par_iter().try_for_each(|&(cell, index)| {
        let case = organ.case(&protocol, cell, index)?;
        let several = args.series.noise.len() > 1;
        let noise = if several { format!("_noise{}", cell.noise) } else { String::new() };
        let folder = format!("ext{:02}{noise}/case_{index:04}", cell.extension);
        let folder = args.output.join(folder);
        write(&folder, &case)?;
        write_json(
            &folder.join("case.json"),
            &serde_json::json!({
                "organ": organ.name(),
                "case": index,
                "extension_percent": cell.extension,
                "mean_extension_percent": 100.0 * case.deformation.extension,
                "largest_extension_percent": 100.0 * case.deformation.largest_extension,
                "amplitude_mm": amplitude(&case),
                "match_noise_px": cell.noise,
                "protocol": protocol,
            }),
        )?;
        progress.step("cases", done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
        anyhow::Ok(())
    })?;
    Ok(Outcome::Ok)
}

/// What clap lets pass: it asks for no option that another one rules out.
fn check(args: &SynthArgs, global: &Global) -> Result<(), Usage> {
    let wrong = |text: &str| Err(Usage(text.into()));
    if matches!(global.tone, Some(Tone::Linear)) {
        return wrong("--tone linear: synth writes sRGB pictures; leave it out");
    }
    if args.square.is_some() && args.chessboard.is_none() {
        return wrong("--square belongs to --chessboard");
    }
    if args.video && args.size.iter().any(|s| *s < 64) {
        return wrong("--size: a clip needs at least 64x64");
    }
    Ok(())
}

/// `--frames`.
fn frames(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 1..=100_000) => Ok(n),
        _ => Err("expected a whole number from 1 to 100000".into()),
    }
}

/// Whether a folder of cases ends so: `10`, `02.5_noise4`.
fn is_cell(rest: &str) -> bool {
    let (extension, noise) = rest.split_once("_noise").unwrap_or((rest, "0"));
    [extension, noise].iter().all(|number| number.parse::<f64>().is_ok())
}

fn clip(
    args: &SynthArgs,
    organ: &SeriesOrgan,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<Outcome> {
    let (frames, size, seed) = (args.frames.unwrap_or(500), args.size, global.seed());
    let arguments = video::VideoArgs {
        organ,
        vertices: args.series.vertices_or(1000),
        options: ClipOptions { frames, size, seed },
        format: args.frame_format,
        folder: &args.output,
    };
    video::make(&arguments, global, reporter)
}

fn displacements(case: &Case) -> Vec<f64> {
    let rest = &case.template.mesh.positions;
    case.deformation.vertices.iter().zip(rest).map(|(a, b)| (a - b).norm()).collect()
}

fn amplitude(case: &Case) -> f64 {
    displacements(case).into_iter().fold(0.0, f64::max)
}

fn write(folder: &Path, case: &Case) -> anyhow::Result<()> {
    for folder in [folder, &folder.join("truth")] {
        prepare_folder(folder)?;
    }
    let at = |name: &str| folder.join(name);
    let (mesh, unit) = (&case.template.mesh, LengthUnit::Millimetre);
    write_png(&at("frame_000.png"), &picture(&case.frame))?;
    let (camera, tone) = (case.camera.clone(), Some(ToneCurve::Srgb));
    write_camera(
        &at("camera.json"),
        &CameraFile { camera, tone, light: case.template.light.clone(), vignetting: None },
    )?;
    write_matches(&at("matches.csv"), &case.matches)?;
    let uv = planar_uv(mesh);
    write_obj(&at("rest.obj"), mesh, unit, &ObjExtras { uv: Some(&uv), material: None })?;
    if let Some(albedo) = &case.template.albedo {
        write_png(&at("albedo.png"), &albedo_picture(albedo, uv)?)?;
    }
    let extras = PlyExtras {
        precision: Precision::Double,
        visible: Some(&case.visible),
        ..Default::default()
    };
    write_ply(&at("truth/frame_000.ply"), &mesh.topology, &case.truth, unit, &extras)?;
    let displacement = displacements(case);
    let mut csv = "vertex,zone,visible,displacement\n".to_owned();
    for (v, d) in displacement.iter().enumerate() {
        let [zone, seen] = [case.deformation.zone[v], case.visible[v]].map(u8::from);
        csv += &format!("{v},{zone},{seen},{d}\n");
    }
    write_text(&at("vertices.csv"), &csv)?;
    let known = VertexTruth { visible: case.visible.clone(), displacement };
    write_vertex_truth(&at("truth/frame_000_vertices.npz"), &known)?;
    Ok(())
}

/// UV along x and against y: the rest shape faces −z, so this is how the camera sees it.
fn planar_uv(mesh: &Mesh) -> Vec<[Point2; 3]> {
    let [low, high] = mesh.bounding_box();
    let side = 1.04 * (high - low).xy().max();
    let middle = 0.5 * (low.coords + high.coords);
    let corner = |v: u32| {
        let p = &mesh.positions[v as usize];
        Point2::new(0.5 + (p.x - middle.x) / side, 0.5 - (p.y - middle.y) / side)
    };
    mesh.topology.faces.iter().map(|face| face.map(corner)).collect()
}

fn albedo_picture(albedo: &SurfaceTexels, corners: Vec<[Point2; 3]>) -> anyhow::Result<RgbImage> {
    let faces = corners.len();
    let flat = Flattening {
        corners,
        seam: Vec::new(),
        quasi_conformal: vec![1.0; faces],
        log_area: vec![0.0; faces],
    };
    let ColorImage { size: [w, h], data } = bake(albedo, &flat, ALBEDO_SIDE, 4)?.image;
    let encode = encoder(&ToneCurve::Srgb);
    Ok(RgbImage::from_fn(w as u32, h as u32, |x, y| {
        image::Rgb(data[y as usize * w + x as usize].map(|v| encode(f64::from(v)).round() as u8))
    }))
}
