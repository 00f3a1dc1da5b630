//! A sum of weighted, robustified terms over the vertices of one mesh and a few globals.

mod known;
mod unknowns;
mod weighted;

use super::EnergyTerm;
use crate::geometry::Vector3;
use crate::solver::normal_equations::Accumulator;
use crate::solver::{Loss, NormalEquations, Options, Pattern, Problem, Step, Summary, minimize};
use known::KnownSlots;
use rayon::prelude::*;
pub use unknowns::Unknowns;
use weighted::{Weighted, WeightedTerm};

/// Partial sums per linearisation: fixed, so that the reduction order does not depend on threads.
const STRIPES: usize = 2;

/// `Σ_terms weight · Σᵢ wᵢ ρ(‖rᵢ‖²)`.
///
/// Reads as the paper prints it:
///
/// ```
/// use dsfms::energy::{Objective, Shearing, Smoothing, AnchorPrior, Unknowns};
/// use dsfms::geometry::{Point3, Vector3};
/// use dsfms::{register::Scene, solver::{Loss, Options}, synth::Case};
///
/// let case = Case::example(1);
/// let mesh = &case.template.mesh;
/// let posed: Vec<Point3> = mesh.positions.iter().map(|p| p + Vector3::new(0.0, 0.0, 75.0)).collect();
/// let scene = Scene::new(&case.camera, mesh, posed.clone());
/// let smoothing = Smoothing::of_displacement(&scene.laplacian, &posed, scene.visible_area);
/// // One vertex is pulled 2 mm towards the camera, the others follow.
/// let pull = posed[150] - Vector3::new(0.0, 0.0, 2.0);
/// let pull = AnchorPrior { vertices: vec![[150]], reference: vec![pull], weights: vec![1.0], sigma: 0.1 };
/// let start = Unknowns { vertices: posed.clone(), globals: vec![] };
/// let (found, _) = Objective::over(posed.len(), 0)
///     .plus("shearing", 3e4, Loss::Squared, Shearing { rest: scene.faces() })
///     .plus("smoothing", 100.0, Loss::Squared, smoothing)
///     .plus("pull", 1.0, Loss::Squared, pull)
///     .minimise(start, &Options::default());
/// assert!(found.vertices[150].z < posed[150].z - 0.5);
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
/// to solve over the same mesh; an objective that it does not fit makes it again.
#[derive(Default)]
pub struct Workspace {
    system: Option<StripedSystem>,
}

struct StripedSystem {
    equations: NormalEquations,
    stripes: Vec<Accumulator>,
    near: KnownSlots,
    smooth: KnownSlots,
}

impl Workspace {
    /// Prepared for the blocks of these stencils, so that objectives that come to need them one by
    /// one are not analysed again.
    pub fn reserved<'s>(
        vertices: usize,
        globals: usize,
        stencils: impl Iterator<Item = &'s [u32]>,
    ) -> Self {
        let near = Pattern::new(vertices, stencils);
        Self {
            system: Some(StripedSystem::new(near, Pattern::new(vertices, [].into_iter()), globals)),
        }
    }
}

impl StripedSystem {
    fn new(near: Pattern, smooth: Pattern, globals: usize) -> Self {
        let stripes = vec![Accumulator::new(&near, globals); STRIPES];
        let equations = NormalEquations::new(near, smooth, globals)
            .expect("a pattern built from stencils is well formed");
        Self { equations, stripes, near: KnownSlots::default(), smooth: KnownSlots::default() }
    }
}

impl<'a> Objective<'a> {
    /// No terms yet.
    pub fn over(vertices: usize, globals: usize) -> Self {
        let workspace = Workspace::default();
        Self { vertices, globals, terms: Vec::new(), workspace, ahead: None }
    }

    /// Number of global unknowns.
    pub fn globals(&self) -> usize {
        self.globals
    }

    /// Add a term under the name that it has in this problem (role and equation,
    /// `"motion (eq. 3)"`): reports print it. A weight of 0 leaves it out.
    pub fn plus<const R: usize>(
        mut self,
        label: &'static str,
        weight: f64,
        loss: Loss,
        term: impl EnergyTerm<R> + 'a,
    ) -> Self {
        if weight > 0.0 && term.count() > 0 {
            self.terms.push(Box::new(WeightedTerm::new(label, weight, loss, term)));
        }
        self
    }

    /// Add a term where there is one.
    pub(crate) fn plus_if<const R: usize>(
        self,
        label: &'static str,
        weight: f64,
        loss: Loss,
        term: Option<impl EnergyTerm<R> + 'a>,
    ) -> Self {
        match term {
            Some(term) => self.plus(label, weight, loss, term),
            None => self,
        }
    }

    /// Minimise from `start`.
    pub fn minimise(self, start: Unknowns, options: &Options) -> (Unknowns, Summary) {
        self.minimise_in(&mut Workspace::default(), start, options)
    }

    /// Minimise from `start` with what an earlier solve over the same mesh has left.
    pub(crate) fn minimise_in(
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
    fn locate(&mut self, system: &StripedSystem) -> bool {
        let StripedSystem { equations, near, smooth, .. } = system;
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
    fn analyse(&self, earlier: Option<&NormalEquations>) -> StripedSystem {
        let pattern = |isotropic: bool| {
            let terms = self.terms.iter().filter(move |t| t.is_isotropic() == isotropic);
            let stencils = terms.flat_map(|t| (0..t.count()).map(|i| t.stencil(i)));
            Pattern::new(self.vertices, stencils)
        };
        let (mut near, mut smooth) = (pattern(false), pattern(true));
        if let Some(earlier) = earlier {
            (near, smooth) = (near.union(earlier.near()), smooth.union(earlier.smooth()));
        }
        StripedSystem::new(near, smooth, self.globals)
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

#[cfg(test)]
mod tests;
