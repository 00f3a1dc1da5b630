//! Progress with remaining time, also where there is no terminal to draw a bar on.

use crate::progress::Reporter;
use dsfms::pipeline::Progress;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Between two lines of progress.
const PAUSE: Duration = Duration::from_secs(30);

/// Passes progress on and says now and then how long it will take.
pub struct Paced<'a> {
    reporter: &'a Reporter,
    state: Mutex<Option<State>>,
}

struct State {
    start: Instant,
    /// Cases that were done before this run.
    before: usize,
    said: Instant,
}

impl<'a> Paced<'a> {
    pub fn new(reporter: &'a Reporter) -> Self {
        Self { reporter, state: Mutex::new(None) }
    }
}

impl Progress for Paced<'_> {
    fn step(&self, stage: &str, done: usize, total: usize) {
        self.reporter.step(stage, done, total);
        let mut state = self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let now = Instant::now();
        let state = state.get_or_insert(State { start: now, before: done, said: now });
        if done == state.before && done > 0 {
            self.reporter.say(&format!("{done} of {total} cases were done before"));
        } else if done > state.before && now - state.said >= PAUSE && done < total {
            state.said = now;
            let each = (now - state.start).as_secs_f64() / (done - state.before) as f64;
            let left = remaining(each * (total - done) as f64);
            self.reporter.say(&format!("{done} of {total} cases, {left} left"));
        }
    }

    fn warn(&self, message: &str) {
        self.reporter.warn(message);
    }
}

fn remaining(seconds: f64) -> String {
    match seconds.round() as u64 {
        s @ 0..120 => format!("{s} s"),
        s @ 120..7200 => format!("{} min", (s + 30) / 60),
        s => format!("{:.1} h", s as f64 / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn times_read_well() {
        for (seconds, text) in [(59.6, "60 s"), (150.0, "3 min"), (9000.0, "2.5 h")] {
            assert_eq!(super::remaining(seconds), text);
        }
    }
}
