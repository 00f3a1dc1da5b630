//! The arguments that `dsfms reconstruct` and `dsfms track` share.

use crate::args::Global;
use clap::{Args, ValueEnum};
use dsfms::pipeline::ReconstructOptions;
use dsfms::register::{CameraMotion, Prior};
use std::path::PathBuf;

/// What is known of the frames beside them.
#[derive(Debug, Args)]
pub struct FrameArgs {
    /// Intrinsics of these frames; default the template's own camera.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Masks of the instruments, white = instrument.
    #[arg(help_heading = "Input", long, value_name = "DIR")]
    pub instrument_masks: Option<PathBuf>,
    /// Outlines of the organ, white = organ.
    #[arg(help_heading = "Input", long, value_name = "DIR")]
    pub organ_masks: Option<PathBuf>,
    /// Meshes of hidden structures in the template's frame and unit (tumour, vessels, of `dsfms
    /// register-ct`), carried along with the deformation: OUT/structures (track: with --ply), and pictures
    /// with them (track: those of --overlay).
    #[arg(help_heading = "Input", long, value_name = "MESH", num_args = 1..)]
    pub structures: Vec<PathBuf>,
}

/// What decides the solve.
#[derive(Debug, Args)]
pub struct SolveArgs {
    /// What the surface keeps of its rest shape in eq. 3 and in the joint solve; without it that of
    /// the options file, or conformal.
    #[arg(help_heading = "Method", long, value_enum)]
    pub prior: Option<PriorName>,
    /// Where the camera is; without it that of the options file, or auto. at-rest for a scope that
    /// stands where it stood in a view of the template while tissue stretches: seen alone, 3 % of
    /// stretch look like a distance that is 3 % less, and where all tissue moves auto does not see
    /// that it stands.
    #[arg(help_heading = "Method", long, value_enum)]
    pub camera_motion: Option<MotionName>,
    /// Weights and thresholds, as `dsfms options` prints those of the command; what the file does
    /// not name keeps its default.
    #[arg(help_heading = "Method", long, value_name = "FILE")]
    pub options: Option<PathBuf>,
}

impl SolveArgs {
    /// What the command line says goes before the options file.
    pub fn settle(&self, options: &mut ReconstructOptions, global: &Global) {
        options.seed = global.seed.unwrap_or(options.seed);
        if let Some(prior) = self.prior.map(Prior::from) {
            (options.register.prior.kind, options.joint.prior.kind) = (prior, prior);
        }
        if let Some(motion) = self.camera_motion {
            options.register.camera_motion = motion.into();
        }
    }
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

impl From<PriorName> for Prior {
    fn from(name: PriorName) -> Self {
        match name {
            PriorName::Conformal => Self::Conformal,
            PriorName::Isometric => Self::Isometric,
            PriorName::Arap => Self::Arap,
        }
    }
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
