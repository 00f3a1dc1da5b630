//! What the stages of a frame take.

use std::time::Instant;

/// Names of the stages that ran and their wall times, seconds, in order.
#[derive(Default)]
pub(super) struct Clock(pub(super) Vec<(&'static str, f64)>);

impl Clock {
    /// Do the work of a stage, and keep what it took.
    pub(super) fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let value = work();
        self.0.push((name, start.elapsed().as_secs_f64()));
        value
    }
}
