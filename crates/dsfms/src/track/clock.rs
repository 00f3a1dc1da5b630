//! What the stages of a frame take.

use std::time::Instant;

/// Wall times.
#[derive(Default)]
pub(super) struct Clock(pub(super) Vec<(&'static str, f64)>);

impl Clock {
    pub(super) fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let value = work();
        self.0.push((name, start.elapsed().as_secs_f64()));
        value
    }

    /// What was waited for took this.
    pub(super) fn add(&mut self, other: Self) {
        self.0.extend(other.0);
    }
}
