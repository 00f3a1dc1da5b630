//! Progress on stderr: bars on a terminal, one line per stage elsewhere.

use dsfms::pipeline::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;

/// Where progress and warnings go.
pub struct Reporter {
    quiet: bool,
    terminal: bool,
    /// The stage being shown.
    current: Mutex<Option<(String, ProgressBar)>>,
}

impl Reporter {
    pub fn new(quiet: bool) -> Self {
        Self { quiet, terminal: std::io::stderr().is_terminal(), current: Mutex::new(None) }
    }

    /// A line that the user should see, with the bar out of its way.
    pub fn say(&self, message: &str) {
        if self.quiet {
            return;
        }
        match &*self.lock() {
            Some((_, bar)) => bar.suspend(|| eprintln!("{message}")),
            None => eprintln!("{message}"),
        }
    }

    /// Something that failed; `--quiet` does not silence it.
    pub fn error(&self, message: &str) {
        let message = format!("error: {message}");
        match &*self.lock() {
            Some((_, bar)) => bar.suspend(|| eprintln!("{message}")),
            None => eprintln!("{message}"),
        }
    }

    /// End the stage being shown.
    pub fn finish(&self) {
        if let Some((_, bar)) = self.lock().take() {
            bar.finish();
        }
    }

    /// A poisoned lock only means that another thread stopped while drawing.
    fn lock(&self) -> std::sync::MutexGuard<'_, Option<(String, ProgressBar)>> {
        self.current.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn bar(&self, stage: &str, total: usize) -> ProgressBar {
        if !self.terminal {
            eprintln!("{stage}");
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::new(total as u64).with_message(stage.to_string());
        let template = "{msg:32} {bar:30} {pos}/{len} {elapsed}";
        bar.with_style(
            ProgressStyle::with_template(template).unwrap_or(ProgressStyle::default_bar()),
        )
    }
}

impl Progress for Reporter {
    fn step(&self, stage: &str, done: usize, total: usize) {
        if self.quiet {
            return;
        }
        let mut current = self.lock();
        if current.as_ref().is_none_or(|(name, _)| name != stage) {
            if let Some((_, bar)) = current.take() {
                bar.finish();
            }
            *current = Some((stage.to_string(), self.bar(stage, total)));
        }
        if let Some((_, bar)) = &*current {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
        }
    }

    fn warn(&self, message: &str) {
        self.say(&format!("warning: {message}"));
    }
}
