//! The cases of an experiment: what is drawn from a seed, and what every case shares.

use super::random::{Random, uniform};
use super::{Admitted, Attraction, Case, CaseOptions, Draw, ExtensionOf, Patch, deform_to, patch};
use crate::geometry::{Point3, Vector3};
use crate::light::{LightModel, PointLight, RingLight, Spot};
use crate::mesh::Mesh;
use crate::mesh::boundary::boundary_loops;
use crate::mesh::normals::vertex_normals;
use serde::{Deserialize, Serialize};

/// The light of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightKind {
    /// Along the optical axis (the paper).
    Distant,
    /// A point 3 mm above the camera with inverse-square fall-off, full light at 75 mm.
    Near,
    /// A ring of 4 mm radius around the lens with inverse-square fall-off, full light at 75 mm.
    Ring,
}

impl LightKind {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Distant, Self::Near, Self::Ring];

    /// As options and experiment files call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Distant => "distant",
            Self::Near => "near",
            Self::Ring => "ring",
        }
    }

    /// The light of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|light| light.name() == name)
    }

    /// The light model.
    pub fn model(self) -> LightModel {
        let (reference_distance, spot) = (75.0, Spot::Isotropic);
        match self {
            Self::Distant => LightModel::default(),
            Self::Near => {
                let positions = vec![Point3::new(0.0, -3.0, 0.0)];
                PointLight { positions, reference_distance, spot }.into()
            }
            Self::Ring => {
                let centre = Point3::origin();
                RingLight { radius: 4.0, centre, reference_distance, spot }.into()
            }
        }
    }
}

/// What all cases of a series have in common.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Protocol {
    /// Vertices of the template.
    pub vertices: usize,
    /// Light.
    pub light: LightKind,
    /// Number of matches.
    pub matches: usize,
    /// Matches anywhere, not only outside the deformed zone.
    pub everywhere: bool,
    /// What the extension states: the largest edge-length change in the zone, or the mean one,
    /// which is about 0.45 of it.
    pub extension_of: ExtensionOf,
    /// Attraction points of a case, all pulling or all pushing.
    pub attractions: usize,
    /// Radius of the surface that one attraction point moves, mm.
    pub reach: f64,
    /// Distance of the attraction points from the surface, mm: least and most.
    pub height: [f64; 2],
    /// Seed of the series; case `i` is the same organ, place, direction and pose at any extension,
    /// light and noise.
    pub seed: u64,
}

impl Default for Protocol {
    fn default() -> Self {
        Self {
            vertices: 334,
            light: LightKind::Distant,
            matches: 25,
            everywhere: false,
            extension_of: ExtensionOf::Largest,
            attractions: 1,
            reach: 11.0,
            height: [18.0, 22.0],
            seed: 0,
        }
    }
}

/// One set of conditions: a column of Fig. 5.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Relative edge-length change in the deformed zone, percent; which one, the protocol says.
    pub extension: f64,
    /// Gaussian noise of the matches, px.
    pub noise: f64,
}

impl Protocol {
    /// The seed of a case.
    pub fn case_seed(&self, index: usize) -> u64 {
        let mut random = Random::new(self.seed, 0xE0_0000 + index as u64);
        random.below(1 << 62) as u64
    }

    /// Case `index` of a cell on the synthetic patch.
    pub fn case(&self, cell: Cell, index: usize) -> Case {
        let seed = self.case_seed(index);
        self.case_on(patch(self.vertices, seed), cell, index)
    }

