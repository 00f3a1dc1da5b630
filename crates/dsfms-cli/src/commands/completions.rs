//! `dsfms completions` and `dsfms man`: what an installation puts beside the program.

use crate::exit::Outcome;
use crate::outputs::prepare_folder;
use crate::stdout::to_stdout;
use anyhow::Context;
use clap::{Args, Command};
use clap_complete::Shell;
use dsfms::io::atomic::write_atomic;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  dsfms completions bash > ~/.local/share/bash-completion/completions/dsfms
  dsfms completions zsh > ~/.zfunc/_dsfms
  dsfms completions fish > ~/.config/fish/completions/dsfms.fish";

/// Print the completions of a shell.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct CompletionsArgs {
    /// The shell.
    #[arg(value_enum, value_name = "SHELL")]
    shell: Shell,
}

const MAN_EXAMPLES: &str = "\
Examples:
  dsfms man ~/.local/share/man/man1";

/// Write a manual page of every command, dsfms.1, dsfms-template.1 and so on.
#[derive(Debug, Args)]
#[command(after_long_help = MAN_EXAMPLES)]
pub struct ManArgs {
    /// Folder for the pages.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Run `completions`.
pub fn run(args: &CompletionsArgs, root: &mut Command) -> anyhow::Result<Outcome> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, root, "dsfms", &mut text);
    to_stdout(&String::from_utf8_lossy(&text))?;
    Ok(Outcome::Ok)
}

/// Run `man`.
pub fn man(args: &ManArgs, mut root: Command) -> anyhow::Result<Outcome> {
    prepare_folder(&args.folder)?;
    // Global options come to the commands here.
    root.build();
    let mut open = vec![("dsfms".to_string(), root)];
    while let Some((name, command)) = open.pop() {
        let below = command.get_subcommands().filter(|c| c.get_name() != "help");
        open.extend(below.map(|c| (format!("{name}-{}", c.get_name()), c.clone())));
        let mut page = Vec::new();
        clap_mangen::Man::new(command.name(name.clone()).disable_help_subcommand(true))
            .render(&mut page)
            .with_context(|| format!("cannot write the page of {name}"))?;
        write_atomic(&args.folder.join(format!("{name}.1")), |w| w.write_all(&page))?;
    }
    Ok(Outcome::Ok)
}
