//! Levenberg–Marquardt with Nielsen's damping (Madsen, Nielsen, Tingleff 2004, alg. 3.16).

use super::{Stop, Summary, TermCost};
use std::time::Instant;

/// A step and what the quadratic model promises of it.
#[derive(Clone, Debug)]
pub struct Step {
    /// The step in the problem's own coordinates.
    pub delta: Vec<f64>,
    /// Promised decrease of the cost, positive.
    pub predicted: f64,
}

/// What [`minimize`] needs to know of a problem.
pub trait Problem {
    /// Point of the search space.
    type State: Clone;
    /// Weighted cost of every term, or `None` where the state is infeasible.
    fn costs(&self, state: &Self::State) -> Option<Vec<f64>>;
    /// The same where [`linearise`](Self::linearise) is likely to follow: what both need may be
    /// kept.
    fn trial(&mut self, state: &Self::State) -> Option<Vec<f64>> {
        self.costs(state)
    }
    /// Name of every term, in the order of [`Problem::costs`].
    fn labels(&self) -> Vec<&'static str>;
    /// Build the Gauss–Newton model at a feasible state; returns the norm of the gradient, or
    /// infinity where that is not worth its time.
    fn linearise(&mut self, state: &Self::State) -> f64;
    /// Solve the damped model, `None` where it has no solution.
    fn step(&mut self, damping: f64) -> Option<Step>;
    /// Apply a step.
    fn retract(&self, state: &Self::State, delta: &[f64]) -> Self::State;
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Accepted steps at most.
    pub max_steps: usize,
    /// Stop when the next step can be expected to lower the cost by less than this fraction of it:
    /// the last decrease times the ratio of the last two.
    pub cost_tolerance: f64,
    /// Stop when the gradient norm falls below this.
    pub gradient_tolerance: f64,
    /// Initial damping, relative to the diagonal of the normal matrix.
    pub initial_damping: f64,
    /// Damping never falls below this: what nothing but damping holds, such as the scale of a
    /// bundle, wants more.
    pub least_damping: f64,
    /// Convergence is not believed to be faster than this ratio of two decreases, in (0, 1]; 1: the
    /// last decrease itself has to be below the tolerance.
    pub fastest: f64,
    /// An iterative solver of the linear systems reduces their residual by this factor.
    pub reduction: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_steps: 50,
            cost_tolerance: 1e-6,
            gradient_tolerance: 1e-12,
            initial_damping: 1e-8,
            least_damping: 1e-14,
            fastest: 0.1,
            reduction: 0.1,
        }
    }
}

/// Largest damping before the solver gives up on a linearisation.
const MAX_DAMPING: f64 = 1e12;

/// Damping after a refused step: less would hardly change it.
const MIN_REFUSED_DAMPING: f64 = 1e-5;

/// Minimise from `state`; the cost of what is returned is never above that of the start.
///
/// An infeasible start is returned unchanged with [`Stop::Infeasible`] and no terms.
///
/// ```
/// use dsfms::solver::{Options, Problem, Step, minimize};
///
/// /// `(x² − 2)²`
/// struct Root([f64; 2]);
///
/// impl Problem for Root {
///     type State = f64;
///     fn costs(&self, x: &f64) -> Option<Vec<f64>> {
///         Some(vec![(x * x - 2.0).powi(2)])
///     }
///     fn labels(&self) -> Vec<&'static str> {
///         vec!["root"]
///     }
///     fn linearise(&mut self, x: &f64) -> f64 {
///         self.0 = [4.0 * x * x, 2.0 * x * (x * x - 2.0)];
///         self.0[1].abs()
///     }
///     fn step(&mut self, damping: f64) -> Option<Step> {
///         let [matrix, gradient] = self.0;
///         let delta = -gradient / (matrix * (1.0 + damping));
///         let predicted = -delta * (2.0 * gradient + matrix * delta);
///         Some(Step { delta: vec![delta], predicted })
///     }
///     fn retract(&self, x: &f64, delta: &[f64]) -> f64 {
///         x + delta[0]
///     }
/// }
///
/// let (x, summary) = minimize(&mut Root([0.0; 2]), 1.0, &Options::default());
/// assert!((x - 2f64.sqrt()).abs() < 1e-6, "{summary:?}");
/// ```
#[doc(alias("Levenberg-Marquardt", "Gauss-Newton", "nonlinear least squares"))]
pub fn minimize<P: Problem>(
    problem: &mut P,
    state: P::State,
    options: &Options,
) -> (P::State, Summary) {
    let start = Instant::now();
    let Some(before) = problem.trial(&state) else {
        return (state, summary(problem, Stop::Infeasible, [0, 0], [&[], &[]], start));
    };
    let mut descent = Descent {
        problem,
        options,
        state,
        costs: before.clone(),
        damping: options.initial_damping,
        growth: 2.0,
        accepted: 0,
        refused: 0,
        last_decrease: f64::MIN_POSITIVE,
    };
    let stop = descent.run();
    let Descent { problem, state, costs, accepted, refused, .. } = descent;
    (state, summary(problem, stop, [accepted, refused], [&before, &costs], start))
}

