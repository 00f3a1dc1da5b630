//! The command line of dsfms: one file per subcommand, no mathematics.

/// As that of the standard library, but a reader of standard error who goes away (`2>&1 | head`)
/// ends no run.
macro_rules! eprintln {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($text)*);
    }};
}

/// Likewise.
macro_rules! eprint {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = write!(std::io::stderr(), $($text)*);
    }};
}

mod args;
mod build;
mod chart;
mod cli;
mod commands;
mod cores;
mod cpu;
mod demo;
mod draw;
mod exit;
mod figure;
mod formats;
mod frame_args;
mod inputs;
mod interrupt;
mod log;
mod memory;
mod outputs;
mod pictures;
mod place;
mod poses;
mod progress;
mod reasons;
mod report;
mod run;
mod sheet;
mod stdout;
mod structures;
mod volume;

use clap::FromArgMatches;
use std::process::ExitCode;

fn main() -> ExitCode {
    cpu::hand_over();
    if !cpu::suits() {
        eprintln!(
            "error: this build needs a CPU with AVX2 and FMA (2013 and later); build it with \
             RUSTFLAGS=\"-C target-cpu=x86-64\", or take the release archive, which has both"
        );
        return ExitCode::FAILURE;
    }
    dsfms::guard::quiet_hook();
    let parsed = cli::command().try_get_matches();
    let arguments = match parsed.and_then(|found| cli::Arguments::from_arg_matches(&found)) {
        Ok(arguments) => arguments,
        Err(error) => return exit::parse_error(&error),
    };
    let ended = exit::code(run::run(&arguments));
    interrupt::code().unwrap_or(ended)
}
