//! Edges laid along what the images show: of the two diagonals of a pair of faces the one whose
//! faces lie closer to the dense surface.
//!
//! Image-consistent triangulation (Morris and Kanade 2000) with the distance from the depth that
//! all images agreed on in place of their colours: a ridge is followed whether or not it is seen by
//! colour, and highlights, which move, have no say. Vertices stay.

use crate::geometry::{Point3, area_normal, point_at};
use crate::mesh::surface_points::ClosestPoints;
use crate::mesh::{Mesh, Topology};
use rayon::prelude::*;
use std::sync::Arc;

/// Rounds, each of flips that do not touch, at most.
const ROUNDS: usize = 10;
/// A flip must leave at most this much of the integral of the squared distance over both faces.
const LEFT: f64 = 0.8;
/// Distances below this share of the diagonal are not looked at.
const CLOSE: f64 = 1e-3;
/// Angles below this, degrees, are not made where they were not.
const LEAST_ANGLE_DEG: f64 = 25.0;
/// The angles that look at the new edge have at most this sum, degrees; Delaunay's is 180.
const OPPOSITE_DEG: f64 = 210.0;
/// Cosine, at least, between the new faces and both old ones taken together.
const SAME_SIDE: f64 = 0.7;
/// Neighbours that vertices keep, and have, at most, after a flip; one less on the boundary.
const NEIGHBOURS: [usize; 2] = [4, 8];

/// `mesh`, whose vertices lie on the dense surface, with edges flipped where the other diagonal of
/// their two faces explains it better: `∫ d²` over the faces, `d` the distance from `dense`, falls
/// by a fifth or more. Components, boundaries and handles are kept, faces stay nearly as even as
/// they were.
pub fn fit_diagonals(mesh: &Mesh, dense: &Mesh) -> Mesh {
    let dense = ClosestPoints::new(dense);
    let mut topology = Arc::clone(&mesh.topology);
    for _ in 0..ROUNDS {
        let round = FlipRound { topology: &topology, positions: &mesh.positions, dense: &dense };
        let flips = round.flips();
        if flips.is_empty() {
            break;
        }
        let mut faces = topology.faces.clone();
        for (edge, [a, b, c, d]) in flips {
            let [f, g] = topology.edge_faces[edge].map(|f| f as usize);
            (faces[f], faces[g]) = ([c, d, b], [d, c, a]);
        }
        topology = Arc::new(Topology::from_checked(mesh.positions.len(), faces));
    }
    Mesh { topology, positions: mesh.positions.clone() }
}

struct FlipRound<'a> {
    topology: &'a Topology,
    positions: &'a [Point3],
    dense: &'a ClosestPoints<'a>,
}

