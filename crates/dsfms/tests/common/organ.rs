//! A procedural organ with a known preoperative state: closed, lobed, without symmetry; and what an
//! exploration shows of it after it has bent and been moved.

#![allow(dead_code, reason = "no test file needs all of it")]

use dsfms::Mesh;
use dsfms::geometry::{Point3, Similarity, Vector3};
use dsfms::mesh::normals::vertex_normals;
use dsfms::preoperative::LandmarkPair;
use dsfms::synth::Random;
use dsfms::synth::random::normal;

/// About 140 x 90 x 60 mm.
pub fn organ(rows: u32, columns: u32) -> Mesh {
    closed(rows, columns, |d| {
        let lobes = 1.0
            + 0.18 * (2.0 * d.x + 0.7).sin() * (1.5 * d.y).cos()
            + 0.12 * (3.1 * d.y - 0.4).sin()
            + 0.08 * (4.0 * d.x * d.z + 1.0).sin();
        Vector3::new(70.0 * d.x + 8.0 * d.x * d.x, 45.0 * d.y, 30.0 * d.z + 9.0 * d.x * d.y) * lobes
    })
}

/// A closed surface of latitudes and longitudes; `place` takes directions to mm.
pub fn closed(rows: u32, columns: u32, place: impl Fn(&Vector3) -> Vector3) -> Mesh {
    let mut directions = vec![-Vector3::z()];
    for r in 1..rows {
        let polar = std::f64::consts::PI * f64::from(r) / f64::from(rows);
        for c in 0..columns {
            let around = std::f64::consts::TAU * f64::from(c) / f64::from(columns);
            let (flat, up) = (polar.sin(), -polar.cos());
            directions.push(Vector3::new(flat * around.cos(), flat * around.sin(), up));
        }
    }
    directions.push(Vector3::z());
    let last = directions.len() as u32 - 1;
    let at = |r: u32, c: u32| 1 + (r - 1) * columns + c % columns;
    let mut faces = Vec::new();
    for c in 0..columns {
        faces.push([0, at(1, c + 1), at(1, c)]);
        faces.push([last, at(rows - 1, c), at(rows - 1, c + 1)]);
        for r in 1..rows - 1 {
            faces.push([at(r, c), at(r, c + 1), at(r + 1, c)]);
            faces.push([at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)]);
        }
    }
    let positions = directions.iter().map(|d| Point3::from(place(d))).collect();
    Mesh::new(positions, faces).unwrap()
}

/// A smooth deformation of space of up to about `size` mm.
pub fn bent(p: &Point3, size: f64) -> Point3 {
    let wave = Vector3::new(
        (0.03 * p.y + 0.5).sin(),
        0.6 * (0.025 * p.x - 0.3).cos(),
        (0.028 * p.x + 0.02 * p.y).sin(),
    );
    p + wave * (0.6 * size)
}

/// What the exploration saw.
pub struct Explored {
    /// Seen part, bent, noisy, in the template's frame and unit.
    pub template: Mesh,
    /// `ct_from_template` of what has not bent.
    pub truth: Similarity,
    pub deformation: f64,
}

impl Explored {
    /// The side of `organ` that faces `view`, bent by `deformation` mm, with `noise` mm, where
    /// `truth` (from template to organ) takes it from.
    pub fn of(
        organ: &Mesh,
        view: Vector3,
        deformation: f64,
        noise: f64,
        truth: Similarity,
    ) -> Self {
        let normals = vertex_normals(&organ.topology, &organ.positions);
        let seen = |f: &usize| {
            organ.topology.faces[*f].iter().all(|&v| normals[v as usize].dot(&view) > 0.1)
        };
        let faces: Vec<usize> = (0..organ.topology.faces.len()).filter(seen).collect();
        let (part, _) = organ.subset(&faces);
        let part = dsfms::mesh::components::largest_component(&part).0;
        let mut random = Random::new(3, 1);
        let mut shaken = |p: &Point3| {
            let jitter = Vector3::from_fn(|_, _| noise * normal(&mut random));
            truth.inverse() * (bent(p, deformation) + jitter)
        };
        let positions = part.positions.iter().map(&mut shaken).collect();
        Self { template: part.with_positions(positions), truth, deformation }
    }

    /// Where a point of the organ truly is now, template frame.
    pub fn now(&self, p: &Point3) -> Point3 {
        self.truth.inverse() * bent(p, self.deformation)
    }

    /// `count` landmarks on the seen part of the organ, picked on both sides with `sigma` mm in
    /// all; those numbered in `wrong` are `off` mm off.
    pub fn landmarks(
        &self,
        organ: &Mesh,
        count: usize,
        sigma: f64,
        wrong: &[usize],
        off: f64,
    ) -> Vec<LandmarkPair> {
        let mut random = Random::new(11, 2);
        let surface = dsfms::mesh::surface_points::ClosestPoints::new(&self.template);
        let scale = self.truth.scaling();
        let seen: Vec<&Point3> = organ
            .positions
            .iter()
            .filter(|p| surface.closest(&self.now(p)).unwrap().distance * scale < 2.0)
            .collect();
        (0..count)
            .map(|k| {
                let p = seen[(k * 977 + 331) % seen.len()];
                let jitter = Vector3::from_fn(|_, _| sigma / 3f64.sqrt() * normal(&mut random));
                let astray = if wrong.contains(&k) {
                    Vector3::new(off, -off, off) / 3f64.sqrt()
                } else {
                    Vector3::zeros()
                };
                LandmarkPair {
                    name: format!("L{k}"),
                    ct: p + jitter + astray,
                    template: self.now(p),
                }
            })
            .collect()
    }
}

/// Root mean square of distances.
pub fn rms(distances: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = distances.fold((0.0, 0), |(sum, n), d| (sum + d * d, n + 1));
    (sum / f64::from(count.max(1))).sqrt()
}
