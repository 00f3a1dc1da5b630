//! Normals and surface, corrected by the shading of all views.
//!
//! Where a reconstructed normal is a few degrees off, each view says another albedo, as the light
//! moves with the camera. Displacements `h` of the vertices along their normals are found with
//!
//! ```text
//! min_h,a,μ Σ ρ(ln I_o − ln g_v − ln m(x, n(h)) − a_s) / σ² + Σ_s (a_s − μ)² / (P ς²)
//!           + B Σ_v (mean_ring(h) − h_v)² / ℓ² + R Σ_v h_v²
//! ```
//!
//! over observations `o` of surface spots `s`. The first term is what the views say; the second, of
//! the spread `ς` of the albedos themselves, speaks where one view sees the surface (`P` spots
//! share one albedo); the others keep the shape stiff and in place. The albedo is measured under
//! these normals. The surface itself moves only within what stereo knows of it (`R` is `1/σ_v²`
//! where that is more): brightness says little of where it is. Gauss–Newton with Tukey's weights,
//! inner steps by conjugate gradients.

mod block;

use super::known_light::{FittedExposure, KnownLight};
use super::normal_map::NormalMap;
use super::photometric::AlbedoView;
use super::spots::{SurfaceSpot, smoothed_normals};
use crate::geometry::{Point3, Vector3};
use crate::mesh::Mesh;
use crate::solver::conjugate_gradients::{Goal, System, conjugate_gradients};
use block::{ReliefRow, SpotBlock, block, scales};
use nalgebra::Vector4;
use rayon::prelude::*;

/// Bending: one over the square of the angle, rad, by which a corrected surface kinks at an edge
/// (3.3 degrees).
const BENDING: f64 = 300.0;
/// Holding, times the surface's area, on a mesh of 1000 vertices: displacements of a 57th of the
/// root of the area.
const HOLDING: f64 = 3200.0;
/// Largest correction of a normal, rad (10 degrees): with narrow parallax an error of the light
/// model would ask for more.
const LARGEST_TILT: f64 = 0.175;
/// Largest displacement, standard deviations; nor more than an edge, whatever is known.
const FARTHEST: f64 = 3.0;
/// Of Gauss–Newton, a bound on time.
const ROUNDS: usize = 6;
/// Of conjugate gradients; a bound on time.
const STEPS: usize = 100;

/// Vertex normals as the shading of all views has them, smoothed as the mesh's own.
pub(super) fn shaded_normals(
    mesh: &Mesh,
    spots: &[SurfaceSpot],
    views: &[AlbedoView],
    exposure: &FittedExposure,
    model: &KnownLight,
) -> Vec<Vector3> {
    let relief = Relief::new(mesh, spots, views, exposure, model);
    let own = smoothed_normals(mesh, model.options.normal_smoothing);
    let (_, shaded) = relief.solve(exposure.noise);
    shaded.iter().zip(&own).map(|(n, own)| limited(n, own)).collect()
}

/// The vertices as the shading of all views has them, each held where it is within its `sigma`
/// (length units; infinity where nothing is known of it) and moved by no more than [`FARTHEST`] of
/// them or an edge.
pub(super) fn shaded_surface(
    mesh: &Mesh,
    sigma: &[f64],
    spots: &[SurfaceSpot],
    views: &[AlbedoView],
    exposure: &FittedExposure,
    model: &KnownLight,
) -> Vec<Point3> {
    let mut relief = Relief::new(mesh, spots, views, exposure, model);
    let known = |(hold, sigma): (&mut f64, &f64)| *hold = hold.max(1.0 / (sigma * sigma));
    relief.holding.iter_mut().zip(sigma).for_each(known);
    let (displacement, _) = relief.solve(exposure.noise);
    let moved = |v: usize| {
        let most = (FARTHEST * sigma[v]).min(relief.edge);
        mesh.positions[v] + relief.directions[v] * displacement[v].clamp(-most, most)
    };
    (0..sigma.len()).map(moved).collect()
}

/// A unit normal turned back to within [`LARGEST_TILT`] of the mesh's own.
fn limited(normal: &Vector3, own: &Vector3) -> Vector3 {
    let (cosine, across) = (own.dot(normal), normal - own * own.dot(normal));
    match across.try_normalize(0.0) {
        Some(across) if cosine < LARGEST_TILT.cos() => {
            own * LARGEST_TILT.cos() + across * LARGEST_TILT.sin()
        }
        _ => *normal,
    }
}

