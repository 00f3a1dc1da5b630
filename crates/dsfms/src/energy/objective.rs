//! A sum of weighted, robustified terms over the vertices of one mesh and a few globals.

use super::{EnergyTerm, Jacobian};
use crate::geometry::{Point3, Vector3};
use crate::solver::normal_equations::Accumulator;
use crate::solver::{Loss, NormalEquations, Options, Pattern, Problem, Step, Summary, minimize};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// What is solved for.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknowns {
    /// Vertex positions in camera axes.
    pub vertices: Vec<Point3>,
    /// Global unknowns; their meaning is the objective's.
    pub globals: Vec<f64>,
}

/// Largest stencil a term may declare; a vertex of higher valence is refused when it is added.
pub const MAX_STENCIL: usize = 48;

/// Largest number of globals one term may read.
pub const MAX_GLOBALS: usize = 4;

/// Partial sums per linearisation: fixed, so that the reduction order does not depend on threads.
const STRIPES: usize = 2;

/// `Σ_terms weight · Σᵢ wᵢ ρ(‖rᵢ‖²)`.
///
/// Reads as the paper prints it:
///
/// ```ignore
/// Objective::over(vertex_count, 0)
///     .plus(1.0, Loss::GemanMcClure(4.0), Motion { .. })
///     .plus(weights.shearing, Loss::Squared, Shearing { .. })
/// ```
pub struct Objective<'a> {
    vertices: usize,
    globals: usize,
    terms: Vec<Box<dyn Weighted + 'a>>,
    workspace: Workspace,
    /// The state whose linearisation lies in the stripes.
    ahead: Option<Unknowns>,
}

/// What outlives an objective: patterns, ordering, symbolic factors and memory. Hand it from solve
/// to solve over the same mesh; an objective that it does not fit makes it anew.
#[derive(Default)]
pub struct Workspace {
    system: Option<System>,
}

struct System {
    equations: NormalEquations,
    stripes: Vec<Accumulator>,
    near: Known,
    smooth: Known,
}

/// Blocks found before in one pattern: most stencils come again from solve to solve.
#[derive(Default)]
struct Known {
    /// Of all stencils of the term at a place in the objective, where there was one.
    terms: Mutex<HashMap<usize, Found>>,
    /// Of single wide stencils: a dozen vertices have 78 blocks to find.
    wide: Mutex<HashMap<Box<[u32]>, Slots>>,
}

/// Block indices of every pair (a ≥ b) of one or more stencils, in order.
type Slots = Arc<[u32]>;

struct Found {
    /// Vertices of the stencils, one after the other.
    vertices: Vec<u32>,
    /// How many there are in each.
    sizes: Vec<u32>,
    slots: Slots,
}

impl Found {
    fn is_of<'t>(&self, stencils: impl ExactSizeIterator<Item = &'t [u32]>) -> bool {
        let mut rest = &self.vertices[..];
        let mut next = |(stencil, &size): (&[u32], &u32)| {
            let Some((own, after)) = rest.split_at_checked(size as usize) else { return false };
            rest = after;
            own == stencil
        };
        stencils.len() == self.sizes.len() && stencils.zip(&self.sizes).all(&mut next)
    }
}

impl Known {
    const NARROW: usize = 4;

    /// The blocks of the term at a place in the objective; `None` where a pair has none.
    fn locate<'t, I>(&self, pattern: &Pattern, place: usize, stencils: I) -> Option<Slots>
    where
        I: ExactSizeIterator<Item = &'t [u32]> + Clone,
    {
        let of_term = |known: &Self| {
            let terms = known.terms.lock().unwrap_or_else(PoisonError::into_inner);
            let found = terms.get(&place).filter(|found| found.is_of(stencils.clone()));
            found.map(|found| Arc::clone(&found.slots))
        };
        if let Some(slots) = of_term(self) {
            return Some(slots);
        }
        let mut slots = Vec::new();
        for stencil in stencils.clone() {
            self.append(pattern, stencil, &mut slots)?;
        }
        let slots: Slots = slots.into();
        let found = Found {
            vertices: stencils.clone().flatten().copied().collect(),
            sizes: stencils.map(|s| s.len() as u32).collect(),
            slots: Arc::clone(&slots),
        };
        self.terms.lock().unwrap_or_else(PoisonError::into_inner).insert(place, found);
        Some(slots)
    }

    fn append(&self, pattern: &Pattern, stencil: &[u32], slots: &mut Vec<u32>) -> Option<()> {
        if stencil.len() <= Self::NARROW {
            return find_blocks(pattern, stencil, slots);
        }
        let mut wide = self.wide.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = wide.get(stencil) {
            slots.extend_from_slice(found);
            return Some(());
        }
        let start = slots.len();
        find_blocks(pattern, stencil, slots)?;
        wide.insert(stencil.into(), slots[start..].into());
        Some(())
    }
}

