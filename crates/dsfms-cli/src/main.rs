//! The command line of dsfms: one file per subcommand, no mathematics.

mod args;
mod commands;
mod demo;
mod draw;
mod exit;
mod figure;
mod formats;
mod inputs;
mod memory;
mod outputs;
mod pictures;
mod place;
mod progress;
mod reasons;
mod report;
mod structures;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    dsfms::guard::quiet_hook();
    let arguments = match args::Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return exit::parse_error(&error),
    };
    exit::code(commands::run(&arguments))
}
