//! What a solve did, term by term.

use serde::{Deserialize, Serialize};

/// Why the solver stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// The next step could be expected to lower the cost by less than the relative tolerance.
    Cost,
    /// A refused step promised less than the relative tolerance.
    Step,
    /// The gradient vanished.
    Gradient,
    /// The step limit was reached: an outcome, not an error.
    StepLimit,
    /// No damping up to the largest gave a step that lowers the cost.
    NoProgress,
    /// The start has no cost: a point lies behind the camera, a face is folded flat.
    Infeasible,
}

/// Weighted cost of one term.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TermCost {
    /// Role and equation, e.g. `motion (eq. 3)`.
    pub label: String,
    /// `weight · Σ ρ` at the start.
    pub before: f64,
    /// `weight · Σ ρ` at the end.
    pub after: f64,
}

/// The report of one solve.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Why it stopped.
    pub stop: Stop,
    /// Accepted steps.
    pub iterations: usize,
    /// Refused steps.
    pub refused: usize,
    /// Every term before and after.
    pub terms: Vec<TermCost>,
    /// Wall time, seconds.
    pub seconds: f64,
}

impl Summary {
    /// Total cost before and after; infinite where the start was infeasible, so that it is never
    /// the best of several.
    pub fn cost(&self) -> (f64, f64) {
        if self.stop == Stop::Infeasible {
            return (f64::INFINITY, f64::INFINITY);
        }
        self.terms.iter().fold((0.0, 0.0), |(b, a), t| (b + t.before, a + t.after))
    }

    /// The term of a label; `None` where the solve had none of it.
    pub fn term(&self, label: &str) -> Option<&TermCost> {
        self.terms.iter().find(|t| t.label == label)
    }
}