/// A minimisation under way.
struct Descent<'a, P: Problem> {
    problem: &'a mut P,
    options: &'a Options,
    state: P::State,
    costs: Vec<f64>,
    damping: f64,
    /// Of the damping with the next refused step.
    growth: f64,
    accepted: usize,
    refused: usize,
    last_decrease: f64,
}

/// Where a damped step leads.
struct Trial<S> {
    state: S,
    costs: Vec<f64>,
    decrease: f64,
    predicted: f64,
}

impl<P: Problem> Descent<'_, P> {
    fn run(&mut self) -> Stop {
        loop {
            if self.accepted == self.options.max_steps {
                return Stop::StepLimit;
            }
            if self.problem.linearise(&self.state) < self.options.gradient_tolerance {
                return Stop::Gradient;
            }
            if let Some(stop) = self.descend() {
                return stop;
            }
        }
    }

    /// Damp the model until a step is accepted.
    fn descend(&mut self) -> Option<Stop> {
        loop {
            match self.try_step() {
                Some(trial) if trial.decrease > 0.0 && trial.predicted > 0.0 => {
                    return self.accept(trial);
                }
                trial => {
                    let stop = self.refuse(trial.map(|trial| trial.predicted));
                    if stop.is_some() {
                        return stop;
                    }
                }
            }
        }
    }

    /// `None` where the damped model has no solution, or where it leads has no cost.
    fn try_step(&mut self) -> Option<Trial<P::State>> {
        let Step { delta, predicted } = self.problem.step(self.damping)?;
        let state = self.problem.retract(&self.state, &delta);
        let last = self.accepted + 1 == self.options.max_steps;
        let costs = if last { self.problem.costs(&state) } else { self.problem.trial(&state) }?;
        let decrease = self.cost() - costs.iter().sum::<f64>();
        Some(Trial { state, costs, decrease, predicted })
    }

    fn accept(&mut self, trial: Trial<P::State>) -> Option<Stop> {
        let Trial { state, costs, decrease, predicted } = trial;
        let before = self.cost();
        (self.state, self.costs) = (state, costs);
        self.accepted += 1;
        let gain = (2.0 * decrease / predicted - 1.0).powi(3);
        let eased = self.damping * (1.0 - gain).max(1.0 / 3.0);
        self.damping = eased.max(self.options.least_damping);
        self.growth = 2.0;
        let rate = (decrease / self.last_decrease).clamp(self.options.fastest, 1.0);
        self.last_decrease = decrease;
        (decrease * rate < self.options.cost_tolerance * before).then_some(Stop::Cost)
    }

    fn refuse(&mut self, predicted: Option<f64>) -> Option<Stop> {
        // What is left to gain drowns in what the model leaves out.
        let little = self.options.cost_tolerance * self.cost();
        if predicted.is_some_and(|predicted| predicted.abs() <= little) {
            return Some(Stop::Step);
        }
        self.refused += 1;
        self.damping = (self.damping * self.growth).max(MIN_REFUSED_DAMPING);
        self.growth *= 2.0;
        (self.damping > MAX_DAMPING).then_some(Stop::NoProgress)
    }

    fn cost(&self) -> f64 {
        self.costs.iter().sum()
    }
}

