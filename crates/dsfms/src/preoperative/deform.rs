//! The preoperative surface bends until it meets the template.
//!
//! On a control mesh of it (about 800 vertices, the full mesh follows): its distance to the
//! template's points, which stays within a bound by the loss, against as-rigid-as-possible bending
//! and a pull to the place of the similarity that grows with the bound. What the template does not
//! show is carried along by the volume inside ([`Volume`]).

use super::options::PreoperativeOptions;
use super::target::{SurfaceSample, Target, extent};
use crate::energy::{AnchorPrior, Arap, EnergyTerm, Infeasible, Jacobian, Objective, Unknowns};
use crate::geometry::{Point3, SIGMA_OVER_MAD, Vector3, median, point_at};
use crate::mesh::Mesh;
use crate::mesh::decimate::{Decimated, decimate};
use crate::mesh::laplacian::Laplacian;
use crate::mesh::strain::face_strains;
use crate::register::Volume;
use crate::solver::{Loss, Options};
use nalgebra::{SMatrix, SVector};

/// Vertices of the control mesh.
const CONTROL: usize = 800;
/// Rounds of new correspondences.
const ROUNDS: usize = 8;
/// How firmly the unseen side hangs on its surroundings, as in the registration of frames.
const ANCHOR: f64 = 0.1;

/// The bent surface.
#[derive(Clone, Debug)]
pub struct Deformed {
    /// Vertices of the preoperative mesh, template frame and unit.
    pub vertices: Vec<Point3>,
    /// Largest displacement from the similarity, template units.
    pub largest: f64,
    /// 95th percentile of the strain of the faces.
    pub strain: f64,
}

/// Bend `placed` (the preoperative mesh where the similarity puts it, template frame) onto the
/// samples. `noise` of the samples and `bound` of the displacement in template units.
#[doc(alias("non-rigid ICP", "deformable registration"))]
pub fn deform(
    placed: &Mesh,
    samples: &[SurfaceSample],
    noise: f64,
    bound: f64,
    options: &PreoperativeOptions,
) -> Deformed {
    let control = match placed.positions.len() > CONTROL * 3 / 2 {
        true => decimate(placed, CONTROL),
        false => None,
    };
    let mut bending = Bending::new(placed, control.as_ref(), samples, noise, bound, options.strain);
    let mut shape = bending.rest.positions.clone();
    let mut cut = bound;
    for _ in 0..ROUNDS {
        let (next, shown) = bending.round(&shape, cut);
        shape = next;
        cut = (0.6 * cut).max(3.0 * shown.max(noise)).min(cut);
    }
    let shape = bending.settled(shape, cut);
    let vertices = carried(placed, control.as_ref(), &shape);
    let moves = vertices.iter().zip(&placed.positions).map(|(a, b)| (a - b).norm());
    let mut strains = face_strains(&placed.topology, &placed.positions, &vertices);
    strains.sort_unstable_by(f64::total_cmp);
    Deformed {
        largest: moves.fold(0.0, f64::max),
        strain: strains.get(strains.len() * 95 / 100).copied().unwrap_or(0.0),
        vertices,
    }
}

fn carried(placed: &Mesh, control: Option<&Decimated>, shape: &[Point3]) -> Vec<Point3> {
    let Some(control) = control else { return shape.to_vec() };
    let moves: Vec<Vector3> =
        shape.iter().zip(&control.mesh.positions).map(|(a, b)| a - b).collect();
    let moved = control.prolong(placed, &moves);
    placed.positions.iter().zip(moved).map(|(p, d)| p + d).collect()
}

/// What stays the same from round to round.
struct Bending<'a> {
    placed: &'a Mesh,
    control: Option<&'a Decimated>,
    /// The mesh that is solved on.
    rest: &'a Mesh,
    samples: &'a [SurfaceSample],
    arap: Arap,
    anchor: AnchorPrior,
    noise: f64,
    /// Weight of the bending prior.
    stiffness: f64,
}

impl<'a> Bending<'a> {
    fn new(
        placed: &'a Mesh,
        control: Option<&'a Decimated>,
        samples: &'a [SurfaceSample],
        noise: f64,
        bound: f64,
        strain: f64,
    ) -> Self {
        let rest = control.map_or(placed, |c| &c.mesh);
        let laplacian = Laplacian::new(rest);
        // The template's area, not the organ's: it is what the samples are shared over.
        let (_, size) = extent(samples.iter().map(|s| &s.point));
        let area = std::f64::consts::TAU * size * size;
        let anchor = AnchorPrior {
            vertices: (0..rest.positions.len() as u32).map(|v| [v]).collect(),
            reference: rest.positions.clone(),
            weights: laplacian.mass.iter().map(|m| m / area).collect(),
            sigma: bound,
        };
        let arap = Arap::new(&laplacian, &rest.positions, area);
        let stiffness = 1.0 / (strain * strain);
        Self { placed, control, rest, samples, arap, anchor, noise, stiffness }
    }

