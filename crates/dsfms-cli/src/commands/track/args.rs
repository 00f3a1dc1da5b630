//! The arguments of `dsfms track`.

use super::input::{InputFormat, is_address};
use super::link::LinkArgs;
use crate::exit::Usage;
use crate::formats::Format;
use crate::frame_args::{FrameArgs, SolveArgs};
use crate::inputs;
use crate::volume::VolumeArgs;
use clap::{Args, ValueEnum};
use dsfms::pipeline::Method;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  # A video, with pictures of every frame
  dsfms track organ.template clip.mp4 --camera camera.json --overlay -o out
  # Motion alone: faster
  dsfms track organ.template frames/ --camera camera.json --method dsfm -o out
  # A mesh (of a CT) that was laid on one frame by hand, and no exploration
  dsfms track liver.ply frames/ --poses pose.json --camera camera.json -o out
  # The CT that the template's mesh was made from, at every 50th frame
  dsfms track liver.template clip.mp4 --camera camera.json --stride 50 \\
      --volume ct.nii.gz --volume-out both -o out
  # A live source: raw RGB frames in, one line of JSON a frame out
  capture | dsfms track organ.template - --size 1280x720 --camera camera.json \\
      -o out
  # A camera's JPEG stream; frames that come too fast are dropped
  ffmpeg -f v4l2 -i /dev/video0 -c:v copy -f mjpeg - | \\
      dsfms track organ.template - --input-format mjpeg --realtime \\
      --camera camera.json -o out

Every frame ends ok, degraded (a surface with reservations, in the column
reasons) or lost (no surface). A frame that cannot be decoded is lost too.

Written to OUT: vertices.npz (vertices: frames x vertices x 3 in camera axes,
NaN where lost; status: 0 ok, 1 degraded, 2 lost); summary.csv (a row a frame;
residual_px: median distance of the kept matches from the surface,
reprojection_px: the mean one, photometric: mean relative difference of
brightness, of joint; dropped: frames left out before it); report.html, one
page with plots and up to 96 frames in 3D, written anew every few seconds, so
that `dsfms view OUT` shows a running video; of longer ones every frame for
`dsfms view` in view/frame_NNN.json (about 50 KB each); with --ply
frame_NNN.ply; with --formats frame_NNN.vtp, .obj, .stl, and frames.glb, an
animation; camera_poses.json, the camera of every frame by what lies around the
organ, where the template holds that; with --overlay overlay/frame_NNN.png and,
where ffmpeg is installed, overlay.mp4; with --volume
volume/frame_NNN_warped.nii.gz, volume/frame_NNN_displacement.nii.gz, or both.
NNN is the place in the sequence.

Frames on standard input also give a line of JSON each on standard output:
frame, status, reasons, dropped, ms and, with a surface, pose
(camera_from_template, 4 x 4), residual_px and agreement; where the template
holds what lies around the organ, camera with pose, matches, residual_px and
uncertainty. With --live-vertices every line says \"vertices_bytes\": N and N
bytes follow its line end: x, y, z of every vertex in camera axes, 32-bit
little-endian floats; none where there is no surface. In Python:
  while line := pipe.readline():
      result = json.loads(line)
      xyz = pipe.read(result[\"vertices_bytes\"])
      xyz = numpy.frombuffer(xyz, \"<f4\").reshape(-1, 3)";

/// Follow the template through a video.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct TrackArgs {
    /// Template folder, or with --poses a mesh.
    #[arg(value_name = "TEMPLATE")]
    pub template: PathBuf,
    /// A video, image files, folders of them, - for frames on standard input, or an OpenIGTLink
    /// server, igtl://HOST:PORT/DEVICE (no device: the first that sends pictures).
    /// An address of a network stream (rtsp://, srt://, ...) is read by an installed ffmpeg.
    #[arg(required_unless_present = "device", conflicts_with = "device", value_name = "VIDEO")]
    pub input: Vec<PathBuf>,
    /// A capture device in place of VIDEO, read by an installed ffmpeg: a format of ffmpeg and its
    /// name there, as v4l2:/dev/video0 or decklink:NAME; --size and --rate are asked of it.
    #[arg(help_heading = "Input", long, value_name = "KIND:NAME")]
    pub device: Option<String>,
    /// Keep every frame that is taken, lossless and with its time, in a new folder; track plays it
    /// again at its times (with --realtime) or as fast as it can.
    #[arg(help_heading = "Input", long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Of a mesh in place of a template: poses of one frame of VIDEO or more, of the organ at rest
    /// (camera_from_world, as of `dsfms template`). What they show is the look that the mesh is
    /// followed by.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    pub poses: Option<PathBuf>,
    /// What is solved in every frame. joint has the smaller errors; dsfm is faster, and right where
    /// the template's albedo or light is not to be trusted (smoke, blood, another lens).
    #[arg(help_heading = "Method", long, value_enum, default_value_t = TrackMethod::Joint)]
    pub method: TrackMethod,
    /// What of the picture is valid (the endoscope's viewport), white = valid: a folder, or one
    /// file for all frames; without it a round viewport is found by itself.
    #[arg(help_heading = "Input", long, value_name = "FILE_OR_DIR")]
    pub masks: Option<PathBuf>,
    #[command(flatten)]
    pub frames: FrameArgs,
    #[command(flatten)]
    pub volume: VolumeArgs,
    #[command(flatten)]
    pub solve: SolveArgs,
    /// Take every Nth frame.
    #[arg(help_heading = "Input", long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub stride: u32,
    /// Write the last good surface for lost frames too; their status stays lost.
    #[arg(help_heading = "Method", long)]
    pub keep_lost: bool,
    /// What standard input holds: RGB of 8 bits a channel (with --size), or JPEG pictures; default
    /// raw.
    #[arg(help_heading = "Input", long, value_enum)]
    pub input_format: Option<InputFormat>,
    /// Size of the raw frames on standard input, px.
    #[arg(help_heading = "Input", long, value_name = "WxH", value_parser = size)]
    pub size: Option<[usize; 2]>,
    /// Keep up with the source: a frame that comes before the last is solved takes the place of the
    /// one that waits, shading is read more coarsely, and where the organ is lost it is searched on
    /// another thread. Files play at their own rate, or at --rate.
    #[arg(help_heading = "Method", long)]
    pub realtime: bool,
    /// Frames a second of the input; default what the video says, else 25.
    #[arg(help_heading = "Input", long, value_name = "FPS", value_parser = rate)]
    pub rate: Option<f64>,
    /// Serve the page of the run, which follows it, to the browser of this machine (as
    /// `dsfms view`); its address, which nobody can guess, is printed.
    #[arg(help_heading = "Output", long, conflicts_with = "no_report")]
    pub view: bool,
    /// Port of the page; default any free one.
    #[arg(help_heading = "Output", long, value_name = "N", default_value_t = 0, requires = "view")]
    pub view_port: u16,
    /// The vertices too on standard output, behind the line of every frame.
    #[arg(help_heading = "Output", long)]
    pub live_vertices: bool,
    #[command(flatten)]
    pub link: LinkArgs,
    /// A PLY for every frame.
    #[arg(help_heading = "Output", long)]
    pub ply: bool,
    /// A picture of every frame with the surface, and a video of them where ffmpeg is installed.
    #[arg(help_heading = "Output", long)]
    pub overlay: bool,
    /// Further files, for other programs.
    #[arg(
        help_heading = "Output",
        long,
        value_enum,
        value_delimiter = ',',
        value_name = "FORMATS"
    )]
    pub formats: Vec<Format>,
    /// Leave out OUT/report.html.
    #[arg(help_heading = "Output", long)]
    pub no_report: bool,
    /// Folder for the results.
    #[arg(help_heading = "Output", short, long, value_name = "OUT")]
    pub output: PathBuf,
}

