//! Progress on stderr: a bar on a terminal, a line every ten seconds elsewhere, or JSON for
//! programs.

use clap::ValueEnum;
use dsfms::pipeline::Progress;
use serde_json::json;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// How progress is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ProgressKind {
    /// A bar on a terminal, lines elsewhere.
    #[default]
    Auto,
    /// Lines: at the start and the end of a stage, and every ten seconds.
    Lines,
    /// A line of JSON each second and at the ends of a stage: stage, done, total, seconds, left; or
    /// warning, error, message.
    Json,
}

/// Says lines beside the progress, from another thread.
#[cfg_attr(not(unix), expect(dead_code, reason = "signals are watched on Unix"))]
pub struct Teller(Arc<Shared>);

#[cfg_attr(not(unix), expect(dead_code, reason = "signals are watched on Unix"))]
impl Teller {
    /// A line that the user waits for; `--quiet` does not silence it.
    pub fn tell(&self, message: &str) {
        self.0.print("message", message);
    }
}

/// Where progress and warnings go.
pub struct Reporter {
    quiet: bool,
    shared: Arc<Shared>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Style {
    Bar,
    Lines,
    Json,
}

struct Shared {
    style: Style,
    /// The stage being shown.
    current: Mutex<Option<Stage>>,
}

/// One stage and how far it is.
struct Stage {
    name: String,
    done: usize,
    total: usize,
    started: Instant,
    /// When it was last told of.
    told: Instant,
}

impl Style {
    /// A stage is told of no more often than this.
    fn every(self) -> Duration {
        match self {
            Self::Bar => Duration::from_millis(50),
            Self::Lines => Duration::from_secs(10),
            Self::Json => Duration::from_secs(1),
        }
    }
}

/// Back to the start of the line, and away with it.
const CLEAR: &str = "\r\x1b[2K";
/// Time moves on a terminal though nothing else does.
const TICK: Duration = Duration::from_millis(500);
/// A stage that took less tells no time left, which would only jump.
const SETTLED: f64 = 3.0;
/// A stage that ended sooner needs no line at its end.
const BRIEF: f64 = 1.0;

impl Stage {
    fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Seconds until the end at the pace so far; `None` where there is none yet.
    fn left(&self, seconds: f64) -> Option<f64> {
        let known = self.done > 0 && self.done < self.total && seconds >= SETTLED;
        known.then(|| seconds / self.done as f64 * (self.total - self.done) as f64)
    }

    fn bar(&self) -> String {
        const WIDTH: usize = 24;
        let Self { name, done, total, .. } = self;
        let filled = (WIDTH * done / total.max(&1)).min(WIDTH);
        let seconds = self.seconds();
        let (bar, rest) = ("#".repeat(filled), "-".repeat(WIDTH - filled));
        let left = self.left(seconds).map_or(String::new(), |s| format!(", {} left", clock(s)));
        format!("{name:24} {bar}{rest} {done}/{total} {}{left}", clock(seconds))
    }

    /// How far it is, as a line.
    fn line(&self, seconds: f64) -> String {
        let Self { name, done, total, .. } = self;
        let left = self.left(seconds).map_or(String::new(), |s| format!(", {} left", clock(s)));
        format!("{name}: {done}/{total}, {}{left}", clock(seconds))
    }