    /// Case `index` of a cell on an organ (rest shape about the origin, outward normals along −z).
    /// Cases of even number pull towards the camera, the others push away from it.
    pub(crate) fn case_on(&self, organ: Patch, cell: Cell, index: usize) -> Case {
        let seed = self.case_seed(index);
        let mut random = Random::new(seed, 0xCA5E);
        let options = CaseOptions {
            vertices: self.vertices,
            extension: 0.01 * cell.extension,
            light: self.light.model(),
            draw: Draw { count: self.matches, sigma_px: cell.noise },
            pull: index.is_multiple_of(2),
        };
        let attractions = self.attractions_on(&organ.mesh, options.pull, &mut random);
        let deformation =
            deform_to(&organ.mesh, &attractions, options.extension, self.extension_of, 0.0);
        let admitted = if self.everywhere { Admitted::Everywhere } else { Admitted::Calm };
        Case::of(organ, deformation, &options, admitted, seed, &mut random)
    }

    /// Attraction points above (or below) vertices at least one reach from the boundary, the
    /// directions within about 0.2 rad of the surface normal.
    fn attractions_on(&self, mesh: &Mesh, pull: bool, random: &mut Random) -> Vec<Attraction> {
        let normals = vertex_normals(&mesh.topology, &mesh.positions);
        let places = inner_vertices(mesh, self.reach);
        let sign = if pull { 1.0 } else { -1.0 };
        let [least, most] = self.height;
        (0..self.attractions)
            .map(|_| {
                let v = places[random.below(places.len())];
                let mut tilt = || 0.4 * (uniform(random) - 0.5);
                let lean = Vector3::new(tilt(), tilt(), tilt());
                let direction = (normals[v] * sign + lean).normalize();
                let height = least + (most - least) * uniform(random);
                let point = mesh.positions[v] + direction * height;
                Attraction { direction, point, angle: (self.reach / height).atan() }
            })
            .collect()
    }
}

/// Vertices at least `margin` from the boundary; the one farthest from it where there are none.
fn inner_vertices(mesh: &Mesh, margin: f64) -> Vec<usize> {
    let rim: Vec<u32> = boundary_loops(&mesh.topology).concat();
    let distance = |v: usize| {
        let away = |&r: &u32| (mesh.positions[r as usize] - mesh.positions[v]).norm();
        rim.iter().map(away).fold(f64::INFINITY, f64::min)
    };
    let distances: Vec<f64> = (0..mesh.positions.len()).map(distance).collect();
    let inner: Vec<usize> = (0..distances.len()).filter(|&v| distances[v] >= margin).collect();
    if !inner.is_empty() {
        return inner;
    }
    (0..distances.len())
        .max_by(|&a, &b| distances[a].total_cmp(&distances[b]))
        .into_iter()
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_keeps_its_draws_in_every_cell() {
        let protocol = Protocol { vertices: 120, ..Default::default() };
        let at = |extension, noise| protocol.case(Cell { extension, noise }, 3);
        let (small, large) = (at(5.0, 1.0), at(20.0, 4.0));
        assert_eq!(small.deformation.zone, large.deformation.zone);
        assert!((small.deformation.largest_extension - 0.05).abs() < 1e-6);
        assert!((large.deformation.largest_extension - 0.2).abs() < 1e-6);
        // Far from the zone nothing moved, so both cases show the pose: the same one.
        let calm = small.deformation.zone.iter().position(|z| !z).unwrap();
        let moved = (small.truth[calm] - large.truth[calm]).norm();
        assert!(moved < 1.0, "{moved}");
        for m in &small.matches {
            let face = small.template.mesh.topology.faces[m.face as usize];
            assert!(face.iter().all(|&v| !small.deformation.zone[v as usize]));
        }
    }

    #[test]
    fn even_cases_pull_and_odd_ones_push() {
        let protocol = Protocol { vertices: 200, ..Default::default() };
        for index in 0..4 {
            let case = protocol.case(Cell { extension: 10.0, noise: 1.0 }, index);
            let rest = &case.template.mesh.positions;
            let moved = case.deformation.vertices.iter().zip(rest).map(|(a, b)| (a - b).z);
            // Towards the camera is −z.
            let sum: f64 = moved.sum();
            assert_eq!(sum < 0.0, index % 2 == 0, "case {index}: {sum}");
        }
    }
}
