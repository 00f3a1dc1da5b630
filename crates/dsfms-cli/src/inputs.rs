//! Reading what a user points at, with the options of the command line.

use crate::args::Global;
use anyhow::Context;
use dsfms::io::InputError;
pub use dsfms::pipeline::inputs::{CameraInput, Purpose, Source, check_size, mask_of, sources};
use std::path::Path;

/// Read `--camera`; `--tone` counts more than what the file says.
pub fn camera(path: &Path, global: &Global) -> anyhow::Result<CameraInput> {
    CameraInput::read(path, global.tone.map(Into::into)).context("camera file")
}

/// Read an options file.
pub fn options<T, E>(path: &Path, parse: impl FnOnce(&str) -> Result<T, E>) -> anyhow::Result<T>
where
    E: std::error::Error + Send + Sync + 'static,
{
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read the options file {}", path.display()))?;
    parse(&text).with_context(|| format!("{} is not a valid options file", path.display()))
}

/// A path that must be there before any work begins.
pub fn must_exist(path: &Path, option: &str) -> anyhow::Result<()> {
    match path.exists() {
        true => Ok(()),
        false => Err(InputError::Missing(path.into())).context(option.to_string()),
    }
}