fn summary<P: Problem>(
    problem: &P,
    stop: Stop,
    [iterations, refused]: [usize; 2],
    [before, after]: [&[f64]; 2],
    start: Instant,
) -> Summary {
    let terms = problem
        .labels()
        .into_iter()
        .zip(before.iter().zip(after))
        .map(|(label, (&before, &after))| TermCost { label: label.to_owned(), before, after })
        .collect();
    Summary { stop, iterations, refused, terms, seconds: start.elapsed().as_secs_f64() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    /// Rosenbrock's valley as residuals (10(y − x²), 1 − x).
    struct Rosenbrock {
        hessian: Matrix2<f64>,
        gradient: Vector2<f64>,
    }

    impl Problem for Rosenbrock {
        type State = Vector2<f64>;
        fn costs(&self, s: &Vector2<f64>) -> Option<Vec<f64>> {
            s.x.is_finite().then_some(())?;
            Some(vec![100.0 * (s.y - s.x * s.x).powi(2), (1.0 - s.x).powi(2)])
        }
        fn labels(&self) -> Vec<&'static str> {
            vec!["valley", "floor"]
        }
        fn linearise(&mut self, s: &Vector2<f64>) -> f64 {
            let j = Matrix2::new(-20.0 * s.x, 10.0, -1.0, 0.0);
            let r = Vector2::new(10.0 * (s.y - s.x * s.x), 1.0 - s.x);
            (self.hessian, self.gradient) = (j.transpose() * j, j.transpose() * r);
            self.gradient.norm()
        }
        fn step(&mut self, damping: f64) -> Option<Step> {
            let damped = self.hessian + Matrix2::from_diagonal(&self.hessian.diagonal()) * damping;
            let d = damped.cholesky()?.solve(&-self.gradient);
            let predicted = -(2.0 * self.gradient.dot(&d) + (self.hessian * d).dot(&d));
            Some(Step { delta: vec![d.x, d.y], predicted })
        }
        fn retract(&self, s: &Vector2<f64>, d: &[f64]) -> Vector2<f64> {
            s + Vector2::new(d[0], d[1])
        }
    }

    #[test]
    fn walks_the_rosenbrock_valley() {
        let mut problem = Rosenbrock { hessian: Matrix2::zeros(), gradient: Vector2::zeros() };
        let (x, summary) = minimize(&mut problem, Vector2::new(-1.2, 1.0), &Options::default());
        assert!((x - Vector2::new(1.0, 1.0)).norm() < 1e-6, "{x} {summary:?}");
        assert!(summary.cost().1 < 1e-12);
        assert_eq!(summary.terms[0].label, "valley");
    }

    #[test]
    fn an_infeasible_start_is_the_best_of_none() {
        let mut problem = Rosenbrock { hessian: Matrix2::zeros(), gradient: Vector2::zeros() };
        let nowhere = Vector2::new(f64::NAN, 1.0);
        let (_, summary) = minimize(&mut problem, nowhere, &Options::default());
        assert_eq!(summary.stop, Stop::Infeasible);
        assert!(summary.cost().1 > f64::MAX);
    }

    #[test]
    fn step_limit_is_an_outcome() {
        let mut problem = Rosenbrock { hessian: Matrix2::zeros(), gradient: Vector2::zeros() };
        let options = Options { max_steps: 2, ..Options::default() };
        let (_, summary) = minimize(&mut problem, Vector2::new(-1.2, 1.0), &options);
        assert_eq!(summary.stop, Stop::StepLimit);
        assert!(summary.cost().1 < summary.cost().0);
    }
}
