//! Hidden structures (a tumour, vessels) carried along by the surface above them.
//!
//! The surface's rigid motion is taken away, and what is left of its deformation is continued into
//! space by radial functions (Turk and O'Brien, *Modelling with implicit surfaces that
//! interpolate*): `f(x) = T x + b + Σ wⱼ |x − cⱼ|^1.5`, `Σ wⱼ = 0`, where `T` is rigid. The centres
//! `cⱼ` are the middles of patches of the template; `f` takes each from its place at rest to its
//! place in the frame. Rigid motions are continued exactly. The power stands between the biharmonic
//! 1, which creases at the surface, and 2, which would be an affine map; an affine part would fit
//! too, but under an open surface it turns small errors of the surface into large ones below. A
//! closed surface is not needed. Nothing is known of what the organ does inside: this is the
//! smoothest guess, not a simulation.
//!
//! ```
//! use dsfms::geometry::{Isometry, Point3, Vector3};
//! use dsfms::structures::Carrier;
//! use dsfms::synth::patch;
//! let rest = patch(300, 1).mesh;
//! let pose = Isometry::new(Vector3::new(1.0, 2.0, 70.0), Vector3::new(0.1, 0.2, 0.0));
//! let posed: Vec<Point3> = rest.positions.iter().map(|p| pose * p).collect();
//! let carrier = Carrier::new(&rest).unwrap();
//! let tumour = Point3::new(3.0, -2.0, 15.0);
//! let found = carrier.carry(&posed).unwrap().at(&tumour);
//! assert!((found - pose * tumour).norm() < 1e-6);
//! ```

mod patches;
pub(crate) use patches::patches;

use crate::geometry::{Isometry, Point3, Vector3, align_rigid};
use crate::mesh::Mesh;
use crate::mesh::surface_points::ClosestPoints;
use nalgebra::{DMatrix, Dyn, LU};

/// Centres of the radial functions; a surface with fewer vertices has one a vertex. The system is
/// factorised once, in time of its cube: under a second. Fewer or more are not measured.
const CENTRES: usize = 600;

/// Why structures cannot be carried.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StructureError {
    /// The vertices lie on a line, so that their motion says nothing about a place beside it.
    #[error("the template's {vertices} vertices lie on a line; structures need a surface")]
    Degenerate {
        /// Vertices of the template.
        vertices: usize,
    },
    /// Not the template's vertices.
    #[error("the surface has {found} vertices, but the template {expected}")]
    Count {
        /// In the template.
        expected: usize,
        /// Given.
        found: usize,
    },
}

/// The template's part of the continuation, computed once.
#[derive(Clone, Debug)]
pub struct Carrier {
    /// Vertices of each patch.
    patches: Vec<Vec<u32>>,
    vertices: usize,
    /// Middles of the patches at rest.
    centres: Vec<Point3>,
    /// Length unit of the system, which keeps it well conditioned.
    size: f64,
    system: LU<f64, Dyn, Dyn>,
}

impl Carrier {
    /// Prepare a template; lengths in any unit.
    ///
    /// # Errors
    /// [`StructureError::Degenerate`].
    #[doc(alias("augmented reality", "skinning"))]
    pub fn new(rest: &Mesh) -> Result<Self, StructureError> {
        let vertices = rest.positions.len();
        let patches = patches(&rest.positions, CENTRES);
        let centres = middles(&patches, &rest.positions);
        let size = centres.iter().map(|c| (c - centres[0]).norm()).fold(0.0, f64::max);
        let system = LU::new(matrix(&centres, size));
        if centres.len() < 4 || align_rigid(&centres, &centres).is_none() || !system.is_invertible()
        {
            return Err(StructureError::Degenerate { vertices });
        }
        Ok(Self { patches, vertices, centres, size, system })
    }

