//! One weighted, robustified term: its cost, and its part of gradient and normal matrix.

use super::known::{KnownSlots, Slots};
use super::unknowns::Unknowns;
use crate::energy::{EnergyTerm, Jacobian};
use crate::geometry::{Point3, Vector3};
use crate::solver::normal_equations::Accumulator;
use crate::solver::{Loss, Pattern};
use nalgebra::{SMatrix, SVector};

/// A term with its row count erased.
pub(super) trait Weighted: Send + Sync {
    fn label(&self) -> &'static str;
    fn count(&self) -> usize;
    fn stencil(&self, i: usize) -> &[u32];
    /// Whether its part of the normal matrix is constant and one number for a pair of vertices.
    fn is_isotropic(&self) -> bool;
    /// Find the blocks of the term at this place in the objective; `false` where one has none.
    fn locate(&mut self, pattern: &Pattern, known: &KnownSlots, place: usize) -> bool;
    fn accumulate_isotropic(&self, values: &mut [f64]);
    fn cost(&self, state: &Unknowns) -> Option<f64>;
    /// Add blocks to the sums; their cost, `None` where one is infeasible.
    fn accumulate(
        &self,
        state: &Unknowns,
        range: std::ops::Range<usize>,
        sums: &mut Accumulator,
    ) -> Option<f64>;
}

pub(super) struct WeightedTerm<const R: usize, T> {
    label: &'static str,
    pub(super) weight: f64,
    pub(super) loss: Loss,
    pub(super) term: T,
    /// Size of its largest stencil.
    largest: usize,
    /// Most globals that a block reads.
    most_globals: usize,
    /// Block index of every pair (a ≥ b) of every stencil, in order.
    pub(super) slots: Slots,
}

/// Vertices and globals of one block after the other.
struct Gathered {
    vertices: Vec<Point3>,
    globals: Vec<f64>,
}

impl Gathered {
    fn new(vertices: usize, globals: usize) -> Self {
        Self { vertices: vec![Point3::origin(); vertices], globals: vec![0.0; globals] }
    }

    fn take(
        &mut self,
        state: &Unknowns,
        stencil: &[u32],
        globals: &[usize],
    ) -> (&[Point3], &[f64]) {
        for (to, &v) in self.vertices.iter_mut().zip(stencil) {
            *to = state.vertices[v as usize];
        }
        for (to, &g) in self.globals.iter_mut().zip(globals) {
            *to = state.globals[g];
        }
        (&self.vertices[..stencil.len()], &self.globals[..globals.len()])
    }
}

impl<const R: usize, T: EnergyTerm<R>> Weighted for WeightedTerm<R, T> {
    fn label(&self) -> &'static str {
        self.label
    }

    fn count(&self) -> usize {
        self.term.count()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        self.term.stencil(i)
    }

    fn is_isotropic(&self) -> bool {
        self.loss == Loss::Squared && self.term.isotropic(0).is_some()
    }

    fn locate(&mut self, pattern: &Pattern, known: &KnownSlots, place: usize) -> bool {
        let stencils = (0..self.term.count()).map(|i| self.term.stencil(i));
        let found = known.locate(pattern, place, stencils);
        let all = found.is_some();
        self.slots = found.unwrap_or_default();
        all
    }

    fn accumulate_isotropic(&self, values: &mut [f64]) {
        if !self.is_isotropic() {
            return;
        }
        let mut slots = self.slots.iter();
        for i in 0..self.term.count() {
            let Some(weights) = self.term.isotropic(i) else { return };
            let w = self.weight * self.term.weight(i);
            for (k, a) in weights.iter().enumerate() {
                for (b, &slot) in weights[..=k].iter().zip(&mut slots) {
                    values[slot as usize] += w * a * b;
                }
            }
        }
    }

    fn cost(&self, state: &Unknowns) -> Option<f64> {
        let mut gathered = Gathered::new(self.largest, self.most_globals);
        let mut sum = 0.0;
        for i in 0..self.term.count() {
            let (v, g) = gathered.take(state, self.term.stencil(i), self.term.globals(i));
            let r = self.term.residual(i, v, g, None).ok()?;
            sum += self.term.weight(i) * self.loss.evaluate(r.norm_squared()).0;
        }
        sum.is_finite().then_some(self.weight * sum)
    }

    fn accumulate(
        &self,
        state: &Unknowns,
        range: std::ops::Range<usize>,
        sums: &mut Accumulator,
    ) -> Option<f64> {
        if self.is_isotropic() {
            return self.accumulate_gradient(state, range, sums);
        }
        let pairs = |i: usize| {
            let k = self.term.stencil(i).len();
            k * (k + 1) / 2
        };
        let mut slot: usize = (0..range.start).map(pairs).sum();
        let mut d_vertices = vec![SMatrix::<f64, R, 3>::zeros(); self.largest];
        let mut d_globals = vec![SVector::<f64, R>::zeros(); self.most_globals];
        let mut weighted = vec![SMatrix::<f64, 3, R>::zeros(); self.largest];
        let mut gathered = Gathered::new(self.largest, self.most_globals);
        let mut cost = 0.0;
        for i in range {
            let (stencil, globals) = (self.term.stencil(i), self.term.globals(i));
            let (v, g) = gathered.take(state, stencil, globals);
            let (dv, dg) = (&mut d_vertices[..stencil.len()], &mut d_globals[..globals.len()]);
            dv.fill(SMatrix::zeros());
            dg.fill(SVector::zeros());
            let jacobian = Jacobian { vertices: dv, globals: dg };
            let slots = &self.slots[slot..slot + pairs(i)];
            slot += pairs(i);
            let r = self.term.residual(i, v, g, Some(jacobian)).ok()?;
            let (value, slope) = self.loss.evaluate(r.norm_squared());
            let w = self.weight * self.term.weight(i);
            cost += w * value;
            if w * slope > 0.0 {
                let block = Block { w: w * slope, r, stencil, globals, dv, dg, slots };
                scatter(sums, &mut weighted[..stencil.len()], block);
            }
        }
        cost.is_finite().then_some(cost)
    }
}

