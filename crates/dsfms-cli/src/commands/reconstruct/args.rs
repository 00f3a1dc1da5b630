//! The arguments of `dsfms reconstruct`.

use crate::formats::Format;
use crate::frame_args::{FrameArgs, SolveArgs};
use crate::volume::VolumeArgs;
use clap::{Args, ValueEnum};
use dsfms::pipeline::Method;
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
    /// Frames: image files, folders, or a video. With --matches they may be left out: rigid and
    /// dsfm look at matches alone.
    #[arg(required_unless_present = "matches", value_name = "IMAGES")]
    pub images: Vec<PathBuf>,
    /// Matches: a CSV, or a folder of them; without it they are found automatically.
    #[arg(help_heading = "Input", long, value_name = "FILE_OR_DIR")]
    pub matches: Option<PathBuf>,
    /// What is solved; default joint, which has the smallest errors, or dsfm on a template without
    /// albedo. dsfm, motion alone, where albedo or light are not to be trusted (smoke, blood,
    /// another lens); dsfms to follow the paper; rigid and sfs to compare.
    #[arg(help_heading = "Method", long, value_enum)]
    pub method: Option<MethodName>,
    #[command(flatten)]
    pub solve: SolveArgs,
    /// Solve eqs. 3 and 4 as printed in the paper instead of the repaired form.
    #[arg(help_heading = "Method", long, conflicts_with_all = ["prior", "camera_motion"])]
    pub literal: bool,
    #[command(flatten)]
    pub frames: FrameArgs,
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
