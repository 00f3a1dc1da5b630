//! `dsfms options`: the options file of a command, with its defaults and their documentation.

use crate::exit::Outcome;
use crate::stdout::to_stdout;
use clap::{Args, ValueEnum};
use dsfms::pipeline::{ReconstructOptions, TemplateOptions};
use dsfms::track::TrackOptions;

const EXAMPLES: &str = "\
Examples:
  dsfms options reconstruct > options.toml
  dsfms reconstruct organ.template deformed/ --camera camera.json \\
      --options options.toml -o out";

/// Print the options file of a command: every weight and threshold with its default, explained.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct OptionsArgs {
    /// The command whose --options takes the file.
    #[arg(value_enum, value_name = "COMMAND")]
    command: Optioned,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Optioned {
    /// `dsfms template`.
    Template,
    /// `dsfms reconstruct` (and `experiment`).
    Reconstruct,
    /// `dsfms track`.
    Track,
}

/// Run the command.
pub fn run(args: &OptionsArgs) -> anyhow::Result<Outcome> {
    to_stdout(&match args.command {
        Optioned::Template => TemplateOptions::commented(),
        Optioned::Reconstruct => ReconstructOptions::commented(),
        Optioned::Track => TrackOptions::commented(),
    })?;
    Ok(Outcome::Ok)
}
