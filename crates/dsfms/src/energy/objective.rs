//! A sum of weighted, robustified terms over the vertices of one mesh and a few globals.

use super::{EnergyTerm, Jacobian};
use crate::geometry::{Point3, Vector3};
use crate::solver::normal_equations::Accumulator;
use crate::solver::{Loss, NormalEquations, Options, Pattern, Problem, Step, Summary, minimize};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

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
            self.terms.push(Box::new(WeightedTerm { weight, loss, term, slots: Vec::new() }));
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
        if !system.as_ref().is_some_and(|s| self.locate(&s.equations)) {
            let fresh = self.analyse(system.as_ref().map(|s| &s.equations));
            self.locate(&fresh.equations);
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
    fn locate(&mut self, equations: &NormalEquations) -> bool {
        let locate = |term: &mut Box<dyn Weighted + 'a>| {
            let pattern = if term.is_isotropic() { equations.smooth() } else { equations.near() };
            term.locate(pattern)
        };
        self.terms.par_iter_mut().all(locate)
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
        let stripes = vec![Accumulator::new(&near, self.globals); STRIPES];
        let equations = NormalEquations::new(near, smooth, self.globals)
            .expect("a pattern built from stencils is well formed");
        System { equations, stripes }
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
        system.equations.assemble(system.stripes.iter());
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
    fn locate(&mut self, pattern: &Pattern) -> bool;
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
    slots: Vec<u32>,
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

    fn locate(&mut self, pattern: &Pattern) -> bool {
        self.slots.clear();
        for i in 0..self.term.count() {
            let stencil = self.term.stencil(i);
            for (k, &a) in stencil.iter().enumerate() {
                for &b in &stencil[..=k] {
                    let Some(block) = pattern.find(a, b) else { return false };
                    self.slots.push(block as u32);
                }
            }
        }
        true
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
                scatter(sums, Block { w: w * slope, r, stencil, globals, dv, dg, slots });
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

fn scatter<const R: usize>(sums: &mut Accumulator, block: Block<'_, R>) {
    let Block { w, r, stencil, globals, dv, dg, slots } = block;
    let mut slots = slots.iter();
    for (k, &a) in stencil.iter().enumerate() {
        let weighted = dv[k].transpose() * w;
        sums.gradient[a as usize] += weighted * r;
        for (l, &b) in stencil[..=k].iter().enumerate() {
            let product = weighted * dv[l];
            let Some(&slot) = slots.next() else { return };
            sums.blocks[slot as usize] += if a >= b { product } else { product.transpose() };
        }
        for (&g, d) in globals.iter().zip(dg) {
            sums.border[g][a as usize] += weighted * d;
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
mod tests {
    use super::*;
    use crate::camera::{CameraModel, Lens};
    use crate::energy::check::bent_patch;
    use crate::energy::{GlobalsPrior, Motion, RestFaces, Shearing, Smoothing, Stretch};
    use crate::geometry::Point2;
    use crate::mesh::laplacian::Laplacian;
    use crate::mesh::{Mesh, shapes};
    use nalgebra::{DMatrix, DVector};

    fn camera() -> CameraModel {
        CameraModel {
            size: [640, 480],
            focal: [600.0, 600.0],
            centre: [319.5, 239.5],
            lens: Lens::Pinhole,
        }
    }

    /// A sheet of 40 × 40 mm, gently bent, 80 mm in front of the camera.
    fn sheet(n: usize) -> Mesh {
        let flat = shapes::irregular_sheet(n);
        let bend = |p: &Point3| {
            let (x, y) = (40.0 * (p.x - 0.5), 40.0 * (p.y - 0.5));
            Point3::new(x, y, 80.0 + 0.01 * x * x + 0.005 * x * y)
        };
        flat.with_positions(flat.positions.iter().map(bend).collect())
    }

    fn objective<'a>(mesh: &Mesh, rest: &'a RestFaces, camera: &'a CameraModel) -> Objective<'a> {
        let faces: Vec<[u32; 3]> = mesh.topology.faces.iter().step_by(7).copied().collect();
        let pixels = faces.iter().map(|f| {
            let p = mesh.positions[f[0] as usize];
            let pull = 6.0 * (-(p.x * p.x + p.y * p.y) / 60.0).exp();
            Point2::new(319.5 + 600.0 * p.x / p.z + pull, 239.5 + 600.0 * p.y / p.z)
        });
        let motion = Motion {
            camera,
            pixels: pixels.collect(),
            barycentrics: vec![[1.0, 0.0, 0.0]; faces.len()],
            faces,
            sigma_px: 1.0,
        };
        let smoothing = Smoothing::of_displacement(&Laplacian::new(mesh), &mesh.positions, 1600.0);
        Objective::over(mesh.positions.len(), 1)
            .plus(1.0, Loss::GemanMcClure(4.0), motion)
            .plus(3e4, Loss::Squared, Shearing { rest })
            .plus(3e3, Loss::Squared, Stretch { rest })
            .plus(100.0, Loss::Squared, smoothing)
            .plus(1.0, Loss::Squared, GlobalsPrior { index: [0], mean: 0.1, sigma: 0.3 })
    }

    fn start(mesh: &Mesh) -> Unknowns {
        let moved = mesh.positions.iter().map(|p| p + Vector3::new(0.05 * p.y.sin(), 0.0, 0.02));
        Unknowns { vertices: moved.collect(), globals: vec![0.0] }
    }

    fn farthest(a: &Unknowns, b: &Unknowns) -> f64 {
        a.vertices.iter().zip(&b.vertices).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn assembly_equals_the_dense_sum() {
        let mesh = bent_patch();
        let rest = RestFaces::new(&mesh, 100.0);
        let smoothing =
            || Smoothing::of_displacement(&Laplacian::new(&mesh), &mesh.positions, 100.0);
        let mut problem = Objective::over(25, 1)
            .plus(2.0, Loss::Huber(0.01), Shearing { rest: &rest })
            .plus(3.0, Loss::Squared, Stretch { rest: &rest })
            .plus(0.5, Loss::Squared, smoothing())
            .plus(0.7, Loss::Squared, GlobalsPrior { index: [0], mean: 0.1, sigma: 0.3 });
        let state = start(&mesh);
        let (mut hessian, mut gradient) = (DMatrix::zeros(76, 76), DVector::zeros(76));
        add_dense(
            2.0,
            Loss::Huber(0.01),
            &Shearing { rest: &rest },
            &state,
            &mut hessian,
            &mut gradient,
        );
        add_dense(
            3.0,
            Loss::Squared,
            &Stretch { rest: &rest },
            &state,
            &mut hessian,
            &mut gradient,
        );
        add_dense(0.5, Loss::Squared, &smoothing(), &state, &mut hessian, &mut gradient);
        (hessian[(75, 75)], gradient[75]) = (0.7 / 0.09, 0.7 * (0.0 - 0.1) / 0.09);
        problem.prepare();
        let norm = problem.linearise(&state);
        assert!((norm - gradient.norm()).abs() < 1e-9 * norm);
        // Damping keeps the free rigid motion in check.
        let found = DVector::from_vec(problem.step(0.1).unwrap().delta);
        let damped = &hessian + DMatrix::from_diagonal(&(hessian.diagonal() * 0.1));
        let residual = &damped * &found + &gradient;
        assert!(residual.norm() < 1e-8 * gradient.norm(), "{}", residual.norm());
    }

    fn add_dense<const R: usize>(
        weight: f64,
        loss: Loss,
        term: &impl EnergyTerm<R>,
        state: &Unknowns,
        hessian: &mut DMatrix<f64>,
        gradient: &mut DVector<f64>,
    ) {
        for i in 0..term.count() {
            let stencil = term.stencil(i);
            let v: Vec<Point3> = stencil.iter().map(|&k| state.vertices[k as usize]).collect();
            let mut dv = vec![SMatrix::<f64, R, 3>::zeros(); v.len()];
            let jacobian = Jacobian { vertices: &mut dv, globals: &mut [] };
            let r = term.residual(i, &v, &[], Some(jacobian)).unwrap();
            let w = weight * term.weight(i) * loss.evaluate(r.norm_squared()).1;
            let mut row = DMatrix::zeros(R, gradient.len());
            for (&k, d) in stencil.iter().zip(&dv) {
                row.view_mut((0, 3 * k as usize), (R, 3)).copy_from(d);
            }
            *hessian += row.transpose() * &row * w;
            *gradient += row.transpose() * DVector::from_row_slice(r.as_slice()) * w;
        }
    }

    #[test]
    fn conjugate_gradients_end_where_the_direct_solver_does() {
        let (mesh, camera) = (sheet(33), camera());
        let rest = RestFaces::new(&mesh, 1600.0);
        let options = Options { cost_tolerance: 1e-10, ..Options::default() };
        let (found, _) = objective(&mesh, &rest, &camera).minimise(start(&mesh), &options);
        // Never oriented: solved directly.
        let mut direct = objective(&mesh, &rest, &camera);
        direct.prepare();
        let (expected, summary) = minimize(&mut direct, start(&mesh), &options);
        assert!(summary.cost().1 < 0.9 * summary.cost().0);
        // A match of 1 px is worth 0.13 mm here.
        let distance = farthest(&found, &expected);
        assert!(distance < 1e-3, "{distance} mm");
        assert!((found.globals[0] - 0.1).abs() < 1e-6);
    }

    #[test]
    fn a_kept_workspace_gives_what_a_fresh_one_does() {
        let camera = camera();
        for n in [12, 33] {
            let mesh = sheet(n);
            let rest = RestFaces::new(&mesh, 1600.0);
            let options = Options::default();
            let make = || objective(&mesh, &rest, &camera);
            let mut workspace = Workspace::default();
            let (fresh, _) = make().minimise_in(&mut workspace, start(&mesh), &options);
            let (again, _) = make().minimise_in(&mut workspace, start(&mesh), &options);
            assert_eq!(fresh, again);
            // An objective with pairs that the workspace does not know.
            let far = Smoothing::of_displacement(&Laplacian::new(&mesh), &mesh.positions, 100.0);
            let other = || make().plus(1.0, Loss::Norm, far.clone());
            let (kept, _) = other().minimise_in(&mut workspace, start(&mesh), &options);
            let (fresh, _) = other().minimise(start(&mesh), &options);
            assert!(farthest(&kept, &fresh) < 1e-6, "{}", farthest(&kept, &fresh));
        }
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let camera = camera();
        for n in [12, 33] {
            let mesh = sheet(n);
            let rest = RestFaces::new(&mesh, 1600.0);
            let solve = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    objective(&mesh, &rest, &camera).minimise(start(&mesh), &Options::default()).0
                })
            };
            assert_eq!(solve(1), solve(4));
        }
    }
}