    /// The continuation of one deformed surface: the template's vertices in any axes.
    ///
    /// # Errors
    /// [`StructureError::Count`]; [`StructureError::Degenerate`] where they lie on a line.
    pub fn carry(&self, deformed: &[Point3]) -> Result<CarriedStructures<'_>, StructureError> {
        let vertices = deformed.len();
        if vertices != self.vertices {
            return Err(StructureError::Count { expected: self.vertices, found: vertices });
        }
        let moved = middles(&self.patches, deformed);
        let degenerate = StructureError::Degenerate { vertices };
        let rigid = align_rigid(&self.centres, &moved).ok_or(degenerate.clone())?;
        let mut left = DMatrix::zeros(moved.len() + 1, 3);
        let mut deformation = 0.0;
        for (i, (c, p)) in self.centres.iter().zip(&moved).enumerate() {
            left.row_mut(i).copy_from(&(p - rigid * c).transpose());
            deformation += (p - rigid * c).norm() / moved.len() as f64;
        }
        let weights = self.system.solve(&left).ok_or(degenerate)?;
        Ok(CarriedStructures { carrier: self, rigid, deformation, weights })
    }
}

/// The deformation of one frame, everywhere in space.
#[derive(Clone, Debug)]
pub struct CarriedStructures<'a> {
    carrier: &'a Carrier,
    rigid: Isometry,
    deformation: f64,
    /// A row per centre, then the constant.
    weights: DMatrix<f64>,
}

impl CarriedStructures<'_> {
    /// Mean distance of the surface from where its rigid motion alone would take it, length units.
    pub fn deformation(&self) -> f64 {
        self.deformation
    }

    /// The rigid part: the motion of the template that comes nearest to the surface.
    pub fn rigid(&self) -> Isometry {
        self.rigid
    }

    /// Where a point of the template frame goes.
    pub fn at(&self, p: &Point3) -> Point3 {
        let centres = &self.carrier.centres;
        let row = |i: usize| self.weights.fixed_view::<1, 3>(i, 0).transpose();
        let radial = |(i, c): (usize, &Point3)| row(i) * kernel((p - c).norm() / self.carrier.size);
        let offset: Vector3 = centres.iter().enumerate().map(radial).sum();
        self.rigid * p + offset + row(centres.len())
    }
}

/// How far under the surface a point lies, and the vertex nearest to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depth {
    /// Distance to the surface at rest, length units.
    pub distance: f64,
    /// Nearest corner of the nearest face.
    pub vertex: u32,
}

/// Depth of every point at rest; `None` for a surface without faces.
pub fn depths(rest: &Mesh, points: &[Point3]) -> Option<Vec<Depth>> {
    let surface = ClosestPoints::new(rest);
    let depth = |p: &Point3| {
        let on = surface.closest(p)?;
        let k = (0..3).max_by(|&a, &b| on.barycentric[a].total_cmp(&on.barycentric[b]))?;
        let vertex = rest.topology.faces[on.face as usize][k];
        Some(Depth { distance: on.distance, vertex })
    };
    points.iter().map(depth).collect()
}

/// What the interior does by itself, of the deformation, at the depth of the half extent.
const UNKNOWN_INTERIOR: f64 = 1.3;

/// Expected error of a carried point, length units: that of the surface above it, doubled at the
/// depth of the organ's half extent, and what the interior may do by itself, which grows with depth
/// and with `deformation` ([`CarriedStructures::deformation`]). Fitted on random maps of space (the
/// example `structures`).
pub fn expected_error(surface: f64, depth: f64, half_extent: f64, deformation: f64) -> f64 {
    let deep = depth / half_extent.max(f64::MIN_POSITIVE);
    (surface * (1.0 + deep)).hypot(UNKNOWN_INTERIOR * deformation * deep)
}

fn middles(patches: &[Vec<u32>], positions: &[Point3]) -> Vec<Point3> {
    let middle = |patch: &Vec<u32>| {
        let sum: Vector3 = patch.iter().map(|&v| positions[v as usize].coords).sum();
        Point3::from(sum / patch.len() as f64)
    };
    patches.iter().map(middle).collect()
}

