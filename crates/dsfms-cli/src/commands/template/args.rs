//! The arguments of `dsfms template`.

use super::organ::OrganArgs;
use crate::commands::scale::ScaleArgs;
use clap::{Args, ValueEnum};
use dsfms::io::mesh::MeshUnit;
use dsfms::template::albedo::Combine;
use dsfms::template::flatten::FlattenMethod;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  # From frames (PNG, JPEG or TIFF in name order) of the organ at rest, seen by
  # a moving camera
  dsfms template exploration/ --camera camera.json -o organ.template
  # Only inside the organ's outline: white = organ
  dsfms template exploration/ --camera camera.json --organ-masks masks/ \\
      -o organ.template
  # From a video; the intrinsics are a guess to be refined
  dsfms template endo.mp4 --camera guess.json --self-calibrate \\
      -o organ.template
  # The organ outlined by hand on one frame
  dsfms template exploration/ --camera camera.json \\
      --organ-polygon frame_004:120,80,560,90,600,400,90,420 \\
      -o organ.template
  # In mm: two points of the tissue, picked in the frames, are 35 mm apart
  dsfms template exploration/ --camera camera.json \\
      --scale-reference frame_003:812,440 frame_003:1020,610 35mm \\
      -o organ.template
  # The organ is what this pixel shows, as far as the surface goes on without a
  # step
  dsfms template exploration/ --camera camera.json \\
      --organ-click 320,240@frame_004 -o organ.template
  # It went the wrong way: this pixel is not the organ, and what was drawn
  dsfms template exploration/ --camera camera.json \\
      --not-organ-click 60,400@frame_004 --organ-scribbles strokes.json \\
      -o organ.template
  # What moves apart in frames of the deformed organ is apart
  dsfms template exploration/ --camera camera.json --also deformed/ \\
      -o organ.template
  # In mm: a surface of the organ from CT, in any place
  dsfms template exploration/ --camera camera.json --organ-masks masks/ \\
      --scale-mesh liver.stl -o organ.template
  # On a mesh of your own, in the world of known camera poses
  dsfms template exploration/ --camera camera.json --mesh organ.ply \\
      --poses poses.json -o organ.template
  # The camera poses are known (a tracked laparoscope, COLMAP), the surface is
  # not
  dsfms template exploration/ --camera camera.json --poses poses.json \\
      -o organ.template
  # A mesh whose albedo is known: an image in its UV, or a CSV with one value
  # (or r,g,b) a vertex
  dsfms template --mesh organ.obj --albedo albedo.png -o organ.template

Masks: white (above 127) = valid for --masks, = organ for --organ-masks. A mask
belongs to the frame of the same name or number. A mask that covers nearly all
or nothing draws a warning.

