//! What `register-ct` is told.

use crate::commands::calibrate::length_mm;
use crate::commands::template::args::UnitName;
use clap::{Args, ValueEnum};
use dsfms::io::landmarks::Axes;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  # Landmarks picked on both surfaces, vessels and a tumour carried along
  dsfms register-ct organ.template liver.stl --landmarks pairs.csv \\
      --structures tumour.ply vessels.ply -o ct
  # Then on the live image
  dsfms track organ.template endo.mp4 -o out --structures ct/structures/*.ply
  # Landmarks from 3D Slicer: a list on each surface, paired by their labels
  dsfms register-ct organ.template liver.ply -o ct \\
      --landmarks liver.mrk.json template.mrk.json
  # No landmarks: every orientation is tried, and what is ambiguous is refused
  dsfms register-ct organ.template kidney.stl -o ct
  # A mesh in metres, mended, without bending it
  dsfms register-ct organ.template liver.obj --mesh-unit m --repair --rigid \\
      --landmarks pairs.csv -o ct

Landmarks: three pairs or more that are not in one line. One CSV with header
  name,ct_x,ct_y,ct_z,template_x,template_y,template_z
where ct_vertex or template_vertex (from 0) may stand for x,y,z; or JSON,
  {\"pairs\": [{\"name\": \"fundus\", \"ct\": [12, -3, 40], \"template\": 1822}]}
or two files, first of the CT mesh, then of the template: 3D Slicer's .mrk.json
or .fcsv, MeshLab's .pp, or CSV (name,x,y,z), paired by name, else by order.
Numbers are those of the mesh files. More than three pairs survive wrong ones.

OUT holds ct.ply and structures/NAME.ply in the template's frame and unit (what
--structures of reconstruct and track expects; `expected_error` is that
of every point), ct_original.ply (the mesh as it came, in mm, for
--volume-registration), registration.json (similarity, residuals, uncertainty,
verdict) and registration.png (from three sides, residuals in colour).

Exit codes: 0 registered; 2 registered with doubts; 1 refused (too few or wrong
landmarks, too little overlap, a surface that slides along itself, another pose
as good): registration.json then holds the reason and nothing else is written.";

/// Bring a preoperative mesh (CT, MRI) and structures inside it onto a template, without known
/// poses.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct RegisterCtArgs {
    /// Template folder.
    #[arg(value_name = "TEMPLATE")]
    pub template: PathBuf,
    /// Outer surface of the organ from CT or MRI: PLY, OBJ, STL, glTF, OFF or VTK.
    #[arg(value_name = "CT_MESH")]
    pub ct: PathBuf,
    /// Pairs in one file (.csv, .json), or the points of the CT mesh and those of the template.
    #[arg(help_heading = "Input", long, value_name = "FILE", num_args = 1..=2)]
    pub landmarks: Vec<PathBuf>,
    /// Meshes inside the organ, in the frame of the CT mesh: tumours, vessels.
    #[arg(help_heading = "Input", long, value_name = "FILE", num_args = 1..)]
    pub structures: Vec<PathBuf>,
    /// Unit of the numbers in the CT mesh and its structures; default what the files say, else mm.
    #[arg(help_heading = "Input", long, value_enum, value_name = "UNIT")]
    pub mesh_unit: Option<UnitName>,
    /// Axes of the CT mesh, for landmark files that state theirs (3D Slicer).
    #[arg(help_heading = "Input", long, value_enum, default_value_t = AxesName::Lps)]
    pub mesh_axes: AxesName,
    /// Mend the meshes: merge vertices at the same place, remove repeated faces and those without
    /// area, turn faces that run against their neighbours. What was done is said.
    #[arg(help_heading = "Input", long)]
    pub repair: bool,
    /// Scale between template and CT; default free for a template in template units, bounded (5 %)
    /// for one in mm.
    #[arg(help_heading = "Method", long, value_enum)]
    pub scale: Option<ScaleName>,
    /// Leave out the deformation after the similarity.
    #[arg(help_heading = "Method", long)]
    pub rigid: bool,
    /// Farthest that the CT surface may bend.
    #[arg(help_heading = "Method", long, value_name = "LENGTH", default_value = "15mm", value_parser = length_mm,
        conflicts_with = "rigid")]
    pub max_deformation: f64,
    /// Standard deviation of a picked pair.
    #[arg(help_heading = "Method", long, value_name = "LENGTH", default_value = "4mm", value_parser = length_mm)]
    pub landmark_error: f64,
    /// Expected error of a structure above which the result is degraded.
    #[arg(help_heading = "Method", long, value_name = "LENGTH", default_value = "10mm", value_parser = length_mm)]
    pub max_error: f64,
    /// Folder to write.
    #[arg(help_heading = "Output", short, long, value_name = "OUT")]
    pub output: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ScaleName {
    /// Not known: a similarity.
    Free,
    /// Known but for 5 %.
    Bounded,
    /// Known: a rigid motion.
    Fixed,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum AxesName {
    /// Left, posterior, superior (DICOM).
    Lps,
    /// Right, anterior, superior.
    Ras,
}

impl From<AxesName> for Axes {
    fn from(name: AxesName) -> Self {
        match name {
            AxesName::Lps => Self::Lps,
            AxesName::Ras => Self::Ras,
        }
    }
}