struct Relief<'a> {
    mesh: &'a Mesh,
    spots: &'a [SurfaceSpot],
    views: &'a [AlbedoView<'a>],
    gains: &'a [f64],
    model: &'a KnownLight<'a>,
    /// Vertices move along these.
    directions: Vec<Vector3>,
    /// Mean edge.
    edge: f64,
    /// Of every vertex: one over the square of its displacements.
    holding: Vec<f64>,
}

impl<'a> Relief<'a> {
    fn new(
        mesh: &'a Mesh,
        spots: &'a [SurfaceSpot],
        views: &'a [AlbedoView<'a>],
        exposure: &'a FittedExposure,
        model: &'a KnownLight<'a>,
    ) -> Self {
        let (count, area) = (mesh.positions.len(), mesh.face_areas().iter().sum::<f64>());
        // The same for the same surface, whatever the mesh.
        let holding = HOLDING / area * (1000.0 / count as f64);
        Self {
            mesh,
            spots,
            views,
            gains: &exposure.gains,
            model,
            directions: smoothed_normals(mesh, 0),
            edge: mesh.mean_edge_length(),
            holding: vec![holding; count],
        }
    }

    /// Displacements of the vertices, and vertex normals with them.
    fn solve(&self, noise: f64) -> (Vec<f64>, Vec<Vector3>) {
        let count = self.mesh.positions.len();
        let mut unknowns = vec![0.0; count + 1];
        let mut map = self.map(&unknowns[..count]);
        let mut rows = self.rows(map.normals());
        let Some(mut scales) = scales(&rows, noise) else {
            return (vec![0.0; count], map.normals().to_vec());
        };
        for _ in 0..ROUNDS {
            unknowns[count] = scales.mean;
            let changes = map.forward(&unknowns[..count]);
            let blocks: Vec<SpotBlock> = rows
                .par_iter()
                .zip(self.spots)
                .map(|(rows, spot)| block(rows, &self.at(spot, &changes), &scales))
                .collect();
            self.step(&map, &blocks, &mut unknowns);
            map = self.map(&unknowns[..count]);
            rows = self.rows(map.normals());
            scales = block::scales(&rows, scales.noise).unwrap_or(scales);
        }
        unknowns.truncate(count);
        (unknowns, map.normals().to_vec())
    }

    /// Normals and how they turn at these displacements.
    fn map(&self, displacement: &[f64]) -> NormalMap<'_> {
        let moved = self.mesh.positions.iter().zip(&self.directions).zip(displacement);
        let positions: Vec<Point3> = moved.map(|((p, n), h)| p + n * *h).collect();
        let rounds = self.model.options.normal_smoothing;
        NormalMap::new(&self.mesh.topology, &positions, &self.directions, rounds)
    }

    /// A vector of the vertices at a spot.
    fn at(&self, spot: &SurfaceSpot, values: &[Vector3]) -> Vector3 {
        let corners = self.mesh.topology.faces[spot.face];
        corners.iter().zip(spot.weights).map(|(&v, w)| values[v as usize] * w).sum()
    }

    fn rows(&self, normals: &[Vector3]) -> Vec<Vec<ReliefRow>> {
        self.spots
            .par_iter()
            .map(|spot| {
                let sum = self.at(spot, normals);
                let (length, normal) = (sum.norm(), sum.normalize());
                spot.seen
                    .iter()
                    .filter_map(|o| {
                        let rotation = self.views[o.view].posed.pose.rotation;
                        let shade = self.model.shade_of(&o.point, &(rotation * normal));
                        let light = self.gains[o.view] * shade.value;
                        let slope = rotation.inverse() * (shade.d_normal / shade.value);
                        let slope = (slope - normal * normal.dot(&slope)) / length;
                        let residual = (o.grey() / light).ln();
                        let row = ReliefRow { residual, slope, trust: o.weight };
                        (light > 0.0 && residual.is_finite() && slope.norm().is_finite())
                            .then_some(row)
                    })
                    .collect()
            })
            .collect()
    }

    /// Of the mesh's own stiffness.
    fn stiffness(&self, h: &[f64]) -> Vec<f64> {
        let topology = &self.mesh.topology;
        let ring_mean = |v: usize| {
            let ring = &topology.one_ring[v];
            ring.iter().map(|&j| h[j as usize]).sum::<f64>() / ring.len() as f64
        };
        let mut out: Vec<f64> = h.iter().zip(&self.holding).map(|(h, hold)| hold * h).collect();
        for v in 0..h.len() {
            let ring = &topology.one_ring[v];
            // Beyond the rim nothing says how the surface bends.
            if topology.boundary[v] || ring.is_empty() {
                continue;
            }
            let force = BENDING / (self.edge * self.edge) * (h[v] - ring_mean(v));
            out[v] += force;
            ring.iter().for_each(|&j| out[j as usize] -= force / ring.len() as f64);
        }
        out
    }

    /// The normal matrix times the unknowns: displacements, then the mean albedo.
    fn apply(&self, map: &NormalMap, blocks: &[SpotBlock], x: &[f64]) -> Vec<f64> {
        let (h, mean) = x.split_at(x.len() - 1);
        let changes = map.forward(h);
        let forces = self
            .spots
            .par_iter()
            .zip(blocks)
            .map(|(spot, block)| block.matrix * self.at(spot, &changes).push(mean[0]));
        let mut out = self.gather(map, &forces.collect::<Vec<_>>());
        out.iter_mut().zip(self.stiffness(h)).for_each(|(out, own)| *out += own);
        out
    }

    /// From the spots to the unknowns: the transpose of what takes unknowns to spots.
    fn gather(&self, map: &NormalMap, forces: &[Vector4<f64>]) -> Vec<f64> {
        let mut turns = vec![Vector3::zeros(); self.mesh.positions.len()];
        for (spot, force) in self.spots.iter().zip(forces) {
            for (&v, w) in self.mesh.topology.faces[spot.face].iter().zip(spot.weights) {
                turns[v as usize] += force.xyz() * w;
            }
        }
        let mut out = map.adjoint(turns);
        out.push(forces.iter().map(|f| f.w).sum());
        out
    }

    /// About the diagonal of the normal matrix.
    fn diagonal(&self, blocks: &[SpotBlock]) -> Vec<f64> {
        let bending = 1.2 * BENDING / (self.edge * self.edge);
        let mut diagonal: Vec<f64> = self.holding.iter().map(|hold| bending + hold).collect();
        let mut mean = f64::MIN_POSITIVE;
        for (spot, block) in self.spots.iter().zip(blocks) {
            let turn = 0.5 * block.matrix.fixed_view::<3, 3>(0, 0).trace() / self.edge.powi(2);
            for (&v, w) in self.mesh.topology.faces[spot.face].iter().zip(spot.weights) {
                diagonal[v as usize] += w * turn;
            }
            mean += block.matrix.m44;
        }
        diagonal.push(mean);
        diagonal
    }

    /// Gauss–Newton's displacements and mean albedo, from those before.
    fn step(&self, map: &NormalMap, blocks: &[SpotBlock], x: &mut [f64]) {
        let mut residual = self.gather(map, &blocks.iter().map(|b| b.right).collect::<Vec<_>>());
        let applied = self.apply(map, blocks, x);
        residual.iter_mut().zip(applied).for_each(|(r, a)| *r -= a);
        let diagonal = self.diagonal(blocks);
        let mut normal = ReliefSystem { relief: self, map, blocks, diagonal: &diagonal };
        conjugate_gradients(&mut normal, x, &mut residual, Goal::Share(1e-8), STEPS);
    }
}

