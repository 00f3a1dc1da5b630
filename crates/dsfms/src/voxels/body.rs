//! The organ in its volume and on its template, prepared once.

use super::VoxelError;
use super::grid::VoxelGrid;
use super::inside::{inside, widened};
use super::lattice::VoxelLattice;
use crate::geometry::{Point3, Similarity, Vector3};
use crate::mesh::Mesh;
use crate::structures::{Carrier, StructureError};
use nalgebra::Affine3;
use rayon::prelude::*;

/// Axes of a mesh that was made from the volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshAxes {
    /// x to the right, y to the front, z to the head: the world of NIfTI.
    Ras,
    /// x to the left, y to the back, z to the head: DICOM, and the meshes that 3D Slicer writes.
    Lps,
}

impl MeshAxes {
    /// `RAS` or `LPS`.
    pub fn label(self) -> &'static str {
        match self {
            Self::Ras => "RAS",
            Self::Lps => "LPS",
        }
    }

    fn other(self) -> Self {
        match self {
            Self::Ras => Self::Lps,
            Self::Lps => Self::Ras,
        }
    }

    /// From the world of the volume.
    fn of_world(self) -> Affine3<f64> {
        let signs = match self {
            Self::Ras => Vector3::repeat(1.0),
            Self::Lps => Vector3::new(-1.0, -1.0, 1.0),
        };
        Affine3::from_matrix_unchecked(nalgebra::Matrix4::new_nonuniform_scaling(&signs))
    }
}

/// The closed surface of the organ in the volume, and where it lies in the template.
#[derive(Clone, Debug)]
pub struct PlacedOrgan {
    /// In the mesh's axes, mm.
    pub mesh: Mesh,
    /// From the mesh's axes (mm) to the template's frame and unit.
    pub template_from_mesh: Similarity,
    /// Vertices in the template's frame and unit: where the map takes them, or bent beyond that.
    pub vertices: Vec<Point3>,
}

impl PlacedOrgan {
    /// Of a template in mm that is the organ's surface in the volume.
    pub fn template(mesh: &Mesh) -> Self {
        let vertices = mesh.positions.clone();
        Self { mesh: mesh.clone(), template_from_mesh: Similarity::identity(), vertices }
    }

    /// Whether the vertices are bent, by more than their size times 10⁻⁵.
    fn is_bent(&self, placed: &[Point3]) -> bool {
        let size = placed.iter().map(|p| (p - placed[0]).norm()).fold(0.0, f64::max);
        self.vertices.iter().zip(placed).any(|(a, b)| (a - b).norm() > 1e-5 * size)
    }

    /// Points of the mesh's axes in the template.
    fn place(&self, points: &[Point3]) -> Result<Vec<Point3>, StructureError> {
        let (expected, found) = (self.mesh.positions.len(), self.vertices.len());
        if expected != found {
            return Err(StructureError::Count { expected, found });
        }
        let place = |points: &[Point3]| -> Vec<Point3> {
            points.iter().map(|p| self.template_from_mesh * p).collect()
        };
        let placed = place(&self.mesh.positions);
        if !self.is_bent(&placed) {
            return Ok(place(points));
        }
        let carrier = Carrier::new(&self.mesh.with_positions(placed))?;
        let bent = carrier.carry(&self.vertices)?;
        Ok(place(points).par_iter().map(|p| bent.at(p)).collect())
    }
}

/// A volume's voxels, the organ among them, and what carries them.
#[derive(Clone, Debug)]
pub struct VoxelBody {
    pub(super) grid: VoxelGrid,
    pub(super) mesh_from_world: Affine3<f64>,
    pub(super) template_from_mesh: Similarity,
    pub(super) carrier: Carrier,
    pub(super) lattice: VoxelLattice,
    /// Nodes in the template.
    pub(super) nodes: Vec<Point3>,
    /// Vertices of the organ's surface, in voxels and in the template.
    pub(super) surface: [Vec<Point3>; 2],
    /// Voxels inside the organ.
    pub(super) inside: Vec<bool>,
    /// And those around them that share a cell with one, and one more.
    pub(super) near: Vec<bool>,
}

/// Voxels around the organ that move with it, so that what interpolates between voxels finds none
/// that stands.
const NEAR: usize = 2;

impl VoxelBody {
    /// Prepare a volume whose organ has a closed surface in `axes`; `template` at rest.
    ///
    /// # Errors
    /// [`VoxelError::Open`]; [`VoxelError::Beside`] where the surface lies elsewhere;
    /// [`VoxelError::Structure`] of a surface that carries nothing, or of an organ with another
    /// number of vertices in the template.
    pub fn new(
        grid: &VoxelGrid,
        axes: MeshAxes,
        template: &Mesh,
        organ: &PlacedOrgan,
    ) -> Result<Self, VoxelError> {
        let topology = &organ.mesh.topology;
        let edges = topology.edge_faces.iter().filter(|f| f[1] == u32::MAX).count();
        if edges > 0 || topology.faces.is_empty() {
            return Err(VoxelError::Open { edges });
        }
        let carrier = Carrier::new(template)?;
        let inverse = |axes: MeshAxes| (axes.of_world() * grid.world_from_voxel()).inverse();
        let in_voxels = |axes: MeshAxes| -> Vec<Point3> {
            organ.mesh.positions.iter().map(|p| inverse(axes) * p).collect()
        };
        let surface = in_voxels(axes);
        let within = inside(grid, &surface, &topology.faces);
        if !within.contains(&true) {
            let turned = axes.other();
            let others = inside(grid, &in_voxels(turned), &topology.faces);
            let others = others.iter().filter(|v| **v).count();
            return Err(VoxelError::Beside { turned, others });
        }
        let lattice = VoxelLattice::around(grid, &surface);
        let mesh_from_voxel = axes.of_world() * grid.world_from_voxel();
        let nodes: Vec<Point3> =
            (0..lattice.count()).map(|n| mesh_from_voxel * lattice.node(n)).collect();
        Ok(Self {
            mesh_from_world: axes.of_world(),
            template_from_mesh: organ.template_from_mesh,
            carrier,
            nodes: organ.place(&nodes)?,
            lattice,
            surface: [surface, organ.vertices.clone()],
            near: widened(grid.size(), &within, NEAR),
            inside: within,
            grid: grid.clone(),
        })
    }

    /// Voxels inside the organ.
    pub fn inside(&self) -> usize {
        self.inside.iter().filter(|v| **v).count()
    }

    /// Share of the surface's vertices that lie within the volume, 0 to 1.
    pub fn covered(&self) -> f64 {
        let size = self.grid.size();
        let within = |p: &&Point3| (0..3).all(|c| (-0.5..=size[c] as f64 - 0.5).contains(&p[c]));
        let [surface, _] = &self.surface;
        surface.iter().filter(within).count() as f64 / surface.len() as f64
    }
}
