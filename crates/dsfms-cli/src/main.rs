//! The command line of dsfms: one file per subcommand, no mathematics.

/// As that of the standard library, but a reader of standard error who goes away (`2>&1 | head`) ends no run.
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

use clap::FromArgMatches;
use std::process::ExitCode;

/// Whether this CPU has what the program was compiled for; without the question it would die of an
/// illegal instruction. The standard library's own test is no question where the compiler may use AVX2
/// everywhere: it is true at compile time.
fn cpu_suits() -> bool {
    let asked = cfg!(all(target_arch = "x86_64", target_feature = "avx2"));
    !asked || std::fs::read_to_string("/proc/cpuinfo").map_or(true, |text| has_avx2(&text))
}

/// Whether the first CPU of `/proc/cpuinfo` lists AVX2, FMA and BMI2; true where it lists nothing.
fn has_avx2(cpuinfo: &str) -> bool {
    let Some(flags) = cpuinfo.lines().find(|line| line.starts_with("flags")) else { return true };
    ["avx2", "fma", "bmi2"].iter().all(|name| flags.split_whitespace().any(|flag| flag == *name))
}

fn main() -> ExitCode {
    if !cpu_suits() {
        eprintln!(
            "error: this build needs a CPU with AVX2 and FMA (2013 and later); build it with \
             RUSTFLAGS=\"-C target-cpu=x86-64\", or take the release archive, which has both"
        );
        return ExitCode::FAILURE;
    }
    dsfms::guard::quiet_hook();
    let parsed = args::command().try_get_matches();
    let arguments = match parsed.and_then(|found| args::Arguments::from_arg_matches(&found)) {
        Ok(arguments) => arguments,
        Err(error) => return exit::parse_error(&error),
    };
    exit::code(commands::run(&arguments))
}

#[cfg(test)]
mod tests {
    use super::has_avx2;

    #[test]
    fn an_old_cpu_is_told_before_it_stumbles() {
        assert!(has_avx2("processor : 0\nflags : fpu fma avx avx2 bmi1 bmi2\n"));
        assert!(!has_avx2("processor : 0\nflags : fpu avx bmi2 fma4\n"));
        assert!(has_avx2("model name : of no flags\n"));
    }
}
