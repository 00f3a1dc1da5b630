//! The command line as clap reads it.

use crate::args::{Global, VERSION};
use crate::commands::{
    calibrate, completions, demo, evaluate, experiment, export, figure, inspect, options,
    reconstruct, register_ct, replay, synth, template, track, view,
};
use clap::{CommandFactory, Parser, Subcommand};

const EXIT_CODES: &str = "\
Exit codes:
  0   every frame is ok
  1   nothing was produced
  2   some frames are degraded or failed (their .json says why)
  64  wrong usage
  130, 143  stopped by Ctrl-C, by SIGTERM; what is kept is said";

/// Reconstruct a deforming organ in 3D from a monocular laparoscope, by motion and shading.
#[derive(Debug, Parser)]
#[command(name = "dsfms", version = VERSION, after_help = EXIT_CODES, arg_required_else_help = true)]
pub struct Arguments {
    #[command(flatten)]
    pub global: Global,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    Calibrate(calibrate::CalibrateArgs),
    Template(template::TemplateArgs),
    Reconstruct(reconstruct::ReconstructArgs),
    Track(track::TrackArgs),
    Replay(replay::ReplayArgs),
    RegisterCt(register_ct::RegisterCtArgs),
    Options(options::OptionsArgs),
    Inspect(inspect::InspectArgs),
    Evaluate(evaluate::EvaluateArgs),
    Synth(synth::SynthArgs),
    Experiment(experiment::ExperimentArgs),
    Export(export::ExportArgs),
    Demo(demo::DemoArgs),
    View(view::ViewArgs),
    Figure(figure::FigureArgs),
    Completions(completions::CompletionsArgs),
    Man(completions::ManArgs),
}

/// Commands that draw nothing at random and look at no image's brightness.
const WITHOUT_SEED_AND_TONE: [&str; 9] =
    ["replay", "inspect", "evaluate", "options", "export", "view", "figure", "completions", "man"];

/// Columns of the help.
const HELP: usize = 80;

/// The command line with only those global options in a command's help that it uses.
pub fn command() -> clap::Command {
    // Its examples are narrower. What a narrow terminal breaks by itself can still be copied as one
    // line.
    let command = Arguments::command().term_width(HELP);
    let unused = ["seed", "tone"];
    let hidden = command.get_arguments().filter(|arg| unused.contains(&arg.get_id().as_str()));
    // An option that a command has already is not given to it once more.
    let hidden: Vec<clap::Arg> = hidden.map(|arg| arg.clone().hide(true)).collect();
    WITHOUT_SEED_AND_TONE
        .iter()
        .fold(command, |command, name| command.mut_subcommand(name, |c| c.args(hidden.clone())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of an example that the terminal breaks cannot be pasted.
    #[test]
    fn help_fits_eighty_columns_and_knows_its_commands() {
        let mut command = command();
        command.clone().debug_assert();
        command.build();
        let names: Vec<String> =
            command.get_subcommands().map(|c| c.get_name().to_owned()).collect();
        for name in WITHOUT_SEED_AND_TONE {
            assert!(names.iter().any(|n| n == name), "{name}");
        }
        let mut open: Vec<&clap::Command> = command.get_subcommands().collect();
        while let Some(command) = open.pop() {
            let text = command.get_after_long_help().map(ToString::to_string).unwrap_or_default();
            let shown = command.clone().render_long_help().to_string();
            for line in text.lines() {
                assert!(shown.contains(line), "{}: broken: {line}", command.get_name());
                assert!(line.chars().count() < 80, "{}: {line}", command.get_name());
            }
            open.extend(command.get_subcommands());
        }
    }

    #[test]
    fn global_options_stand_last_and_alone() {
        let mut command = command();
        command.build();
        let mut help = |name: &str| {
            let found = command.find_subcommand_mut(name).unwrap();
            found.render_long_help().to_string()
        };
        let text = help("template");
        let places: Vec<usize> = ["\nInput:", "\nOrgan:", "\nOutput:", "\nGlobal options:"]
            .iter()
            .map(|heading| text.find(heading).unwrap_or_else(|| panic!("{heading}: {text}")))
            .collect();
        assert!(places.is_sorted(), "{text}");
        assert!(text[places[3]..].contains("--seed"), "{text}");
        assert!(!help("view").contains("--seed") && help("view").contains("--threads"));
    }
}
