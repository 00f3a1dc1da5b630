//! What every command is told.

use crate::progress::ProgressKind;
use clap::{Args, ValueEnum};
use dsfms::image::ToneCurve;

/// Version and commit.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), env!("DSFMS_COMMIT"));

#[derive(Debug, Args)]
pub struct Global {
    /// Worker threads, at most 1024; default one per core. Results do not depend on it.
    #[arg(help_heading = "Global options", long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Seed of every random draw; without it that of the options file, or 0.
    #[arg(help_heading = "Global options", long, global = true, value_name = "N")]
    pub seed: Option<u64>,
    /// How progress is told on standard error.
    #[arg(help_heading = "Global options", long, global = true, value_enum, value_name = "KIND", default_value_t = ProgressKind::Auto)]
    pub progress: ProgressKind,
    /// No progress and no warnings; errors only.
    #[arg(help_heading = "Global options", long, short, global = true)]
    pub quiet: bool,
    /// Log what is decided and with which figures; -vv says more. RUST_LOG=dsfms::sfm=debug
    /// chooses.
    #[arg(help_heading = "Global options", long, short, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Tone curve of the images; overrides the camera file's.
    #[arg(help_heading = "Global options", long, global = true, value_enum)]
    pub tone: Option<Tone>,
}

impl Global {
    /// The seed of a command without an options file.
    pub fn seed(&self) -> u64 {
        self.seed.unwrap_or_default()
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Tone {
    /// Pixel values are proportional to light.
    Linear,
    /// Ordinary images (IEC 61966-2-1).
    Srgb,
}

impl From<Tone> for ToneCurve {
    fn from(tone: Tone) -> Self {
        match tone {
            Tone::Linear => Self::Linear,
            Tone::Srgb => Self::Srgb,
        }
    }
}
