//! The volume of `--volume`: read, carried to every frame and written.

mod registration;
pub use registration::ORIGINAL;

use crate::exit::Usage;
use crate::outputs::write_json;
use crate::progress::Reporter;
use anyhow::Context;
use clap::{Args, ValueEnum};
use dsfms::geometry::Point3;
use dsfms::io::nifti::{NiftiFile, read_nifti, write_displacement, write_warped};
use dsfms::pipeline::Progress;
use dsfms::template::{LengthUnit, Template};
use dsfms::voxels::{MeshAxes, PlacedOrgan, Sampling, VoxelBody};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Options of a volume.
#[derive(Args, Debug)]
pub struct VolumeArgs {
    /// CT or MRI of the organ (.nii, .nii.gz), whose inside is carried along with the deformation:
    /// OUT/volume. The template is a closed mesh made from it, or --volume-registration says where
    /// it lies.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    pub volume: Option<PathBuf>,
    /// Folder of `dsfms register-ct`, whose mesh was made from the volume.
    #[arg(help_heading = "Input", long, value_name = "DIR", requires = "volume")]
    pub volume_registration: Option<PathBuf>,
    /// Axes of the mesh that was made from the volume (3D Slicer writes meshes in LPS).
    #[arg(help_heading = "Input", long, value_enum, default_value_t = VolumeAxes::Lps, requires = "volume")]
    pub volume_axes: VolumeAxes,
    /// The volume holds labels (a segmentation), which are not to be mixed.
    #[arg(help_heading = "Input", long, requires = "volume")]
    pub volume_labels: bool,
    /// What is written of the volume for every frame with a surface.
    #[arg(help_heading = "Output", long, value_enum, default_value_t = VolumeOut::Warped, requires = "volume")]
    pub volume_out: VolumeOut,
}

impl VolumeArgs {
    /// Folders and files of the input.
    pub fn places(&self) -> impl Iterator<Item = &PathBuf> {
        self.volume.iter().chain(&self.volume_registration)
    }
}

/// What is written of a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum VolumeOut {
    /// Where each voxel goes, mm, as ITK and ANTs have displacement fields.
    Field,
    /// The organ deformed, on the volume's grid.
    Warped,
    /// Field and warped.
    Both,
}

/// Names of axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum VolumeAxes {
    /// Left, posterior, superior (DICOM).
    Lps,
    /// Right, anterior, superior (NIfTI).
    Ras,
}

impl From<VolumeAxes> for MeshAxes {
    fn from(axes: VolumeAxes) -> Self {
        match axes {
            VolumeAxes::Lps => Self::Lps,
            VolumeAxes::Ras => Self::Ras,
        }
    }
}

/// A volume and what carries it.
pub struct CarriedVolume {
    file: NiftiFile,
    body: VoxelBody,
    background: f64,
    sampling: Sampling,
    out: VolumeOut,
}

/// `OUT/volume/frame_NNN.json`.
#[derive(Serialize)]
struct VolumeRecord {
    /// 4 x 4, row by row: the volume's world (RAS, mm) with its displacement, to camera axes in
    /// `unit`.
    camera_from_volume: [[f64; 4]; 4],
    /// `mm` or `template_units`: of the camera axes.
    unit: &'static str,
    /// Of the organ's surface.
    displacement_mean_mm: f64,
    displacement_largest_mm: f64,
    /// Voxels without a value, since the deformation folds there.
    #[serde(skip_serializing_if = "Option::is_none")]
    folded_voxels: Option<usize>,
}

/// Least share of the organ in the volume that draws no warning.
const COVERED: f64 = 0.95;

impl CarriedVolume {
    /// Read the files and prepare them; `None` without a volume.
    pub fn read(
        args: &VolumeArgs,
        template: &Template,
        reporter: &Reporter,
    ) -> anyhow::Result<Option<Self>> {
        let Some(path) = &args.volume else { return Ok(None) };
        reporter.step("volume", 0, 1);
        let organ = match &args.volume_registration {
            Some(folder) => registration::read(folder, template)
                .with_context(|| format!("--volume-registration {}", folder.display()))?,
            None if template.unit == LengthUnit::TemplateUnit => {
                let text = "--volume: the template is in template units; a volume needs a template in mm, or \
                            --volume-registration with the folder of `dsfms register-ct`";
                return Err(Usage(text.into()).into());
            }
            None => PlacedOrgan::template(&template.mesh),
        };
        let file = read_nifti(path)?;
        let axes = args.volume_axes.into();
        let body = VoxelBody::new(file.volume.grid(), axes, &template.mesh, &organ)
            .with_context(|| format!("--volume {}", path.display()))?;
        reporter.step("volume", 1, 1);
        let [covered, least] = [body.covered(), COVERED].map(|share| 100.0 * share);
        if covered < least {
            reporter.warn(&format!(
                "{}: {covered:.0} % of the organ's surface lie in the volume; the rest of it has no voxels",
                path.display()
            ));
        }
        let labels = args.volume_labels || file.is_labels();
        let sampling = if labels { Sampling::Nearest } else { Sampling::Linear };
        // Label 0 is nothing.
        let background = if labels { 0.0 } else { file.background() };
        Ok(Some(Self { file, body, background, sampling, out: args.volume_out }))
    }

    /// `OUT/volume/NAME_displacement.nii.gz`, `NAME_warped.nii.gz` and `NAME.json` of a surface;
    /// `vertices` in camera axes.
    pub fn write(
        &self,
        folder: &Path,
        name: &str,
        (vertices, unit): (&[Point3], LengthUnit),
        reporter: &Reporter,
    ) -> anyhow::Result<()> {
        let path = |ending: &str| folder.join(format!("volume/{name}{ending}"));
        let motion = self.body.motion(vertices)?;
        if motion.lost() > 0 {
            reporter.warn(&format!(
                "{name}: part of the organ moves by more than a quarter of its size; the volume does not follow there"
            ));
        }
        if self.out != VolumeOut::Warped {
            let slice = |component, k| motion.field_slice(component, k);
            write_displacement(&path("_displacement.nii.gz"), &self.file, slice)?;
        }
        let mut folded_voxels = None;
        if self.out != VolumeOut::Field {
            let folded = AtomicUsize::new(0);
            write_warped(&path("_warped.nii.gz"), &self.file, |k| {
                let slice =
                    motion.warped_slice(&self.file.volume, self.background, self.sampling, k);
                folded.fetch_add(slice.unsolved, Ordering::Relaxed);
                slice.bytes
            })?;
            folded_voxels = Some(folded.into_inner());
        }
        if let Some(folded @ 1..) = folded_voxels {
            reporter.warn(&format!(
                "{name}: the deformation folds in {folded} voxels, which have no value"
            ));
        }
        let matrix = motion.camera_from_world();
        let [displacement_mean_mm, displacement_largest_mm] = motion.surface_mm();
        let record = VolumeRecord {
            camera_from_volume: std::array::from_fn(|r| std::array::from_fn(|c| matrix[(r, c)])),
            unit: unit.label(),
            displacement_mean_mm,
            displacement_largest_mm,
            folded_voxels,
        };
        write_json(&path(".json"), &record)
    }
}