/// Append the block of every pair (a ≥ b) of a stencil, in order; `None` where one has none.
fn find_blocks(pattern: &Pattern, stencil: &[u32], slots: &mut Vec<u32>) -> Option<()> {
    for (k, &a) in stencil.iter().enumerate() {
        for &b in &stencil[..=k] {
            slots.push(pattern.find(a, b)? as u32);
        }
    }
    Some(())
}

impl Workspace {
    /// Prepared for the blocks of these stencils, so that objectives that come to need them one by one
    /// are not analysed again.
    pub fn reserved<'s>(
        vertices: usize,
        globals: usize,
        stencils: impl Iterator<Item = &'s [u32]>,
    ) -> Self {
        let near = Pattern::new(vertices, stencils);
        Self { system: Some(System::new(near, Pattern::new(vertices, [].into_iter()), globals)) }
    }
}

impl System {
    fn new(near: Pattern, smooth: Pattern, globals: usize) -> Self {
        let stripes = vec![Accumulator::new(&near, globals); STRIPES];
        let equations = NormalEquations::new(near, smooth, globals)
            .expect("a pattern built from stencils is well formed");
        Self { equations, stripes, near: Known::default(), smooth: Known::default() }
    }
}

impl<'a> Objective<'a> {
    /// No terms yet.
    pub fn over(vertices: usize, globals: usize) -> Self {
        let workspace = Workspace::default();
        Self { vertices, globals, terms: Vec::new(), workspace, ahead: None }
    }

    /// Add a term. A weight of 0 leaves it out.
    pub fn plus<const R: usize>(
        mut self,
        weight: f64,
        loss: Loss,
        term: impl EnergyTerm<R> + 'a,
    ) -> Self {
        if weight > 0.0 && term.count() > 0 {
            self.terms.push(Box::new(WeightedTerm { weight, loss, term, slots: Arc::default() }));
        }
        self
    }

    /// Minimise from `start`.
    pub fn minimise(self, start: Unknowns, options: &Options) -> (Unknowns, Summary) {
        self.minimise_in(&mut Workspace::default(), start, options)
    }

    /// Minimise from `start` with what an earlier solve over the same mesh has left.
    pub fn minimise_in(
        mut self,
        workspace: &mut Workspace,
        start: Unknowns,
        options: &Options,
    ) -> (Unknowns, Summary) {
        self.workspace = std::mem::take(workspace);
        self.prepare();
        if let Some(system) = &mut self.workspace.system {
            system.equations.reduce_by(options.reduction);
            system.equations.orient(&start.vertices).expect("a system that was ordered fits");
        }
        let found = minimize(&mut self, start, options);
        *workspace = std::mem::take(&mut self.workspace);
        found
    }

    /// Analyse the sparsity once; also needed before [`Problem::linearise`] is called by hand.
    pub fn prepare(&mut self) {
        let mut system = self.workspace.system.take().filter(|system| {
            let equations = &system.equations;
            equations.near().vertices() == self.vertices && equations.globals() == self.globals
        });
        if !system.as_ref().is_some_and(|s| self.locate(s)) {
            let fresh = self.analyse(system.as_ref().map(|s| &s.equations));
            self.locate(&fresh);
            system = Some(fresh);
        }
        if let Some(system) = &mut system {
            let values = system.equations.isotropic_mut();
            values.fill(0.0);
            self.terms.iter().for_each(|term| term.accumulate_isotropic(values));
        }
        self.workspace.system = system;
    }

    /// Find the blocks of every term; `false` where one has none.
    fn locate(&mut self, system: &System) -> bool {
        let System { equations, near, smooth, .. } = system;
        let locate = |(place, term): (usize, &mut Box<dyn Weighted + 'a>)| {
            let (pattern, known) = match term.is_isotropic() {
                true => (equations.smooth(), smooth),
                false => (equations.near(), near),
            };
            term.locate(pattern, known, place)
        };
        self.terms.par_iter_mut().enumerate().all(locate)
    }

    /// Linearise into the stripes; the cost of every term, `None` where the state is infeasible.
    fn accumulate(&mut self, state: &Unknowns) -> Option<Vec<f64>> {
        let (terms, system) = (&self.terms, self.workspace.system.as_mut()?);
        let parts: Vec<Option<Vec<f64>>> = system
            .stripes
            .par_iter_mut()
            .enumerate()
            .map(|(k, sums)| {
                sums.clear();
                let mut part = |term: &(dyn Weighted + 'a)| {
                    let n = term.count();
                    term.accumulate(state, n * k / STRIPES..n * (k + 1) / STRIPES, sums)
                };
                terms.iter().map(|term| part(term.as_ref())).collect()
            })
            .collect();
        let mut costs = vec![0.0; terms.len()];
        for part in parts {
            costs.iter_mut().zip(part?).for_each(|(sum, cost)| *sum += cost);
        }
        Some(costs)
    }

