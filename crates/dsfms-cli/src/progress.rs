//! Progress on stderr: bars on a terminal, one line per stage elsewhere.

use dsfms::pipeline::Progress;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Where progress and warnings go.
pub struct Reporter {
    quiet: bool,
    terminal: bool,
    /// The stage being shown.
    current: Mutex<Option<Stage>>,
}

/// One stage and how far it is.
struct Stage {
    name: String,
    done: usize,
    total: usize,
    started: Instant,
    drawn: Option<Instant>,
}

/// Bars are drawn no more often than this.
const EVERY: Duration = Duration::from_millis(50);

/// Back to the start of the line, and away with it.
const CLEAR: &str = "\r\x1b[2K";

impl Stage {
    fn bar(&self) -> String {
        const WIDTH: usize = 30;
        let Self { name, done, total, .. } = self;
        let filled = (WIDTH * done / total.max(&1)).min(WIDTH);
        let seconds = self.started.elapsed().as_secs();
        let (bar, rest) = ("#".repeat(filled), "-".repeat(WIDTH - filled));
        format!("{name:32} {bar}{rest} {done}/{total} {}:{:02}", seconds / 60, seconds % 60)
    }
}

impl Reporter {
    pub fn new(quiet: bool) -> Self {
        Self { quiet, terminal: std::io::stderr().is_terminal(), current: Mutex::new(None) }
    }

    /// A line that the user should see, with the bar out of its way.
    pub fn say(&self, message: &str) {
        if !self.quiet {
            self.print(message);
        }
    }

    /// Something that failed; `--quiet` does not silence it.
    pub fn error(&self, message: &str) {
        self.print(&format!("error: {message}"));
    }

    /// End the stage being shown.
    pub fn finish(&self) {
        if let Some(stage) = self.lock().take() {
            self.close(&stage);
        }
    }

    fn print(&self, message: &str) {
        match &*self.lock() {
            Some(stage) if self.terminal => eprint!("{CLEAR}{message}\n{}", stage.bar()),
            _ => eprintln!("{message}"),
        }
    }

    /// Leave the bar as it is and go to the next line.
    fn close(&self, stage: &Stage) {
        if self.terminal {
            eprintln!("{CLEAR}{}", stage.bar());
        }
    }

    /// A poisoned lock only means that another thread stopped while drawing.
    fn lock(&self) -> std::sync::MutexGuard<'_, Option<Stage>> {
        self.current.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Progress for Reporter {
    fn step(&self, stage: &str, done: usize, total: usize) {
        if self.quiet {
            return;
        }
        let mut current = self.lock();
        if current.as_ref().is_none_or(|shown| shown.name != stage) {
            if let Some(last) = current.take() {
                self.close(&last);
            }
            if !self.terminal {
                eprintln!("{stage}");
            }
            let (name, started) = (stage.to_owned(), Instant::now());
            *current = Some(Stage { name, done, total, started, drawn: None });
        }
        if let Some(shown) = &mut *current {
            (shown.done, shown.total) = (done, total);
            let due = shown.drawn.is_none_or(|at| at.elapsed() >= EVERY);
            if self.terminal && due {
                shown.drawn = Some(Instant::now());
                eprint!("{CLEAR}{}", shown.bar());
            }
        }
    }

    fn warn(&self, message: &str) {
        self.say(&format!("warning: {message}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_tells_name_share_and_time_and_fits_a_narrow_terminal() {
        let started = Instant::now();
        let stage =
            |done, total| Stage { name: "frames".into(), done, total, started, drawn: None };
        let bar = stage(3, 12).bar();
        assert!(bar.starts_with("frames   ") && bar.ends_with(" 3/12 0:00"), "{bar}");
        assert_eq!((bar.matches('#').count(), bar.matches('-').count()), (7, 23));
        assert!(stage(12, 12).bar().len() < 80);
        // No total, and more than there should be.
        assert_eq!(stage(0, 0).bar().matches('#').count(), 0);
        assert_eq!(stage(9, 4).bar().matches('#').count(), 30);
    }
}
