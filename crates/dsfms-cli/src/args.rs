//! The command line as clap reads it.

use crate::commands::{
    calibrate, demo, evaluate, experiment, export, figure, inspect, options, reconstruct, synth,
    template, track, view,
};
use clap::{Args, Parser, Subcommand, ValueEnum};
use dsfms::image::ToneCurve;

const EXIT_CODES: &str = "\
Exit codes:
  0   every frame is ok
  1   nothing was produced
  2   some frames are degraded or failed (their .json says why)
  64  wrong usage";

/// Reconstruct a deforming organ in 3D from a monocular laparoscope, by motion and shading.
#[derive(Debug, Parser)]
#[command(name = "dsfms", version, after_help = EXIT_CODES, arg_required_else_help = false)]
pub struct Arguments {
    #[command(flatten)]
    pub global: Global,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Args)]
pub struct Global {
    /// Worker threads, at most 1024; default one per core. Results do not depend on it.
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Seed of every random draw.
    #[arg(long, global = true, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// No progress and no warnings; errors only.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Tone curve of the images; overrides the camera file's.
    #[arg(long, global = true, value_enum)]
    pub tone: Option<Tone>,
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

#[derive(Debug, Subcommand)]
pub enum Command {
    Calibrate(calibrate::CalibrateArgs),
    Template(template::TemplateArgs),
    Reconstruct(reconstruct::ReconstructArgs),
    Track(track::TrackArgs),
    Options(options::OptionsArgs),
    Inspect(inspect::InspectArgs),
    Evaluate(evaluate::EvaluateArgs),
    Synth(synth::SynthArgs),
    Experiment(experiment::ExperimentArgs),
    Export(export::ExportArgs),
    Demo(demo::DemoArgs),
    View(view::ViewArgs),
    Figure(figure::FigureArgs),
}