    /// A system for the terms, and for those that an earlier one was made for.
    fn analyse(&self, earlier: Option<&NormalEquations>) -> System {
        let pattern = |isotropic: bool| {
            let terms = self.terms.iter().filter(move |t| t.is_isotropic() == isotropic);
            let stencils = terms.flat_map(|t| (0..t.count()).map(|i| t.stencil(i)));
            Pattern::new(self.vertices, stencils)
        };
        let (mut near, mut smooth) = (pattern(false), pattern(true));
        if let Some(earlier) = earlier {
            (near, smooth) = (near.union(earlier.near()), smooth.union(earlier.smooth()));
        }
        System::new(near, smooth, self.globals)
    }
}

impl Problem for Objective<'_> {
    type State = Unknowns;

    fn costs(&self, state: &Unknowns) -> Option<Vec<f64>> {
        self.terms.par_iter().map(|term| term.cost(state)).collect()
    }

    fn trial(&mut self, state: &Unknowns) -> Option<Vec<f64>> {
        self.ahead = None;
        let costs = self.accumulate(state);
        self.ahead = costs.is_some().then(|| state.clone());
        costs
    }

    fn labels(&self) -> Vec<&'static str> {
        self.terms.iter().map(|term| term.label()).collect()
    }

    fn linearise(&mut self, state: &Unknowns) -> f64 {
        if self.ahead.as_ref() != Some(state) {
            self.accumulate(state);
        }
        self.ahead = None;
        let Some(system) = &mut self.workspace.system else { return 0.0 };
        system.equations.assemble(&mut system.stripes);
        system.equations.gradient_norm()
    }

    fn step(&mut self, damping: f64) -> Option<Step> {
        self.workspace.system.as_mut()?.equations.step(damping)
    }

    fn retract(&self, state: &Unknowns, delta: &[f64]) -> Unknowns {
        let (d_vertices, d_globals) = delta.split_at(3 * self.vertices);
        let vertices = state.vertices.iter().zip(d_vertices.chunks_exact(3));
        Unknowns {
            vertices: vertices.map(|(v, d)| v + Vector3::new(d[0], d[1], d[2])).collect(),
            globals: state.globals.iter().zip(d_globals).map(|(g, d)| g + d).collect(),
        }
    }
}

/// A term with its row count erased.
trait Weighted: Send + Sync {
    fn label(&self) -> &'static str;
    fn count(&self) -> usize;
    fn stencil(&self, i: usize) -> &[u32];
    /// Whether its part of the normal matrix is constant and one number for a pair of vertices.
    fn is_isotropic(&self) -> bool;
    /// Find the blocks of the term at this place in the objective; `false` where one has none.
    fn locate(&mut self, pattern: &Pattern, known: &Known, place: usize) -> bool;
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

struct WeightedTerm<const R: usize, T> {
    weight: f64,
    loss: Loss,
    term: T,
    /// Block index of every pair (a ≥ b) of every stencil, in order.
    slots: Slots,
}

/// Vertices and globals of one block, gathered on the stack.
struct Gathered {
    vertices: [Point3; MAX_STENCIL],
    globals: [f64; MAX_GLOBALS],
}

impl Gathered {
    fn new() -> Self {
        Self { vertices: [Point3::origin(); MAX_STENCIL], globals: [0.0; MAX_GLOBALS] }
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
        T::LABEL
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

    fn locate(&mut self, pattern: &Pattern, known: &Known, place: usize) -> bool {
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
        let (globals, mut gathered) = (self.term.globals(), Gathered::new());
        let mut sum = 0.0;
        for i in 0..self.term.count() {
            let (v, g) = gathered.take(state, self.term.stencil(i), globals);
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
        let globals = self.term.globals();
        let pairs = |i: usize| {
            let k = self.term.stencil(i).len();
            k * (k + 1) / 2
        };
        let mut slot: usize = (0..range.start).map(pairs).sum();
        let mut d_vertices = [SMatrix::<f64, R, 3>::zeros(); MAX_STENCIL];
        let mut d_globals = [SVector::<f64, R>::zeros(); MAX_GLOBALS];
        let mut weighted = [SMatrix::<f64, 3, R>::zeros(); MAX_STENCIL];
        let mut gathered = Gathered::new();
        let mut cost = 0.0;
        for i in range {
            let stencil = self.term.stencil(i);
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
    /// The gradient of blocks whose part of the matrix is already there.
    fn accumulate_gradient(
        &self,
        state: &Unknowns,
        range: std::ops::Range<usize>,
        sums: &mut Accumulator,
    ) -> Option<f64> {
        let (mut gathered, mut cost) = (Gathered::new(), 0.0);
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

#[cfg(test)]
mod tests;
