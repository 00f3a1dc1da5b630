//! Time and reports of the stages.

use super::StageReport;
use crate::solver::Summary;
use std::time::Instant;

/// Times stages and keeps their reports.
#[derive(Default)]
pub(super) struct StageLog {
    pub(super) stages: Vec<StageReport>,
}

impl StageLog {
    pub(super) fn time<T>(&mut self, name: &str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let value = work();
        let seconds = start.elapsed().as_secs_f64();
        self.stages.push(StageReport { name: name.to_owned(), seconds, summary: None });
        value
    }

    pub(super) fn attach(&mut self, summary: &Summary) {
        if let Some(last) = self.stages.last_mut() {
            last.summary = Some(summary.clone());
        }
    }
}