impl TrackArgs {
    /// Masks that are given, and the option that names them.
    pub fn masks(&self) -> impl Iterator<Item = (&PathBuf, &'static str)> {
        let all = [
            (&self.frames.instrument_masks, "--instrument-masks"),
            (&self.frames.organ_masks, "--organ-masks"),
            (&self.masks, "--masks"),
        ];
        all.into_iter().filter_map(|(path, option)| Some((path.as_ref()?, option)))
    }

    /// Whether the input is files: no standard input, no address, no device.
    pub fn takes_files(&self) -> bool {
        let file = |input: &PathBuf| input != Path::new("-") && !is_address(input);
        self.device.is_none() && self.input.iter().all(file)
    }

    /// Surfaces and figures alone, of every frame, as fast as it goes.
    pub fn without_outputs(&mut self) {
        (self.device, self.record, self.live_vertices) = (None, None, false);
        (self.input_format, self.size) = (None, None);
        (self.link.igtl, self.link.igtl_connect) = (None, None);
        (self.ply, self.overlay, self.view, self.no_report) = (false, false, false, true);
        self.formats.clear();
        self.frames.structures.clear();
        self.volume.volume = None;
        self.realtime = false;
    }
}

/// Methods that follow a video.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TrackMethod {
    /// Motion (eq. 3).
    Dsfm,
    /// Motion, prior and shading in one problem.
    Joint,
}

impl From<TrackMethod> for Method {
    fn from(method: TrackMethod) -> Self {
        match method {
            TrackMethod::Dsfm => Self::Dsfm,
            TrackMethod::Joint => Self::Joint,
        }
    }
}

/// `1280x720`.
pub fn size(text: &str) -> Result<[usize; 2], String> {
    let parts: Option<Vec<usize>> = text.split('x').map(|n| n.parse().ok()).collect();
    match parts.as_deref() {
        // Frames of up to 64 million px, 200 MB.
        Some(&[w, h]) if w >= 1 && h >= 1 && w.max(h) <= 16384 && w * h <= 1 << 26 => Ok([w, h]),
        _ => Err("expected WIDTHxHEIGHT, for example 1280x720, of at most 64 million px".into()),
    }
}

/// `25`, `29.97`.
fn rate(text: &str) -> Result<f64, String> {
    let valid = |v: &f64| (0.1..=1000.0).contains(v);
    text.parse().ok().filter(valid).ok_or_else(|| "expected 0.1 to 1000 frames a second".into())
}

/// Combinations that clap cannot name well.
pub fn check(args: &TrackArgs, live: bool) -> anyhow::Result<()> {
    let wrong = |text: &str| Err(Usage(text.into()).into());
    for (masks, option) in args.masks() {
        inputs::must_exist(masks, option)?;
    }
    if args.realtime && args.volume.volume.is_some() {
        return wrong("--volume takes seconds a frame, and cannot keep up; leave --realtime out");
    }
    let raw = live && args.input_format.unwrap_or_default() == InputFormat::Raw;
    match live {
        true if raw && args.size.is_none() => wrong("raw frames on standard input need --size WxH"),
        false if args.input.contains(&PathBuf::from("-")) => {
            wrong("- (standard input) stands alone, not beside files")
        }
        false if args.live_vertices => {
            wrong("--live-vertices belongs to frames on standard input (-)")
        }
        false if args.input_format.is_some() => {
            wrong("--input-format belongs to frames on standard input (-)")
        }
        _ if args.size.is_some() && !raw && args.device.is_none() => {
            wrong("--size belongs to raw frames on standard input (-), and to --device")
        }
        _ => Ok(()),
    }
}