impl<const R: usize, T: EnergyTerm<R>> WeightedTerm<R, T> {
    pub(super) fn new(label: &'static str, weight: f64, loss: Loss, term: T) -> Self {
        let largest = (0..term.count()).map(|i| term.stencil(i).len()).max().unwrap_or(0);
        let most_globals = (0..term.count()).map(|i| term.globals(i).len()).max().unwrap_or(0);
        Self { label, weight, loss, term, largest, most_globals, slots: Slots::default() }
    }

    /// The gradient of blocks whose part of the matrix is already there.
    fn accumulate_gradient(
        &self,
        state: &Unknowns,
        range: std::ops::Range<usize>,
        sums: &mut Accumulator,
    ) -> Option<f64> {
        let (mut gathered, mut cost) = (Gathered::new(self.largest, 0), 0.0);
        for i in range {
            let stencil = self.term.stencil(i);
            let (v, _) = gathered.take(state, stencil, &[]);
            let (r, w) =
                (self.term.residual(i, v, &[], None).ok()?, self.weight * self.term.weight(i));
            cost += w * r.norm_squared();
            let (r, weights) = (Vector3::from_fn(|c, _| r[c] * w), self.term.isotropic(i)?);
            for (&a, &k) in stencil.iter().zip(weights) {
                sums.gradient[a as usize] += r * k;
            }
        }
        cost.is_finite().then_some(cost)
    }
}

/// One linearised block on its way into the sums.
struct Block<'a, const R: usize> {
    w: f64,
    r: SVector<f64, R>,
    stencil: &'a [u32],
    globals: &'a [usize],
    dv: &'a [SMatrix<f64, R, 3>],
    dg: &'a [SVector<f64, R>],
    slots: &'a [u32],
}

/// `weighted`: memory, an entry a vertex of the stencil.
fn scatter<const R: usize>(
    sums: &mut Accumulator,
    weighted: &mut [SMatrix<f64, 3, R>],
    block: Block<'_, R>,
) {
    let Block { w, r, stencil, globals, dv, dg, slots } = block;
    let mut slots = slots.iter();
    for (k, &a) in stencil.iter().enumerate() {
        weighted[k] = dv[k].transpose() * w;
        sums.gradient[a as usize] += weighted[k] * r;
        for (l, (&b, &slot)) in stencil[..=k].iter().zip(&mut slots).enumerate() {
            // The larger vertex is the row.
            let (row, column) = if a >= b { (k, l) } else { (l, k) };
            sums.blocks[slot as usize] += weighted[row] * dv[column];
        }
        for (&g, d) in globals.iter().zip(dg) {
            sums.border[g][a as usize] += weighted[k] * d;
        }
    }
    for (k, &g) in globals.iter().enumerate() {
        sums.global_gradient[g] += w * dg[k].dot(&r);
        for (l, &h) in globals.iter().enumerate() {
            sums.corner[(g, h)] += w * dg[k].dot(&dg[l]);
        }
    }
}