impl FlipRound<'_> {
    /// Edges to flip with their quadrilaterals, those of most gain first, none beside another.
    fn flips(&self) -> Vec<(usize, [u32; 4])> {
        let gain = |edge| {
            let quad = self.topology.quad(edge)?;
            Some((self.gain(quad)?, edge, quad))
        };
        let edges = 0..self.topology.edges.len();
        let mut gains: Vec<(f64, usize, [u32; 4])> =
            edges.into_par_iter().filter_map(gain).collect();
        gains.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut touched = vec![false; self.positions.len()];
        gains.retain(|(_, _, quad)| {
            let free = !quad.iter().any(|&v| touched[v as usize]);
            quad.iter().for_each(|&v| touched[v as usize] |= free);
            free
        });
        gains.into_iter().map(|(_, edge, quad)| (edge, quad)).collect()
    }

    /// By how much `∫ d²` falls; `None` where the edge has to stay.
    fn gain(&self, quad: [u32; 4]) -> Option<f64> {
        if !self.may_flip(quad) {
            return None;
        }
        let [a, b, c, d] = quad;
        let before = self.misfit([a, b, c]) + self.misfit([b, a, d]);
        let after = self.misfit([c, d, b]) + self.misfit([d, c, a]);
        let at = |v: u32| &self.positions[v as usize];
        let both =
            area_normal(at(a), at(b), at(c)).norm() + area_normal(at(b), at(a), at(d)).norm();
        let close = (CLOSE * (at(a) - at(b)).norm()).powi(2) * both;
        (after < LEFT * before && before - after > close).then_some(before - after)
    }

    /// `∫ d²` over a face whose corners lie on the dense surface: Simpson's rule of a triangle,
    /// exact to the third degree, of centre (9/20) and middles of the sides (2/15 each).
    fn misfit(&self, face: [u32; 3]) -> f64 {
        const PLACES: [([f64; 3], f64); 4] = [
            ([1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0], 9.0 / 20.0),
            ([0.0, 0.5, 0.5], 2.0 / 15.0),
            ([0.5, 0.0, 0.5], 2.0 / 15.0),
            ([0.5, 0.5, 0.0], 2.0 / 15.0),
        ];
        let corners = face.map(|v| &self.positions[v as usize]);
        let area = 0.5 * area_normal(corners[0], corners[1], corners[2]).norm();
        let square = |(weights, share): &([f64; 3], f64)| {
            let found = self.dense.closest(&point_at(corners, *weights));
            share * found.map_or(0.0, |found| found.distance.powi(2))
        };
        area * PLACES.iter().map(square).sum::<f64>()
    }

    /// Whether flipping keeps the topology, turns no face over and leaves faces as even as wanted.
    fn may_flip(&self, [a, b, c, d]: [u32; 4]) -> bool {
        let neighbours = |v: u32| {
            self.topology.one_ring[v as usize].len()
                + usize::from(self.topology.boundary[v as usize])
        };
        let kept = [a, b].iter().all(|&v| neighbours(v) > NEIGHBOURS[0]);
        let few = [c, d].iter().all(|&v| neighbours(v) < NEIGHBOURS[1]);
        if !kept || !few || self.topology.edge_index(c, d).is_some() {
            return false;
        }
        let [old, new] = [[[a, b, c], [b, a, d]], [[c, d, b], [d, c, a]]];
        let normal = |[i, j, k]: [u32; 3]| {
            let [p, q, r] = [i, j, k].map(|v| &self.positions[v as usize]);
            area_normal(p, q, r)
        };
        let both = normal(old[0]) + normal(old[1]);
        let same_side = new.iter().all(|&face| {
            let n = normal(face);
            n.dot(&both) > SAME_SIDE * n.norm() * both.norm()
        });
        let angles = |faces: [[u32; 3]; 2]| faces.map(|face| self.angles_deg(face));
        let least = |angles: [[f64; 3]; 2]| angles.into_iter().flatten().fold(180.0, f64::min);
        let (before, after) = (angles(old), angles(new));
        same_side
            && least(after) >= LEAST_ANGLE_DEG.min(least(before))
            && after[0][2] + after[1][2] <= OPPOSITE_DEG
    }

    /// Inner angles of a face at its corners, degrees.
    fn angles_deg(&self, face: [u32; 3]) -> [f64; 3] {
        let p = face.map(|v| self.positions[v as usize]);
        [0, 1, 2].map(|k| (p[(k + 1) % 3] - p[k]).angle(&(p[(k + 2) % 3] - p[k])).to_degrees())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::boundary::boundary_loops;
    use crate::mesh::remesh::{RemeshOptions, remesh};
    use crate::mesh::shapes;

    /// A roof with its ridge along the diagonal from (0, 0) to (1, 1), 0.2 high.
    fn roof(p: &Point3) -> Point3 {
        Point3::new(p.x, p.y, 0.2 - 0.2 * (p.x - p.y).abs())
    }

    #[test]
    fn the_diagonal_along_a_ridge_wins() {
        let mut dense = shapes::irregular_sheet(41);
        dense.positions.iter_mut().for_each(|p| *p = roof(p));
        // The corners with a margin of faces, so that enough neighbours are there.
        let n = 5u32;
        let id = |i: u32, j: u32| j * n + i;
        let at = |i: u32| f64::from(i) / f64::from(n - 1);
        let positions = (0..n * n).map(|v| roof(&Point3::new(at(v % n), at(v / n), 0.0))).collect();
        // Every diagonal across the ridge.
        let across = (0..(n - 1) * (n - 1)).flat_map(|q| {
            let (i, j) = (q % (n - 1), q / (n - 1));
            let [a, b, c, d] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            [[a, b, d], [b, c, d]]
        });
        let mesh = shapes::mesh(positions, across.collect());
        let fitted = fit_diagonals(&mesh, &dense);
        for k in 1..n - 2 {
            let edge = |a: u32, b: u32| fitted.topology.edge_index(a, b).is_some();
            assert!(edge(id(k, k), id(k + 1, k + 1)), "square {k}");
            assert!(!edge(id(k + 1, k), id(k, k + 1)), "square {k}");
        }
        // Off the ridge both diagonals lie on the roof: they stay.
        assert!(fitted.topology.edge_index(id(3, 1), id(2, 2)).is_some());
        assert_eq!(fit_diagonals(&fitted, &dense).topology, fitted.topology);
    }

    #[test]
    fn topology_boundary_and_evenness_stay_and_the_misfit_falls() {
        let mut dense = shapes::irregular_sheet(60);
        for p in &mut dense.positions {
            p.z = 0.1 * (9.0 * p.x + 4.0 * p.y).sin();
        }
        let mesh = remesh(&dense, 200, &RemeshOptions::default()).unwrap();
        let fitted = fit_diagonals(&mesh, &dense);
        assert!(Topology::new(mesh.positions.len(), fitted.topology.faces.clone()).is_ok());
        assert_ne!(fitted.topology.faces, mesh.topology.faces);
        assert_eq!(fitted.positions, mesh.positions);
        assert_eq!(fitted.topology.euler_characteristic(), 1);
        assert_eq!(boundary_loops(&fitted.topology), boundary_loops(&mesh.topology));
        let closest = ClosestPoints::new(&dense);
        let misfit = |m: &Mesh| {
            let round =
                FlipRound { topology: &m.topology, positions: &m.positions, dense: &closest };
            m.topology.faces.iter().map(|&f| round.misfit(f)).sum::<f64>()
        };
        assert!(misfit(&fitted) < 0.95 * misfit(&mesh), "{} {}", misfit(&fitted), misfit(&mesh));
        let area = |m: &Mesh| m.face_areas().iter().sum::<f64>();
        assert!((area(&fitted) / area(&mesh) - 1.0).abs() < 0.01);
        let least = |m: &Mesh| m.min_angles().into_iter().fold(f64::INFINITY, f64::min);
        assert!(least(&fitted) >= least(&mesh).min(LEAST_ANGLE_DEG.to_radians()));
    }

    #[test]
    fn the_integral_of_a_squared_distance_by_hand() {
        let dense = shapes::mesh(
            vec![
                Point3::new(-9.0, -9.0, 0.0),
                Point3::new(9.0, -9.0, 0.0),
                Point3::new(0.0, 9.0, 0.0),
            ],
            vec![[0, 1, 2]],
        );
        // z = 1 at one corner of a triangle over (0, 0), (1, 0), (0, 1): the rule leaves the
        // corners out, ∫ z² = A/6 but for 1/20 of its area.
        let p = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        let mesh = shapes::mesh(p.to_vec(), vec![[0, 1, 2]]);
        let closest = ClosestPoints::new(&dense);
        let round =
            FlipRound { topology: &mesh.topology, positions: &mesh.positions, dense: &closest };
        let area = mesh.face_areas()[0];
        assert!((round.misfit([0, 1, 2]) / area - (1.0 / 6.0 - 1.0 / 20.0)).abs() < 1e-12);
    }
}
