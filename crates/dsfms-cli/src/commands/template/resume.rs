//! What a template's stages leave beside the output, so that a run that was stopped goes on.

use crate::build;
use crate::interrupt;
use crate::progress::Reporter;
use dsfms::checkpoint::{Store, WriteValue};
use dsfms::io::checkpoint::{Kept, StageFolder};
use dsfms::pipeline::Progress;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The stages kept in `OUT.partial`, and the progress of the run.
pub struct Resumable<'a> {
    /// `None` where this build cannot be told from others.
    folder: Option<StageFolder>,
    pub reporter: &'a Reporter,
    state: Mutex<ResumeState>,
}

#[derive(Default)]
struct ResumeState {
    /// What is to be told of a run that goes on, once it works again.
    resumed: Option<String>,
    kept: BTreeSet<String>,
}

/// `organ.template.partial` for `organ.template`.
fn beside(output: &Path) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(".partial");
    name.into()
}

impl<'a> Resumable<'a> {
    /// Nothing is made yet.
    pub fn new(output: &Path, reporter: &'a Reporter) -> Self {
        interrupt::advise("no stage was finished; the same command begins anew");
        let output = output.components().collect::<PathBuf>();
        let folder = build::number().ok().map(|build| StageFolder::new(&beside(&output), &build));
        Self { folder, reporter, state: Mutex::default() }
    }

    fn lock(&self) -> MutexGuard<'_, ResumeState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The template is there.
    pub fn done(&self) {
        let Some(folder) = &self.folder else { return };
        if let Err(error) = folder.remove() {
            let text =
                format!("{} is no longer needed, but stays: {error}", folder.path().display());
            self.reporter.warn(&text);
        }
    }

    /// There will be no template from this input and these options: poses, which took long, serve
    /// other options of the surface; without them nothing is worth keeping.
    pub fn failed(&self) {
        if !self.lock().kept.iter().any(|stage| stage.starts_with("poses")) {
            return self.done();
        }
        if let Some(folder) = &self.folder {
            let place = folder.path().display();
            self.reporter.say(&format!(
                "camera poses are kept in {place}: the same frames with other options of organ or surface go on from \
                 there"
            ));
        }
    }

    fn note(&self, stage: &str) {
        let mut state = self.lock();
        state.kept.insert(stage.to_owned());
        if let Some(folder) = &self.folder {
            let kept: Vec<&str> = state.kept.iter().map(String::as_str).collect();
            let (list, place) = (kept.join(", "), folder.path().display());
            interrupt::advise(format!(
                "{list} are kept in {place}: the same command goes on from there"
            ));
        }
    }
}

impl Store for Resumable<'_> {
    fn load(&self, stage: &str, key: u64) -> Option<Vec<u8>> {
        match self.folder.as_ref()?.load(stage, key) {
            Kept::Value(value) => Some(value),
            Kept::Nothing => None,
            Kept::Damaged(path) => {
                self.reporter.warn(&format!("{} is damaged and not used", path.display()));
                None
            }
        }
    }

    fn save(&self, stage: &str, key: u64, value: WriteValue) {
        let Some(folder) = &self.folder else { return };
        match folder.save(stage, key, value) {
            Ok(()) => self.note(stage),
            Err(error) => self.reporter.warn(&format!("{stage} is not kept: {error}")),
        }
    }

    fn used(&self, stage: &str, frames: usize) {
        self.lock().resumed = Some(format!("resumed after {stage} ({frames} frames)"));
        self.note(stage);
    }

    fn refused(&self, stage: &str) {
        self.reporter
            .warn(&format!("what was kept of {stage} does not fit its frames and is not used"));
    }
}

impl Progress for Resumable<'_> {
    fn step(&self, stage: &str, done: usize, total: usize) {
        let resumed = self.lock().resumed.take();
        if let Some(text) = resumed {
            self.reporter.say(&text);
        }
        self.reporter.step(stage, done, total);
    }

    fn note(&self, summary: &str) {
        self.reporter.note(summary);
    }

    fn warn(&self, message: &str) {
        self.reporter.warn(message);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_lies_beside_the_output() {
        let reporter = Reporter::new(true, crate::progress::ProgressKind::Lines, false);
        for output in ["a/organ.template", "a/organ.template/"] {
            let resumable = Resumable::new(Path::new(output), &reporter);
            let path = resumable.folder.as_ref().map(|f| f.path().to_owned());
            assert_eq!(path, Some(PathBuf::from("a/organ.template.partial")));
        }
    }
}
