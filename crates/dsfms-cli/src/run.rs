//! The command that was asked for.

use crate::args::Global;
use crate::cli::{Arguments, Command, command};
use crate::commands::track::TrackArgs;
use crate::commands::{
    calibrate, completions, demo, evaluate, experiment, export, figure, inspect, options,
    reconstruct, register_ct, replay, synth, template, track, view,
};
use crate::cores::start_threads;
use crate::exit::Outcome;
use crate::progress::Reporter;
use crate::{interrupt, log};
use anyhow::Context;
use clap::FromArgMatches;

/// Run it.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let global = &arguments.global;
    let live = matches!(&arguments.command, Command::Track(args) if args.realtime);
    start_threads(global.threads.map(usize::from), live)
        .context("cannot start the worker threads")?;
    let logged = log::start(global.verbose, global.progress)?;
    let reporter = Reporter::new(global.quiet, global.progress, logged);
    interrupt::watch(reporter.teller());
    let result = match &arguments.command {
        Command::Calibrate(args) => calibrate::run(args, global, &reporter),
        Command::Template(args) => template::run(args, global, &reporter),
        Command::Reconstruct(args) => reconstruct::run(args, global, &reporter),
        Command::Track(args) => track::run(args, global, &reporter),
        Command::Replay(args) => replay::run(args, &tracked, &reporter),
        Command::RegisterCt(args) => register_ct::run(args, global, &reporter),
        Command::Options(args) => options::run(args),
        Command::Inspect(args) => inspect::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Experiment(args) => experiment::run(args, global, &reporter),
        Command::Synth(args) => synth::run(args, global, &reporter),
        Command::Export(args) => export::run(args, global, &reporter),
        Command::Demo(args) => demo::run(args, global, &reporter),
        Command::View(args) => view::run(args),
        Command::Figure(args) => figure::run(args, &reporter),
        Command::Completions(args) => completions::run(args, &mut command()),
        Command::Man(args) => completions::man(args, command()),
    };
    reporter.finish();
    result
}

/// The arguments of a command line of `dsfms track` that a run has kept.
fn tracked(line: &[&str]) -> anyhow::Result<(TrackArgs, Global)> {
    let parsed = command().try_get_matches_from(line);
    let parsed = parsed.and_then(|found| Arguments::from_arg_matches(&found));
    let Arguments { global, command } =
        parsed.map_err(|error| anyhow::anyhow!("run.json: its command line: {error}"))?;
    match command {
        Command::Track(args) => Ok((args, global)),
        _ => anyhow::bail!("run.json is of another command than track"),
    }
}