The result is a folder: template.toml, template.glb, template.ply and more.
Without --mesh its lengths are in template units, similar to the truth at an
unknown scale; a known distance (--scale-reference, --camera-step) or a metric
mesh (--scale-mesh) makes them mm. pictures/ shows the flattening and the
albedo, and which part of the frames was taken for the organ where no mask said
it (organ.png; as masks in organ_masks/: copy, mend, and give them back with
--organ-masks). Where the organ ends is open, all is kept, the exit code is 2,
and pictures/organ_a.png, organ_b.png ... show what may be meant, outlines from
green, clearly marked, to red, a guess, with an option for each. The exit code
is 2 too where frames agree on less than three quarters of the surface (faint
texture, highlights): the rest is closed, not measured, and red in
pictures/measured.png; and where frames do not look like a given --mesh, as
with wrong --poses or a mesh of another place.
surroundings.ply is what lies around the organ. `dsfms view TEMPLATE` has a
page (\"Organ\") on which strokes are drawn, the outline following in seconds,
and saved to TEMPLATE/organ_scribbles.json.
Strokes (--organ-scribbles):
  {\"strokes\": [{\"frame\": \"frame_004\", \"organ\": true,
                \"px\": [[120, 80], [310, 95]]}]}
precision.json says how far camera poses and sparse points may
be off (expected errors and covariances).

What finished stages made (features, matches, poses, depth) is kept in
TEMPLATE.partial until the template is written: after Ctrl-C or a crash the
same command goes on behind the last of them, with the same result.";

/// Build a template (rest shape, albedo, descriptors) from exploration frames or a mesh.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct TemplateArgs {
    /// Folder of frames, image files, or one video.
    #[arg(value_name = "FRAMES_DIR_OR_VIDEO")]
    pub frames: Vec<PathBuf>,
    /// Intrinsics: camera.json, OpenCV YAML or JSON, or COLMAP's cameras.txt, cameras.bin
    /// or model folder; where the cameras of a model's images differ, frames are brought to
    /// that of most.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Masks of the frames, white = valid image content (no instrument, inside the viewport).
    #[arg(help_heading = "Input", long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    #[command(flatten)]
    pub organ: OrganArgs,
    /// Leave the surface as stereo saw it; else the shading of all frames refines it within its
    /// expected error.
    #[arg(help_heading = "Surface", long, conflicts_with = "mesh")]
    pub no_shading_refinement: bool,
    /// Vertices of the template mesh, 100 to 50000; default 1000.
    #[arg(help_heading = "Surface", long, value_name = "N")]
    pub vertices: Option<usize>,
    /// Shorter edges where the surface bends, longer ones where it is flat, 0.5 to 2 of the mean:
    /// STRENGTH from 0 (one length) to 1 (the same distance from the surface everywhere).
    #[arg(help_heading = "Surface", long, value_name = "STRENGTH", num_args = 0..=1, require_equals = true, default_missing_value = "1", conflicts_with = "mesh")]
    pub adaptive: Option<f64>,
    /// Peel off the rim what the surface itself hides from every frame, or what faces away from
    /// all.
    #[arg(help_heading = "Surface", long, conflicts_with = "mesh")]
    pub peel_hidden: bool,
    /// Surface to use: PLY, OBJ, STL, glTF, OFF or VTK (.vtk, .vtp); its vertex order and faces are
    /// kept.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    pub mesh: Option<PathBuf>,
    /// Unit of the numbers in --mesh or --scale-mesh; default what the file says (glTF is in
    /// metres), else mm.
    #[arg(help_heading = "Input", long, value_enum, value_name = "UNIT")]
    pub mesh_unit: Option<UnitName>,
    /// Mend --mesh or --scale-mesh: merge vertices at the same place, remove repeated faces and
    /// those without area, turn faces that run against their neighbours. What was done is said.
    #[arg(help_heading = "Input", long)]
    pub repair: bool,
    /// Known camera poses of the frames, in the mesh's frame if there is one: poses.json, or
    /// COLMAP's images.txt, images.bin or model folder. Without --mesh the surface is in their
    /// world and unit, called template units unless a known distance makes them mm.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    pub poses: Option<PathBuf>,
    /// Albedo of the mesh: an image in its UV, or a CSV with one value (or r,g,b) per vertex.
    #[arg(
        help_heading = "Input",
        long,
        value_name = "FILE",
        requires = "mesh",
        conflicts_with = "poses"
    )]
    pub albedo: Option<PathBuf>,
    /// Estimate the lens's vignetting along with the light, where the camera file does not say.
    #[arg(help_heading = "Light and albedo", long, conflicts_with = "albedo")]
    pub estimate_vignetting: bool,
    /// What the albedos of single frames become; default robust.
    #[arg(help_heading = "Light and albedo", long, value_enum, conflicts_with = "albedo")]
    pub albedo_rule: Option<AlbedoRule>,
    /// Refine focal length, principal point and radial distortion along with the poses.
    #[arg(help_heading = "Scale and calibration", long, conflicts_with_all = ["mesh", "poses"])]
    pub self_calibrate: bool,
    #[command(flatten)]
    pub scale: ScaleArgs,
    /// Surface of the same organ in mm (PLY, OBJ, STL or glTF), in any place: the template takes
    /// its scale from the placement that fits best.
    #[arg(help_heading = "Scale and calibration", long, value_name = "MESH", conflicts_with_all = ["mesh", "scale_reference", "camera_step"])]
    pub scale_mesh: Option<PathBuf>,
    /// How charts are flattened; default bff.
    #[arg(help_heading = "Surface", long, value_enum)]
    pub flatten: Option<Flatten>,
    /// Sizes and thresholds as TOML, as `dsfms options template` prints them; what it does not name
    /// keeps its default, and what the command line names counts.
    #[arg(help_heading = "Method", long, value_name = "FILE")]
    pub options: Option<PathBuf>,
    /// Leave out TEMPLATE/report.html.
    #[arg(help_heading = "Output", long)]
    pub no_report: bool,
    /// Template folder to write.
    #[arg(help_heading = "Output", short, long, value_name = "TEMPLATE")]
    pub output: PathBuf,
}

impl TemplateArgs {
    /// The first option that is given and says something of frames alone.
    pub fn of_frames(&self) -> Option<&'static str> {
        let given = [
            (self.camera.is_some(), "--camera"),
            (self.masks.is_some(), "--masks"),
            (self.organ.organ_masks.is_some(), "--organ-masks"),
            (self.organ.organ_click.is_some(), "--organ-click"),
            (!self.organ.organ_polygon.is_empty(), "--organ-polygon"),
            (!self.organ.also.is_empty(), "--also"),
            (self.vertices.is_some(), "--vertices"),
            (self.estimate_vignetting, "--estimate-vignetting"),
            (self.albedo_rule.is_some(), "--albedo-rule"),
            (self.self_calibrate, "--self-calibrate"),
        ];
        given.into_iter().find(|option| option.0).map(|option| option.1)
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Flatten {
    /// Conformal with constant boundary scale: the least area distortion.
    Bff,
    /// Least-squares conformal map, two vertices held.
    Lscm,
    /// Spectral conformal map.
    Spectral,
}

impl From<Flatten> for FlattenMethod {
    fn from(method: Flatten) -> Self {
        match method {
            Flatten::Bff => Self::Bff,
            Flatten::Lscm => Self::Lscm,
            Flatten::Spectral => Self::Spectral,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum UnitName {
    /// Millimetres.
    Mm,
    /// Centimetres.
    Cm,
    /// Metres.
    M,
}

impl From<UnitName> for MeshUnit {
    fn from(name: UnitName) -> Self {
        match name {
            UnitName::Mm => Self::Millimetre,
            UnitName::Cm => Self::Centimetre,
            UnitName::M => Self::Metre,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum AlbedoRule {
    /// Mean that leaves outliers out, weighted by how squarely each frame sees the place.
    Robust,
    /// The smallest (the paper's eq. 2): no highlight gets in, noise and shadows do.
    Minimum,
}

impl From<AlbedoRule> for Combine {
    fn from(rule: AlbedoRule) -> Self {
        match rule {
            AlbedoRule::Robust => Self::Robust,
            AlbedoRule::Minimum => Self::Minimum,
        }
    }
}
