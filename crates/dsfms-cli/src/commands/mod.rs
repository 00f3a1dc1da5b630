//! One file per subcommand.

pub mod calibrate;
pub mod completions;
pub mod demo;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod figure;
pub mod inspect;
pub mod options;
pub mod reconstruct;
pub mod register_ct;
pub mod replay;
mod scale;
pub mod synth;
pub mod template;
pub mod track;
pub mod view;

use crate::args::Global;
use crate::cli::{Arguments, Command, command};
use crate::exit::Outcome;
use crate::progress::Reporter;
use crate::{cores::start_threads, interrupt, log};
use anyhow::Context;
use clap::FromArgMatches;

/// Run the command that was asked for.
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
fn tracked(line: &[&str]) -> anyhow::Result<(track::TrackArgs, Global)> {
    let parsed = command().try_get_matches_from(line);
    let parsed = parsed.and_then(|found| Arguments::from_arg_matches(&found));
    let Arguments { global, command } =
        parsed.map_err(|error| anyhow::anyhow!("run.json: its command line: {error}"))?;
    match command {
        Command::Track(args) => Ok((args, global)),
        _ => anyhow::bail!("run.json is of another command than track"),
    }
}

/// Print a result; a reader that closed the pipe is no error.
pub fn to_stdout(text: &str) -> anyhow::Result<()> {
    use std::io::{ErrorKind, Write};
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}
