//! Working through a plan: all cores, one case at a time each, every finished case kept.

use super::record::{Finished, preamble, read};
use super::{Arm, ExperimentError, Plan, Record, SeriesOrgan, measure, surface};
use crate::io::atomic::write_atomic;
use crate::pipeline::Progress;
use crate::synth::{Case, Cell};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Run what is not yet in the file `results`, appending each case as it is finished, and give all
/// records in the order of cells, cases and arms. Each case runs on one thread, so the times are
/// those of one thread, and the figures are the same for any number of workers.
///
/// # Errors
/// Results of another plan in the file, an organ without a usable part, a file that cannot be
/// written.
pub fn run(
    plan: &Plan,
    organ: &SeriesOrgan,
    results: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Record>, ExperimentError> {
    let finished = read(results, plan)?;
    let file = open(results, plan, &finished)?;
    let cells = plan.cells();
    let missing: Vec<(usize, usize)> = (0..plan.count)
        .flat_map(|case| (0..cells.len()).map(move |cell| (cell, case)))
        .filter(|key| !finished.contains_key(key))
        .collect();
    let shared = Shared {
        plan,
        organ,
        progress,
        total: cells.len() * plan.count,
        done: AtomicUsize::new(finished.len()),
        next: AtomicUsize::new(0),
        state: Mutex::new(RunState { finished, file, error: None }),
    };
    progress.step("cases", shared.done.load(Ordering::Relaxed), shared.total);
    let workers = rayon::current_num_threads().min(missing.len());
    let pools: Vec<rayon::ThreadPool> = (0..workers)
        .map(|_| rayon::ThreadPoolBuilder::new().num_threads(1).build())
        .collect::<Result<_, _>>()?;
    std::thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| pool.install(|| shared.work(&cells, &missing, results)));
        }
    });
    let state = shared.state.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    match state.error {
        Some(error) => Err(error),
        None => Ok(state.finished.into_values().flatten().collect()),
    }
}

/// The file with what is finished and nothing else (a half-written case is dropped), to append to.
fn open(path: &Path, plan: &Plan, finished: &Finished) -> Result<File, ExperimentError> {
    let lines: String = finished.values().flatten().map(Record::line).collect();
    let text = preamble(plan) + &lines;
    write_atomic(path, |w| w.write_all(text.as_bytes()))
        .map_err(|error| ExperimentError::io(path, error.source))?;
    OpenOptions::new().append(true).open(path).map_err(|error| ExperimentError::io(path, error))
}

struct RunState {
    finished: Finished,
    file: File,
    error: Option<ExperimentError>,
}

/// What the workers share.
struct Shared<'a> {
    plan: &'a Plan,
    organ: &'a SeriesOrgan,
    progress: &'a dyn Progress,
    total: usize,
    done: AtomicUsize,
    next: AtomicUsize,
    state: Mutex<RunState>,
}

impl Shared<'_> {
    fn work(&self, cells: &[Cell], missing: &[(usize, usize)], path: &Path) {
        while let Some(&(cell, case)) = missing.get(self.next.fetch_add(1, Ordering::Relaxed)) {
            let outcome = self.case(cells[cell], case);
            let mut state = self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            let kept = outcome.and_then(|records| {
                let text: String = records.iter().map(Record::line).collect();
                state
                    .file
                    .write_all(text.as_bytes())
                    .map_err(|error| ExperimentError::io(path, error))?;
                state.finished.insert((cell, case), records);
                Ok(())
            });
            if let Err(error) = kept {
                state.error.get_or_insert(error);
            }
            if state.error.is_some() {
                return;
            }
            drop(state);
            let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
            self.progress.step("cases", done, self.total);
        }
    }

    fn case(&self, cell: Cell, index: usize) -> Result<Vec<Record>, ExperimentError> {
        let case = self.organ.case(&self.plan.protocol, cell, index)?;
        let moved = case.deformation.vertices.iter().zip(&case.template.mesh.positions);
        let amplitude = moved.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let arms = self.plan.arms.iter();
        let blank = |arm: &Arm| Record {
            cell,
            case: index,
            arm: arm.name.clone(),
            amplitude,
            mean_extension: 100.0 * case.deformation.extension,
            errors: None,
            seconds: 0.0,
            note: String::new(),
        };
        Ok(arms.map(|arm| solve(&case, arm, blank(arm))).collect())
    }
}

/// Fill a record with what a method makes of a case.
fn solve(case: &Case, arm: &Arm, blank: Record) -> Record {
    let start = Instant::now();
    let found = surface(case, arm.method, &arm.options);
    let seconds = start.elapsed().as_secs_f64();
    let (errors, note) = match found {
        Ok(surface) => (Some(measure(case, &surface.vertices)), String::new()),
        Err(error) => (None, error.to_string()),
    };
    Record { errors, seconds, note, ..blank }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::{arms_of, markdown, summarise};
    use crate::pipeline::{Method, ReconstructOptions, Silent};
    use crate::synth::Protocol;

    fn plan(count: usize) -> Plan {
        Plan {
            organ: "patch".into(),
            protocol: Protocol { vertices: 100, ..Default::default() },
            extensions: vec![0.0, 10.0],
            noises: vec![1.0],
            count,
            arms: arms_of(&[Method::Rigid], &ReconstructOptions::default()),
            build: "test".into(),
        }
    }

    #[test]
    fn goes_on_where_a_kill_left_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cases.csv");
        let go = || run(&plan(2), &SeriesOrgan::Patch, &path, &Silent).unwrap();
        let whole = go();
        assert_eq!(whole.len(), 4);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 40]).unwrap();
        let again = go();
        let tables = [&whole, &again].map(|r| markdown(&plan(2), &summarise(r, &plan(2))));
        assert_eq!(tables[0], tables[1]);
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 2 + 4);
    }

    #[test]
    fn results_of_another_plan_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cases.csv");
        run(&plan(1), &SeriesOrgan::Patch, &path, &Silent).unwrap();
        let error = run(&plan(2), &SeriesOrgan::Patch, &path, &Silent).unwrap_err().to_string();
        assert!(error.contains("another count") && error.contains("drop"), "{error}");
        std::fs::write(&path, "something else\n").unwrap();
        let error = run(&plan(1), &SeriesOrgan::Patch, &path, &Silent).unwrap_err().to_string();
        assert!(error.contains("line 1"), "{error}");
    }
}
