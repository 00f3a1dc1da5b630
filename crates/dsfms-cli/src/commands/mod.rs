//! One file per subcommand.

pub mod demo;
pub mod evaluate;
pub mod inspect;
pub mod reconstruct;
pub mod template;

use crate::args::{Arguments, Command};
use crate::exit::Outcome;
use crate::progress::Reporter;
use anyhow::Context;

/// Run the command that was asked for.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let global = &arguments.global;
    if let Some(threads) = global.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .build_global()
            .context("cannot start the worker threads")?;
    }
    let reporter = Reporter::new(global.quiet);
    let result = match &arguments.command {
        Command::Template(args) => template::run(args, global, &reporter),
        Command::Reconstruct(args) => reconstruct::run(args, global, &reporter),
        Command::Inspect(args) => inspect::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Demo(args) => demo::run(args, global, &reporter),
    };
    reporter.finish();
    result
}
