//! Where results go, and with which options the methods run.

use crate::inputs;
use crate::outputs::check_folder;
use crate::place::mark;
use clap::Args;
use dsfms::pipeline::ReconstructOptions;
use std::path::PathBuf;

/// Where results go, and with which options the methods run.
#[derive(Debug, Args)]
pub struct PlaceArgs {
    /// Weights and thresholds of the methods, as `dsfms reconstruct --options` takes them.
    #[arg(long, value_name = "FILE")]
    options: Option<PathBuf>,
    /// Folder for the results.
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Drop the results that are already there.
    #[arg(long)]
    restart: bool,
}

impl PlaceArgs {
    /// Refuse a folder with files of others that have our names; else mark it, and with --restart
    /// remove what an older run left.
    pub fn take(&self, ours: fn(&str) -> bool) -> anyhow::Result<()> {
        mark::check_names(&self.output, &["experiment"], "-o", ours)?;
        check_folder(&self.output)?;
        mark::claim(&self.output, "experiment")?;
        if self.restart { mark::remove(&self.output, ours) } else { Ok(()) }
    }

    pub fn options(&self) -> anyhow::Result<ReconstructOptions> {
        let Some(path) = &self.options else { return Ok(ReconstructOptions::default()) };
        inputs::options(path, ReconstructOptions::from_toml)
    }
}
