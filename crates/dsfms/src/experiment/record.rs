//! One method on one case, and the file that keeps them.

use super::{Arm, Errors, ExperimentError, Plan};
use crate::guard;
use crate::synth::Cell;
use std::collections::BTreeMap;
use std::path::Path;

/// One method on one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Conditions.
    pub cell: Cell,
    /// Number of the case in its cell.
    pub case: usize,
    /// Name of the arm.
    pub arm: String,
    /// Largest true displacement, mm.
    pub amplitude: f64,
    /// Mean relative edge-length change in the zone, percent.
    pub mean_extension: f64,
    /// `None` where the method gave no surface.
    pub errors: Option<Errors>,
    /// Time of the reconstruction on one thread, seconds.
    pub seconds: f64,
    /// Why there is no surface; else empty.
    pub note: String,
}

/// The names of the columns of the file.
fn header() -> String {
    format!(
        "extension,noise,case,arm,amplitude,mean_extension,{},seconds,note",
        Errors::NAMES.join(",")
    )
}

/// First two lines of the file: the plan, and the names of the columns.
pub(super) fn preamble(plan: &Plan) -> String {
    let key = serde_json::to_string(plan).unwrap_or_default();
    format!("# {key}\n{}\n", header())
}

impl Record {
    /// A line of the file, every digit kept.
    pub(super) fn line(&self) -> String {
        let Cell { extension, noise } = self.cell;
        let errors = match &self.errors {
            Some(e) => e.values().map(|v| v.to_string()).join(","),
            None => ",".repeat(Errors::NAMES.len() - 1),
        };
        let note = self.note.replace([',', '\n', '\r'], ";");
        let (case, arm, seconds) = (self.case, &self.arm, self.seconds);
        let (amplitude, mean) = (self.amplitude, self.mean_extension);
        format!(
            "{extension},{noise},{case},{arm},{amplitude},{mean},{errors},{seconds:.4},{note}\n"
        )
    }

    fn parse(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split(',').collect();
        let expected = 8 + Errors::NAMES.len();
        if words.len() != expected {
            return Err(format!("{} values, expected {expected}", words.len()));
        }
        let number =
            |i: usize| words[i].parse::<f64>().map_err(|_| format!("{:?} is no number", words[i]));
        let errors = match words[6].is_empty() {
            true => None,
            false => {
                let mut values = [0.0; 6];
                for (k, value) in values.iter_mut().enumerate() {
                    *value = number(6 + k)?;
                }
                Some(Errors::from_values(values))
            }
        };
        Ok(Self {
            cell: Cell { extension: number(0)?, noise: number(1)? },
            case: words[2].parse().map_err(|_| format!("{:?} is no case number", words[2]))?,
            arm: words[3].to_owned(),
            amplitude: number(4)?,
            mean_extension: number(5)?,
            errors,
            seconds: number(12)?,
            note: words[13].to_owned(),
        })
    }
}

/// Finished cases by cell and case number; a case is here with all of its arms or not at all.
pub(super) type Finished = BTreeMap<(usize, usize), Vec<Record>>;

/// The finished cases of a file of results; nothing where there is no file. The last line may be
/// cut short, as a kill leaves it.
pub(super) fn read(path: &Path, plan: &Plan) -> Result<Finished, ExperimentError> {
    let text = match guard::read_text(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Finished::new()),
        Err(error) => return Err(ExperimentError::io(path, error)),
    };
    let bad = |line: usize, problem: String| ExperimentError::Results {
        path: path.into(),
        line,
        problem,
    };
    // The line that was being written when the program was killed has no end.
    let whole = &text[..text.rfind('\n').map_or(0, |at| at + 1)];
    let mut lines = whole.lines();
    let Some(key) = lines.next() else { return Ok(Finished::new()) };
    let differing = differing(key.strip_prefix("# ").unwrap_or(key), plan)
        .map_err(|problem| bad(1, problem))?;
    if !differing.is_empty() {
        return Err(ExperimentError::OtherParameters { path: path.into(), differing });
    }
    match lines.next() {
        None => return Ok(Finished::new()),
        Some(names) if names != header() => {
            return Err(bad(2, format!("expected the columns {}", header())));
        }
        Some(_) => {}
    }
    let mut finished = Finished::new();
    let cells = plan.cells();
    for (i, line) in lines.enumerate() {
        let record = Record::parse(line).map_err(|problem| bad(i + 3, problem))?;
        let cell = cells.iter().position(|c| *c == record.cell);
        let cell = cell.ok_or_else(|| bad(i + 3, "a cell that is not in the plan".into()))?;
        finished.entry((cell, record.case)).or_default().push(record);
    }
    finished.retain(|_, records| complete(records, &plan.arms));
    Ok(finished)
}

fn complete(records: &[Record], arms: &[Arm]) -> bool {
    records.len() == arms.len() && records.iter().zip(arms).all(|(r, a)| r.arm == a.name)
}

/// Names of the parameters of a key that are not the plan's.
fn differing(key: &str, plan: &Plan) -> Result<Vec<String>, String> {
    let unreadable = |_| "expected `# {…}` with the parameters of the experiment".to_owned();
    let found: serde_json::Value = serde_json::from_str(key).map_err(unreadable)?;
    let wanted = serde_json::to_value(plan).map_err(unreadable)?;
    let fields = wanted.as_object().into_iter().flatten();
    Ok(fields.filter(|(name, value)| found.get(name) != Some(value)).map(|f| f.0.clone()).collect())
}
