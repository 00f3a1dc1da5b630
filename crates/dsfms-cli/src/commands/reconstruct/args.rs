//! The arguments of `dsfms reconstruct`.

use crate::formats::Format;
use crate::volume::VolumeArgs;
use clap::{Args, ValueEnum};
use dsfms::pipeline::Method;
use dsfms::register::{CameraMotion, Prior};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  # Motion and shading, matches found automatically
  dsfms reconstruct organ.template deformed/ --camera camera.json -o out
  # Matches of your own, instruments masked: white = instrument
  dsfms reconstruct organ.template deformed/*.png --camera camera.json \\
      --matches matches/ --instrument-masks instruments/ -o out
  # Motion only (eq. 3), where albedo or light are not to be trusted
  dsfms reconstruct organ.template frame_004.png --camera camera.json \\
      --method dsfm -o out
  # The CT that the template's mesh was made from, deformed with the organ
  dsfms reconstruct liver.template deformed/ --camera camera.json -o out \\
      --volume ct.nii.gz --volume-out both
  # Matches alone, without images (tracks of another program)
  dsfms reconstruct organ.template --matches tracks/ --camera camera.json \\
      --method dsfm -o out

Masks: white (above 127) = instrument for --instrument-masks, = organ for
--organ-masks. A mask that covers nearly all or nothing draws a warning.

Matches: CSV with the columns face,b1,b2,b3,x,y (0-based face of the template,
barycentrics, pixels with centres at integers), found by name; further columns
are ignored, rows with visible = 0 skipped. A folder holds one file per frame,
of the same name or number.

Written to OUT for every frame: frame_NNN.ply (the template's faces and vertex
order, camera axes of the frame, unit in a header comment, visible per vertex),
frame_NNN.json (status, pose, gain, cost of every energy term),
frame_NNN_overlay.png; summary.csv; and report.html, one page with everything
in 3D (of more than 24 frames evenly spaced ones; view/frame_NNN.json has all
of them for `dsfms view OUT`). With --formats also frame_NNN.vtp (ParaView,
3D Slicer), .obj, .stl, and frames.glb, an animation with one frame a second.
NNN is the last number in the image's name where all have one and no two the
same, else the place in the sequence.";

/// Reconstruct the deformed organ in every given frame.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct ReconstructArgs {
    /// Template folder.
    #[arg(value_name = "TEMPLATE")]
    pub template: PathBuf,
    /// Frames: image files, folders, or a video. With --matches they may be left out: rigid and dsfm
    /// look at matches alone.
    #[arg(required_unless_present = "matches", value_name = "IMAGES")]
    pub images: Vec<PathBuf>,
    /// Intrinsics of these frames; default the template's own camera.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Matches: a CSV, or a folder of them; without it they are found automatically.
    #[arg(help_heading = "Input", long, value_name = "FILE_OR_DIR")]
    pub matches: Option<PathBuf>,
    /// Masks of the instruments, white = instrument.
    #[arg(help_heading = "Input", long, value_name = "DIR")]
    pub instrument_masks: Option<PathBuf>,
    /// Outlines of the organ, white = organ.
    #[arg(help_heading = "Input", long, value_name = "DIR")]
    pub organ_masks: Option<PathBuf>,
    /// What is solved; default joint, which has the smallest errors, or dsfm on a template without albedo.
    /// dsfm, motion alone, where albedo or light are not to be trusted (smoke, blood, another lens);
    /// dsfms to follow the paper; rigid and sfs to compare.
    #[arg(help_heading = "Method", long, value_enum)]
    pub method: Option<MethodName>,
    /// What the surface keeps of its rest shape in eq. 3 and in the joint solve; without it that of
    /// the options file, or conformal.
    #[arg(help_heading = "Method", long, value_enum, conflicts_with = "literal")]
    pub prior: Option<PriorName>,
    /// Where the camera is; without it that of the options file, or auto. at-rest for a scope that stands
    /// where it stood in a view of the template while tissue stretches: seen alone, 3 % of stretch look
    /// like a distance that is 3 % less, and where all tissue moves auto does not see that it stands.
    #[arg(help_heading = "Method", long, value_enum, conflicts_with = "literal")]
    pub camera_motion: Option<MotionName>,
    /// Solve eqs. 3 and 4 as printed in the paper instead of the repaired form.
    #[arg(help_heading = "Method", long)]
    pub literal: bool,
    /// Weights and thresholds, as `dsfms options reconstruct` prints them; what the file does not name
    /// keeps its default.
    #[arg(help_heading = "Method", long, value_name = "FILE")]
    pub options: Option<PathBuf>,
    /// Meshes of hidden structures in the template's frame and unit (tumour, vessels), carried along
    /// with the deformation: OUT/structures and OUT/frame_NNN_structures.png.
    #[arg(help_heading = "Input", long, value_name = "MESH", num_args = 1..)]
    pub structures: Vec<PathBuf>,
    #[command(flatten)]
    pub volume: VolumeArgs,
    /// Further files of every frame, for other programs.
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Rigid pose only: how far a shape without deformation comes.
    Rigid,
    /// Shape from shading on the rigid pose.
    Sfs,
    /// Motion (eq. 3): needs matches, no albedo and no light.
    Dsfm,
    /// Motion, then shading (eq. 4 of the paper).
    Dsfms,
    /// Motion, prior and shading in one problem (beyond the paper): the smallest errors.
    Joint,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PriorName {
    /// Angles (the paper), and weakly areas.
    Conformal,
    /// Lengths.
    Isometric,
    /// Lengths, and the shape of every vertex's surroundings: as rigid as possible.
    Arap,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MotionName {
    /// Its pose is that of the matches.
    Moving,
    /// At rest where a quarter of the matches stays where a view has it while others move.
    Auto,
    /// It stands in one of the template's views.
    AtRest,
}

impl From<MotionName> for CameraMotion {
    fn from(name: MotionName) -> Self {
        match name {
            MotionName::Moving => Self::Moving,
            MotionName::Auto => Self::Auto,
            MotionName::AtRest => Self::AtRest,
        }
    }
}

impl From<PriorName> for Prior {
    fn from(name: PriorName) -> Self {
        match name {
            PriorName::Conformal => Self::Conformal,
            PriorName::Isometric => Self::Isometric,
            PriorName::Arap => Self::Arap,
        }
    }
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Rigid => Self::Rigid,
            MethodName::Sfs => Self::Sfs,
            MethodName::Dsfm => Self::Dsfm,
            MethodName::Dsfms => Self::Dsfms,
            MethodName::Joint => Self::Joint,
        }
    }
}

/// The name that `--method` takes.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Rigid => "rigid",
        Method::Sfs => "sfs",
        Method::Dsfm => "dsfm",
        Method::Dsfms => "dsfms",
        Method::Joint => "joint",
    }
}
