//! What a run was: `OUT/run.json`, by which `dsfms replay` does it again.

use super::args::TrackArgs;
use crate::args::VERSION;
use crate::inputs;
use crate::outputs::write_json;
use anyhow::Context;
use dsfms::checkpoint::Digest;
use dsfms::guard;
use dsfms::track::TrackOptions;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Its name in the output folder.
pub const NAME: &str = "run.json";

/// Most bytes of it: three million frames, thirty hours of a live source. What it is parsed to
/// takes up to eight times as much.
const MOST_BYTES: u64 = 128 << 20;

/// A run of `dsfms track`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunFile {
    /// Version and commit of the program.
    pub version: String,
    /// What it was compiled for; the bits of its results depend on it.
    pub target: String,
    /// The folder that relative paths start at.
    pub folder: PathBuf,
    /// The command line without the program.
    pub arguments: Vec<String>,
    /// All options, the seed among them.
    pub options: TrackOptions,
    /// Digest of the files of the template.
    pub template: String,
    /// Digest of the camera file; `None`: the template's camera.
    pub camera: Option<String>,
    /// Digest of the poses that give a mesh its look.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<String>,
    /// The frames that were taken, in order.
    pub frames: Vec<Taken>,
}

/// One frame of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Taken {
    /// Its number in the source.
    pub number: usize,
    /// Why it could not be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unread: Option<String>,
    /// What was said of it besides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reserved: Option<String>,
    /// What the search beside the video found was taken in it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub answered: bool,
}

impl RunFile {
    /// A run that is about to begin.
    pub fn of(args: &TrackArgs, options: &TrackOptions) -> anyhow::Result<Self> {
        let arguments = std::env::args_os().skip(1);
        Ok(Self {
            version: VERSION.into(),
            target: target(),
            folder: std::env::current_dir().context("the current folder")?,
            arguments: arguments.map(|a| a.to_string_lossy().into_owned()).collect(),
            options: options.clone(),
            template: digest(&args.template)?,
            camera: args.frames.camera.as_deref().map(digest).transpose()?,
            poses: args.poses.as_deref().map(digest).transpose()?,
            frames: Vec::new(),
        })
    }

    /// Write it into the output folder.
    pub fn write(&self, output: &Path) -> anyhow::Result<()> {
        write_json(&output.join(NAME), self)
    }

    /// Read that of an output folder.
    pub fn read(output: &Path) -> anyhow::Result<Self> {
        let path = output.join(NAME);
        inputs::must_exist(output, "OUT")?;
        anyhow::ensure!(
            path.is_file(),
            "{} holds no {NAME}, so it cannot be replayed; give the output folder of `dsfms track`",
            output.display()
        );
        let text = guard::read_text_at_most(&path, MOST_BYTES)
            .with_context(|| path.display().to_string())?;
        serde_json::from_str(&text).with_context(|| path.display().to_string())
    }
}

/// What this program is compiled for.
pub fn target() -> String {
    let fast = if crate::cpu::FAST { ", AVX2 and FMA" } else { "" };
    format!("{}-{}{fast}", std::env::consts::ARCH, std::env::consts::OS)
}

/// Digest of a file, or of the names and contents of the files of a folder, 16 hexadecimal digits:
/// it tells a change, not a forgery.
pub fn digest(path: &Path) -> anyhow::Result<String> {
    let mut state = Digest::default();
    add(path, &mut state).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(format!("{:016x}", state.finish()))
}

fn add(path: &Path, state: &mut Digest) -> std::io::Result<()> {
    if !path.is_dir() {
        state.bytes(&guard::read(path)?);
        return Ok(());
    }
    let entries: std::io::Result<Vec<_>> = std::fs::read_dir(path)?.collect();
    let mut paths: Vec<PathBuf> = entries?.iter().map(std::fs::DirEntry::path).collect();
    paths.sort();
    for path in paths {
        state.bytes(path.file_name().unwrap_or_default().to_string_lossy().as_bytes());
        add(&path, state)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_tells_contents_and_names() {
        let folder = tempfile::tempdir().unwrap();
        let of = || digest(folder.path()).unwrap();
        std::fs::write(folder.path().join("a"), "1").unwrap();
        let first = of();
        assert_eq!(of(), first);
        std::fs::write(folder.path().join("a"), "2").unwrap();
        assert_ne!(of(), first);
        std::fs::rename(folder.path().join("a"), folder.path().join("b")).unwrap();
        std::fs::write(folder.path().join("b"), "1").unwrap();
        assert_ne!(of(), first);
        assert!(digest(&folder.path().join("none")).is_err());
    }

    #[test]
    fn a_frame_says_only_what_there_is_to_say() {
        let taken =
            Taken { number: 3, unread: None, reserved: Some("why".into()), answered: false };
        let text = serde_json::to_string(&taken).unwrap();
        assert_eq!(text, r#"{"number":3,"reserved":"why"}"#);
        assert_eq!(serde_json::from_str::<Taken>(&text).unwrap(), taken);
        let error = RunFile::read(tempfile::tempdir().unwrap().path()).unwrap_err().to_string();
        assert!(error.contains("run.json"), "{error}");
    }

    #[test]
    fn a_run_file_of_more_than_its_bound_is_not_parsed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(NAME);
        std::fs::File::create(&path).unwrap().set_len(MOST_BYTES + 1).unwrap();
        let error = format!("{:#}", RunFile::read(folder.path()).unwrap_err());
        assert!(error.contains("run.json") && error.contains("128 MiB"), "{error}");
    }
}