/// The normal matrix at a linearisation.
struct ReliefSystem<'a> {
    relief: &'a Relief<'a>,
    map: &'a NormalMap<'a>,
    blocks: &'a [SpotBlock],
    diagonal: &'a [f64],
}

impl System<f64> for ReliefSystem<'_> {
    fn apply(&mut self, x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(&self.relief.apply(self.map, self.blocks, x));
    }

    fn precondition(&mut self, r: &[f64], out: &mut [f64]) {
        out.iter_mut().zip(r.iter().zip(self.diagonal)).for_each(|(out, (r, d))| *out = r / d);
    }
}

#[cfg(test)]
mod tests {
    use super::super::albedo::AlbedoOptions;
    use super::super::spots::{observe_spots, prepare};
    use super::super::test_scene::{bounds, patch, pictures};
    use super::*;
    use crate::light::{LightModel, PointLight, Spot as Profile};

    fn rms_angle(a: &[Vector3], b: &[Vector3]) -> f64 {
        let square = a.iter().zip(b).map(|(a, b)| a.cross(b).norm_squared());
        (square.sum::<f64>() / a.len() as f64).sqrt()
    }

    /// The patch photographed, a reconstruction of it that is up to a quarter of a millimetre off,
    /// and what `look` makes of that.
    fn seen<T>(
        views: usize,
        look: impl Fn(&Mesh, &[SurfaceSpot], &[AlbedoView], &FittedExposure, &KnownLight) -> T,
    ) -> (Mesh, Mesh, T) {
        let truth = patch();
        let light = LightModel::Point(PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Profile::Isotropic,
        });
        let pictures = pictures(&truth, &light, [1.0; 5]);
        let views: Vec<_> = pictures[..views].iter().map(|p| p.view()).collect();
        let wrong = |p: &Point3| {
            p + Vector3::z() * (0.25 * (0.6 * p.x + 0.3 * p.y).sin() * (0.5 * p.y).cos())
        };
        let mesh = truth.with_positions(truth.positions.iter().map(wrong).collect());
        let options = AlbedoOptions { bounds: bounds(), normal_smoothing: 0, ..Default::default() };
        let model = KnownLight { light: &light, options: &options };
        let normals = smoothed_normals(&mesh, 0);
        let prepared = prepare(&mesh, &views, &options.bounds);
        let spots = observe_spots(&mesh, &normals, &prepared, &light, &options.bounds, 2000);
        let exposure = FittedExposure { gains: vec![1.0; views.len()], noise: 0.05 };
        let found = look(&mesh, &spots, &views, &exposure, &model);
        (truth, mesh, found)
    }

    fn corrected(views: usize) -> [Vec<Vector3>; 3] {
        let (truth, mesh, found) = seen(views, shaded_normals);
        [smoothed_normals(&truth, 0), smoothed_normals(&mesh, 0), found]
    }

    /// Root mean square distances from the truth before and after, mm, with vertices known to
    /// `sigma`.
    fn refined(views: usize, sigma: f64) -> [f64; 2] {
        let (truth, mesh, found) = seen(views, |mesh, spots, views, exposure, model| {
            let sigma = vec![sigma; mesh.positions.len()];
            shaded_surface(mesh, &sigma, spots, views, exposure, model)
        });
        [&mesh.positions, &found].map(|shape| {
            let squares = shape.iter().zip(&truth.positions).map(|(a, b)| (a - b).norm_squared());
            (squares.sum::<f64>() / shape.len() as f64).sqrt()
        })
    }

    #[test]
    fn five_views_bring_the_surface_nearer_within_its_expected_error() {
        let [before, after] = refined(5, 0.15);
        assert!(before > 0.1 && after < 0.7 * before, "{before} mm before, {after} after");
        let [before, after] = refined(5, 0.001);
        assert!((before - after).abs() < 0.0031, "{before} mm before, {after} after");
        let [before, after] = refined(1, 0.15);
        assert!((before - after).abs() < 1e-12, "one view says nothing: {before}, {after}");
    }

    #[test]
    fn five_views_tell_the_normals() {
        let [truth, mesh, found] = corrected(5);
        let [before, after] = [rms_angle(&mesh, &truth), rms_angle(&found, &truth)];
        assert!(before > 0.05 && after < 0.5 * before, "{before} rad before, {after} after");
    }

    #[test]
    fn no_normal_turns_far() {
        let turned = |angle: f64| Vector3::new(angle.sin(), 0.0, angle.cos());
        assert_eq!(limited(&turned(0.1), &Vector3::z()), turned(0.1));
        assert!((limited(&turned(1.0), &Vector3::z()) - turned(LARGEST_TILT)).norm() < 1e-12);
    }

    #[test]
    fn one_view_says_nothing_to_compare() {
        let [_, mesh, found] = corrected(1);
        assert!(rms_angle(&mesh, &found) < 1e-12);
    }
}
