//! Preconditioned conjugate gradients (Hestenes, Stiefel 1952).

use super::cholesky;
use rayon::prelude::*;

/// A symmetric positive definite system of numbers `T`, of which only products are known.
pub(crate) trait System<T> {
    /// `out = A x`.
    fn apply(&mut self, x: &[T], out: &mut [T]);
    /// `out = M⁻¹ r`, with a matrix `M` that is like `A` and easily solved for.
    fn precondition(&mut self, r: &[T], out: &mut [T]);
}

/// When to stop: by the residual's square in the norm of the preconditioner, `rᵀM⁻¹r`.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Goal {
    /// At this share of where it began.
    Share(f64),
    /// At this value.
    Below(f64),
}

/// How it ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Ending {
    /// The goal is reached.
    Reached,
    /// After as many steps as were allowed, above the goal.
    Limit {
        /// Its value.
        goal: f64,
    },
    /// The system is not positive definite, or holds numbers that are not finite.
    Failed,
}

/// Solve `A x = b` from `x` as it stands; `residual`: `b − A x`, kept up.
pub(crate) fn conjugate_gradients<T: Number>(
    system: &mut impl System<T>,
    x: &mut [T],
    residual: &mut [T],
    goal: Goal,
    steps: usize,
) -> Ending {
    let mut scaled = vec![T::default(); x.len()];
    system.precondition(residual, &mut scaled);
    let (mut direction, mut applied) = (scaled.clone(), scaled.clone());
    let mut energy = T::dot(residual, &scaled);
    let goal = match goal {
        Goal::Share(share) => share * energy,
        Goal::Below(value) => value,
    };
    for _ in 0..steps {
        if energy.is_nan() || energy < 0.0 {
            return Ending::Failed;
        }
        if energy <= goal {
            return Ending::Reached;
        }
        system.apply(&direction, &mut applied);
        let step = energy / T::dot(&direction, &applied);
        if !(step.is_finite() && step > 0.0) {
            return Ending::Failed;
        }
        T::update(x, &direction, |x, d| x + T::of(step) * d);
        T::update(residual, &applied, |r, a| r - T::of(step) * a);
        system.precondition(residual, &mut scaled);
        let next = T::dot(residual, &scaled);
        let share = T::of(next / energy);
        T::update(&mut direction, &scaled, |d, z| z + share * d);
        energy = next;
    }
    if energy <= goal { Ending::Reached } else { Ending::Limit { goal } }
}

/// Of double precision, one after the other; or of single precision for large grids, in parallel
/// over a fixed partition: the same bits at any number of threads.
pub(crate) trait Number:
    Copy
    + Default
    + Send
    + Sync
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
{
    /// Nearest to a number.
    fn of(value: f64) -> Self;
    /// `aᵀb`.
    fn dot(a: &[Self], b: &[Self]) -> f64;
    /// `to = f(to, from)`, number by number.
    fn update(to: &mut [Self], from: &[Self], f: impl Fn(Self, Self) -> Self + Sync);
}

impl Number for f64 {
    fn of(value: f64) -> Self {
        value
    }

    fn dot(a: &[Self], b: &[Self]) -> f64 {
        cholesky::dot(a, b)
    }

    fn update(to: &mut [Self], from: &[Self], f: impl Fn(Self, Self) -> Self + Sync) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to = f(*to, *from));
    }
}

/// Numbers that a parallel task works on.
const CHUNK: usize = 4096;

impl Number for f32 {
    fn of(value: f64) -> Self {
        value as f32
    }

    fn dot(a: &[Self], b: &[Self]) -> f64 {
        let product = |(x, y): (&f32, &f32)| f64::from(*x) * f64::from(*y);
        let parts: Vec<f64> = a
            .par_chunks(CHUNK)
            .zip(b.par_chunks(CHUNK))
            .map(|(a, b)| a.iter().zip(b).map(product).sum())
            .collect();
        parts.iter().sum()
    }

    fn update(to: &mut [Self], from: &[Self], f: impl Fn(Self, Self) -> Self + Sync) {
        to.par_iter_mut().zip(from).for_each(|(to, from)| *to = f(*to, *from));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Preconditioned by the diagonal.
    struct Dense(DMatrix<f64>);

    impl System<f64> for Dense {
        fn apply(&mut self, x: &[f64], out: &mut [f64]) {
            out.copy_from_slice((&self.0 * DVector::from_column_slice(x)).as_slice());
        }
        fn precondition(&mut self, r: &[f64], out: &mut [f64]) {
            (0..r.len()).for_each(|i| out[i] = r[i] / self.0[(i, i)]);
        }
    }

    impl System<f32> for Dense {
        fn apply(&mut self, x: &[f32], out: &mut [f32]) {
            let x: Vec<f64> = x.iter().map(|x| f64::from(*x)).collect();
            let y = &self.0 * DVector::from_vec(x);
            out.iter_mut().zip(y.iter()).for_each(|(out, y)| *out = *y as f32);
        }
        fn precondition(&mut self, r: &[f32], out: &mut [f32]) {
            (0..r.len()).for_each(|i| out[i] = r[i] / self.0[(i, i)] as f32);
        }
    }

    fn chain(n: usize) -> Dense {
        Dense(DMatrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
            0 => 2.5,
            1 => -1.0,
            _ => 0.0,
        }))
    }

    #[test]
    fn exact_after_as_many_steps_as_unknowns() {
        let (mut system, mut x) = (chain(6), vec![0.0f64; 6]);
        let b: Vec<f64> = (0..6).map(|i| f64::from(i) - 2.0).collect();
        let mut residual = b.clone();
        let ending = conjugate_gradients(&mut system, &mut x, &mut residual, Goal::Share(1e-26), 7);
        assert_eq!(ending, Ending::Reached);
        let exact = system.0.clone().cholesky().unwrap().solve(&DVector::from_vec(b));
        assert!((DVector::from_vec(x) - exact).amax() < 1e-12);
    }

    #[test]
    fn single_precision_and_endings() {
        let (mut system, n) = (chain(50), 50);
        let start = || (vec![0.0f32; n], vec![1.0f32; n]);
        let (mut x, mut r) = start();
        assert_eq!(
            conjugate_gradients(&mut system, &mut x, &mut r, Goal::Share(1e-10), 100),
            Ending::Reached
        );
        assert!(r.iter().all(|r| r.abs() < 1e-4));
        let (mut x, mut r) = start();
        let short = conjugate_gradients(&mut system, &mut x, &mut r, Goal::Below(1e-12), 2);
        assert_eq!(short, Ending::Limit { goal: 1e-12 });
        let mut negative = Dense(DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, -1.0])));
        let (mut x, mut r) = (vec![0.0f64; 2], vec![1.0, 2.0]);
        let ending = conjugate_gradients(&mut negative, &mut x, &mut r, Goal::Share(1e-6), 9);
        assert_eq!(ending, Ending::Failed);
    }
}
