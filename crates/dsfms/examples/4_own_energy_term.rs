//! An energy term that the library does not have: the distance of vertices from the camera, as a
//! range sensor measures it, beside the lines of eq. 3.
//!
//!     cargo run --example 4_own_energy_term

use dsfms::energy::check::assert_jacobian;
use dsfms::energy::{Anisotropy, EnergyTerm, Infeasible, Jacobian, Objective, Shearing};
use dsfms::energy::{Smoothing, Stretch, Unknowns};
use dsfms::geometry::Point3;
use dsfms::nalgebra::Vector1;
use dsfms::register::{RegisterOptions, Scene, pose};
use dsfms::solver::{Loss, Options};
use dsfms::synth::Case;
use std::error::Error;

/// `r = (‖vᵢ‖ − dᵢ) / σ`: vertex `i` lies `dᵢ` from the camera, which is the origin.
struct Range {
    vertices: Vec<[u32; 1]>,
    distances: Vec<f64>,
    sigma: f64,
}

impl EnergyTerm<1> for Range {
    fn count(&self) -> usize {
        self.distances.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.vertices[i]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 1>>,
    ) -> Result<Vector1<f64>, Infeasible> {
        let distance = v[0].coords.norm();
        if let Some(j) = jacobian {
            j.vertices[0] = v[0].coords.transpose() / (distance * self.sigma);
        }
        Ok(Vector1::new((distance - self.distances[i]) / self.sigma))
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}

/// Root mean square error in the deformed zone without and with the term, mm.
pub fn run() -> Result<[f64; 2], Box<dyn Error>> {
    let (case, options) = (Case::example(4), RegisterOptions::default());
    let rest = &case.template.mesh;
    let posed = pose(&case.camera, rest, &case.matches, &options, 0)?;
    let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
    let scene = Scene::new(&case.camera, rest, rigid);
    // At every third vertex: exact here, believed to 0.05 mm.
    Ok([0.0, 1.0].map(|weight| {
        let measured = (0..).zip(&case.truth).step_by(3);
        let (vertices, distances) = measured.map(|(v, p)| ([v], p.coords.norm())).unzip();
        let range = Range { vertices, distances, sigma: 0.05 };
        assert_jacobian(&range, &scene.posed, &[]);
        let (prior, faces, area) = (&options.prior, scene.faces(), scene.visible_area);
        let smoothing = Smoothing::of_displacement(&scene.laplacian, &scene.posed, area);
        let start = Unknowns { vertices: scene.posed.clone(), globals: vec![] };
        let (found, report) = Objective::over(scene.posed.len(), 0)
            .plus("motion", 1.0, Loss::Huber(2.0), scene.motion(&case.matches, 1.0))
            .plus("shearing", prior.conformal, Loss::Squared, Shearing { rest: faces })
            .plus("anisotropy", prior.conformal, Loss::Squared, Anisotropy { rest: faces })
            .plus("stretch", prior.stretch, Loss::Squared, Stretch { rest: faces })
            .plus("smoothing", prior.smoothing, Loss::Squared, smoothing)
            .plus("range", weight, Loss::Squared, range)
            .minimise(start, &Options::default());
        let error = case.zone_rms(&found.vertices);
        println!("weight {weight}: {error:.3} mm in the deformed zone; {:?}", report.stop);
        error
    }))
}