/// Conditionally definite for powers below 2. Measured in `docs/results/structures.md`: 1.5 is as
/// good as 1 where the surface is rough, and better where it is known well.
fn kernel(distance: f64) -> f64 {
    distance * distance.sqrt()
}

/// `[k(|cᵢ − cⱼ|)  1;  1  0]`, lengths in `size`.
fn matrix(centres: &[Point3], size: f64) -> DMatrix<f64> {
    let n = centres.len();
    let mut a = DMatrix::zeros(n + 1, n + 1);
    for i in 0..n {
        for j in 0..i {
            let r = kernel((centres[i] - centres[j]).norm() / size);
            (a[(i, j)], a[(j, i)]) = (r, r);
        }
        (a[(i, n)], a[(n, i)]) = (1.0, 1.0);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;

    fn mesh(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
        let topology = Topology::new(points.len(), faces.to_vec()).unwrap();
        Mesh { topology: topology.into(), positions: points.iter().map(|p| (*p).into()).collect() }
    }

    #[test]
    fn vertices_on_a_line_are_refused() {
        let points: Vec<[f64; 3]> = (0..30).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let faces: Vec<[u32; 3]> = (0..28).map(|i| [i + i % 2, i + 1 - i % 2, i + 2]).collect();
        let error = Carrier::new(&mesh(&points, &faces)).unwrap_err();
        assert_eq!(error, StructureError::Degenerate { vertices: 30 });
    }

    fn rough_sheet() -> Mesh {
        let points: Vec<[f64; 3]> =
            (0..25).map(|i| [f64::from(i % 5), f64::from(i / 5), 0.3 * f64::from(i % 3)]).collect();
        let faces: Vec<[u32; 3]> = (0..4)
            .flat_map(|r| (0..4).map(move |c| [5 * r + c, 5 * r + c + 1, 5 * r + c + 5]))
            .collect();
        mesh(&points, &faces)
    }

    #[test]
    fn the_surface_itself_goes_where_it_went() {
        let rest = rough_sheet();
        let bent: Vec<Point3> = rest
            .positions
            .iter()
            .map(|p| p + Vector3::new(0.1 * p.y, 0.0, 0.2 * p.x * p.x))
            .collect();
        let carrier = Carrier::new(&rest).unwrap();
        let carried = carrier.carry(&bent).unwrap();
        for (p, q) in rest.positions.iter().zip(&bent) {
            assert!((carried.at(p) - q).norm() < 1e-9, "{p} {q}");
        }
    }

    #[test]
    fn depth_is_the_distance_to_the_surface() {
        let triangle = mesh(&[[0., 0., 0.], [4., 0., 0.], [0., 4., 0.]], &[[0, 1, 2]]);
        let found = depths(&triangle, &[Point3::new(2.5, 0.5, 3.0)]).unwrap();
        assert_eq!((found[0].distance, found[0].vertex), (3.0, 1));
    }

    #[test]
    fn the_error_grows_with_depth() {
        assert_eq!(expected_error(0.5, 0.0, 20.0, 3.0), 0.5);
        assert_eq!(expected_error(0.5, 20.0, 20.0, 0.0), 1.0);
        // 0.5 (1 + 1/2) and 1.3 * 2 / 2.
        assert!((expected_error(0.5, 10.0, 20.0, 2.0) - 0.75f64.hypot(1.3)).abs() < 1e-12);
    }

    #[test]
    fn the_deformation_is_what_no_rigid_motion_explains() {
        let rest = rough_sheet();
        let carrier = Carrier::new(&rest).unwrap();
        let pose = Isometry::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.2, 0.1, 0.4));
        let mut moved: Vec<Point3> = rest.positions.iter().map(|p| pose * p).collect();
        assert!(carrier.carry(&moved).unwrap().deformation() < 1e-9);
        for (i, p) in moved.iter_mut().enumerate() {
            p.z += if i % 2 == 0 { 0.1 } else { -0.1 };
        }
        let found = carrier.carry(&moved).unwrap().deformation();
        assert!((found - 0.1).abs() < 0.01, "{found}");
    }
}