    fn json(&self, ended: bool) -> String {
        let seconds = self.seconds();
        json!({
            "stage": self.name, "done": self.done, "total": self.total, "ended": ended,
            "seconds": (seconds * 1e3).round() / 1e3, "left": self.left(seconds).map(f64::round),
        })
        .to_string()
    }
}

/// `1:05`.
fn clock(seconds: f64) -> String {
    let seconds = seconds.round() as u64;
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

impl Shared {
    /// A poisoned lock only means that another thread stopped while drawing.
    fn lock(&self) -> MutexGuard<'_, Option<Stage>> {
        self.current.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn begin(&self, stage: &Stage) {
        match self.style {
            Style::Bar => eprint!("{CLEAR}{}", stage.bar()),
            Style::Lines => eprintln!("{}", stage.name),
            Style::Json => eprintln!("{}", stage.json(false)),
        }
    }

    fn tell(&self, stage: &mut Stage) {
        stage.told = Instant::now();
        match self.style {
            Style::Bar => eprint!("{CLEAR}{}", stage.bar()),
            Style::Lines => eprintln!("{}", stage.line(stage.seconds())),
            Style::Json => eprintln!("{}", stage.json(false)),
        }
    }

    /// Leave what was told as it is and go to the next line.
    fn close(&self, stage: &Stage) {
        match self.style {
            Style::Bar => eprintln!("{CLEAR}{}", stage.bar()),
            Style::Lines if stage.seconds() >= BRIEF => {
                eprintln!("{}: {} in {}", stage.name, stage.done, clock(stage.seconds()));
            }
            Style::Lines => {}
            Style::Json => eprintln!("{}", stage.json(true)),
        }
    }

    fn print(&self, kind: &str, message: &str) {
        let prefix = if kind == "message" { String::new() } else { format!("{kind}: ") };
        match (self.style, &*self.lock()) {
            (Style::Json, _) => {
                let mut line = serde_json::Map::new();
                line.insert(kind.into(), message.into());
                eprintln!("{}", serde_json::Value::from(line));
            }
            (Style::Bar, Some(stage)) => eprint!("{CLEAR}{prefix}{message}\n{}", stage.bar()),
            _ => eprintln!("{prefix}{message}"),
        }
    }
}

/// Tell of a stage in which nothing is reported, until the reporter is gone.
fn tick(shared: &Weak<Shared>) {
    loop {
        std::thread::sleep(TICK);
        let Some(shared) = shared.upgrade() else { return };
        if let Some(stage) = &mut *shared.lock()
            && stage.told.elapsed() >= shared.style.every()
        {
            shared.tell(stage);
        }
    }
}

impl Reporter {
    /// With a `log` among them, lines rather than a bar, which it would tear.
    pub fn new(quiet: bool, kind: ProgressKind, log: bool) -> Self {
        let style = match kind {
            ProgressKind::Json => Style::Json,
            ProgressKind::Auto if !log && std::io::stderr().is_terminal() => Style::Bar,
            ProgressKind::Auto | ProgressKind::Lines => Style::Lines,
        };
        let shared = Arc::new(Shared { style, current: Mutex::new(None) });
        if !quiet {
            let weak = Arc::downgrade(&shared);
            // Without it the time stands still; the work does not.
            let _ = std::thread::Builder::new().spawn(move || tick(&weak));
        }
        Self { quiet, shared }
    }

    /// For another thread.
    pub fn teller(&self) -> Teller {
        Teller(self.shared.clone())
    }

    /// A line that the user should see, with the bar out of its way.
    pub fn say(&self, message: &str) {
        if !self.quiet {
            self.shared.print("message", message);
        }
    }

    /// Something that failed; `--quiet` does not silence it.
    pub fn error(&self, message: &str) {
        self.shared.print("error", message);
    }

    /// End the stage being shown.
    pub fn finish(&self) {
        if let Some(stage) = self.shared.lock().take() {
            self.shared.close(&stage);
        }
    }
}

impl Progress for Reporter {
    fn step(&self, stage: &str, done: usize, total: usize) {
        if self.quiet {
            return;
        }
        let mut current = self.shared.lock();
        if current.as_ref().is_none_or(|shown| shown.name != stage) {
            if let Some(last) = current.take() {
                self.shared.close(&last);
            }
            let now = Instant::now();
            let new = Stage { name: stage.to_owned(), done, total, started: now, told: now };
            self.shared.begin(&new);
            *current = Some(new);
            return;
        }
        if let Some(shown) = &mut *current {
            (shown.done, shown.total) = (done, total);
            if shown.told.elapsed() >= self.shared.style.every() {
                self.shared.tell(shown);
            }
        }
    }

    fn note(&self, summary: &str) {
        self.say(summary);
    }

    fn warn(&self, message: &str) {
        if !self.quiet {
            self.shared.print("warning", message);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(done: usize, total: usize, seconds: u64) -> Stage {
        let now = Instant::now();
        let started = now.checked_sub(Duration::from_secs(seconds)).unwrap_or(now);
        Stage { name: "frames".into(), done, total, started, told: now }
    }

    #[test]
    fn a_bar_tells_name_share_and_time_and_fits_a_narrow_terminal() {
        let bar = stage(3, 12, 0).bar();
        assert!(bar.starts_with("frames   ") && bar.ends_with(" 3/12 0:00"), "{bar}");
        assert_eq!((bar.matches('#').count(), bar.matches('-').count()), (6, 18));
        assert!(stage(1200, 12000, 4000).bar().len() < 80);
        // No total, and more than there should be.
        assert_eq!(stage(0, 0, 0).bar().matches('#').count(), 0);
        assert_eq!(stage(9, 4, 0).bar().matches('#').count(), 24);
    }

    #[test]
    fn the_time_left_follows_from_the_pace() {
        assert_eq!(stage(3, 12, 30).line(30.0), "frames: 3/12, 0:30, 1:30 left");
        // Nothing to tell it by: too early, nothing done, all done.
        for (done, seconds) in [(3, 1.0), (0, 30.0), (12, 30.0)] {
            assert_eq!(stage(done, 12, 0).left(seconds), None);
        }
        let line: serde_json::Value = serde_json::from_str(&stage(3, 12, 30).json(false)).unwrap();
        assert_eq!((line["stage"].as_str(), line["done"].as_u64()), (Some("frames"), Some(3)));
        assert_eq!(line["left"].as_f64(), Some(90.0));
    }
}