    /// New correspondences of all samples, and the shape that they ask for; second the standard
    /// deviation that they show.
    fn round(&mut self, shape: &[Point3], cut: f64) -> (Vec<Point3>, f64) {
        let contact = self.contact(shape);
        if contact.faces.is_empty() {
            return (shape.to_vec(), cut);
        }
        let shown = SIGMA_OVER_MAD * median(&mut contact.distances.clone()).unwrap_or(0.0);
        let start = Unknowns { vertices: shape.to_vec(), globals: Vec::new() };
        let options = Options { max_steps: 8, cost_tolerance: 1e-4, ..Options::default() };
        let (found, _) = Objective::over(shape.len(), 0)
            .plus("contact", 1.0, Loss::GemanMcClure(cut / self.noise), contact)
            .plus("as-rigid-as-possible prior", self.stiffness, Loss::Squared, self.arap.clone())
            .plus("anchor prior", 1.0, Loss::Squared, self.anchor.clone())
            .minimise(start, &options);
        (found.vertices, shown)
    }

    /// Where the samples lie on the full mesh, as a matter of the control mesh: what the one has
    /// beyond the other moves along.
    fn contact(&self, shape: &[Point3]) -> Contact {
        let full = self.placed.with_positions(carried(self.placed, self.control, shape));
        let target = Target::new(&full);
        let place = |sample: &SurfaceSample| {
            let hit = target.hit(&sample.point, &sample.normal)?;
            let corners = full.topology.faces[hit.place.face as usize];
            let (face, barycentric) = match self.control {
                None => (corners, hit.place.barycentric),
                Some(control) => {
                    let at = point_at(
                        self.placed.corners(hit.place.face as usize),
                        hit.place.barycentric,
                    );
                    let (face, b) = control.locate(&at, corners[0])?;
                    (control.mesh.topology.faces[face as usize], b)
                }
            };
            let on_control = point_at(face.map(|v| &shape[v as usize]), barycentric);
            let point = sample.point + (on_control - hit.place.point);
            Some((face, barycentric, point, hit.direction, hit.distance))
        };
        let mut contact = Contact {
            sigma: self.noise,
            share: 1.0 / self.samples.len().max(1) as f64,
            ..Default::default()
        };
        for (face, barycentric, point, direction, distance) in self.samples.iter().filter_map(place)
        {
            contact.faces.push(face);
            contact.barycentric.push(barycentric);
            contact.points.push(point);
            contact.directions.push(direction);
            contact.distances.push(distance);
        }
        contact
    }

    /// What no sample lies near is carried along by the rest.
    fn settled(&self, shape: Vec<Point3>, cut: f64) -> Vec<Point3> {
        let Some(volume) = Volume::of(self.rest) else { return shape };
        let contact = self.contact(&shape);
        let mut seen = vec![false; shape.len()];
        for (face, distance) in contact.faces.iter().zip(&contact.distances) {
            if *distance <= cut {
                face.iter().for_each(|&v| seen[v as usize] = true);
            }
        }
        volume.extrapolated(&self.rest.positions, &shape, &seen, ANCHOR).unwrap_or(shape)
    }
}

/// Points of the template on faces of the bent surface: `n·(Σ bₖ xₖ − p) / σ`, normals and places
/// of the round.
#[derive(Default)]
struct Contact {
    faces: Vec<[u32; 3]>,
    barycentric: Vec<[f64; 3]>,
    points: Vec<Point3>,
    directions: Vec<Vector3>,
    distances: Vec<f64>,
    sigma: f64,
    share: f64,
}

impl EnergyTerm<1> for Contact {
    fn count(&self) -> usize {
        self.faces.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.faces[i]
    }

    fn weight(&self, _: usize) -> f64 {
        self.share
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<SVector<f64, 1>, Infeasible> {
        let (n, b) = (self.directions[i], self.barycentric[i]);
        if let Some(j) = jacobian {
            for (out, b) in j.vertices.iter_mut().zip(b) {
                *out = SMatrix::<f64, 1, 3>::from(n.transpose() * (b / self.sigma));
            }
        }
        let at: Vector3 = v.iter().zip(b).map(|(p, b)| p.coords * b).sum();
        Ok(SVector::<f64, 1>::new(n.dot(&(at - self.points[i].coords)) / self.sigma))
    }
}

#[cfg(test)]
mod tests {
    use super::super::target::samples;
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch};

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        let lifted = mesh.with_positions(
            mesh.positions.iter().map(|p| p + Vector3::new(0.01, 0.02, 0.1)).collect(),
        );
        let points = samples(&lifted, 40);
        let bending = Bending::new(&mesh, None, &points, 0.3, 1.0, 0.05);
        let contact = bending.contact(&mesh.positions);
        assert!(contact.count() > 10);
        assert_jacobian(&contact, &mesh.positions, &[]);
    }
}
