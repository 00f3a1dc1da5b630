//! The displacement of a volume in one frame, and the volume displaced.

use super::VoxelError;
use super::body::VoxelBody;
use super::grid::VoxelVolume;
use crate::geometry::{Isometry, Point3, Vector3, bounding_box};
use nalgebra::Matrix4;
use rayon::prelude::*;

/// What is taken of a volume between its voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// Trilinear.
    Linear,
    /// The nearest voxel: labels are not mixed.
    Nearest,
}

/// A slice of a warped volume.
#[derive(Clone, Debug, PartialEq)]
pub struct WarpedSlice {
    /// Voxels in the format of the volume, little-endian.
    pub bytes: Vec<u8>,
    /// Voxels of which no origin was found, since the deformation folds there.
    pub unsolved: usize,
}

/// How the voxels of a [`VoxelBody`] move in one frame, without the organ's rigid motion.
#[derive(Clone, Debug)]
pub struct VoxelMotion<'a> {
    body: &'a VoxelBody,
    /// Of the lattice's nodes, voxels.
    displacement: Vec<Vector3>,
    /// Of the surface's vertices, mm.
    surface_mm: Vec<f64>,
    /// Bounds of the displaced surface, voxels.
    bounds: [Point3; 2],
    /// Vertices that leave the lattice.
    lost: usize,
    /// From the template at rest to camera axes.
    rigid: Isometry,
}

/// Steps of the search for an origin, and when it has found it, voxels.
const MOST_STEPS: usize = 60;
const FOUND: f64 = 1e-3;

impl VoxelBody {
    /// The motion of one frame; `deformed`: the template's vertices in camera axes.
    ///
    /// # Errors
    /// [`VoxelError::Structure`] where they are not the template's, or lie on a line.
    pub fn motion(&self, deformed: &[Point3]) -> Result<VoxelMotion<'_>, VoxelError> {
        VoxelMotion::new(self, deformed)
    }
}

impl<'a> VoxelMotion<'a> {
    fn new(body: &'a VoxelBody, deformed: &[Point3]) -> Result<Self, VoxelError> {
        let carried = body.carrier.carry(deformed)?;
        let rigid = carried.rigid();
        let template_from_voxel = body.template_from_mesh.to_homogeneous()
            * body.mesh_from_world.matrix()
            * body.grid.world_from_voxel().matrix();
        // A product of invertible maps.
        let back = template_from_voxel.try_inverse().ok_or(VoxelError::NotFinite)?;
        let still = rigid.inverse();
        let moved = |p: &Point3| back.transform_point(&(still * carried.at(p)));
        let [surface, placed] = &body.surface;
        let displaced: Vec<Point3> = placed.par_iter().map(moved).collect();
        let linear = body.grid.linear();
        let surface_mm = surface.iter().zip(&displaced).map(|(p, q)| (linear * (q - p)).norm());
        Ok(Self {
            surface_mm: surface_mm.collect(),
            lost: displaced.iter().filter(|p| !body.lattice.holds(p)).count(),
            bounds: bounding_box(&displaced),
            displacement: (0..body.lattice.count())
                .into_par_iter()
                .map(|n| moved(&body.nodes[n]) - body.lattice.node(n))
                .collect(),
            rigid,
            body,
        })
    }

    /// Mean and largest displacement of the organ's surface, mm.
    pub fn surface_mm(&self) -> [f64; 2] {
        let sum: f64 = self.surface_mm.iter().sum();
        let largest = self.surface_mm.iter().copied().fold(0.0, f64::max);
        [sum / self.surface_mm.len().max(1) as f64, largest]
    }

    /// Vertices of the organ's surface that move so far that the volume does not follow.
    pub fn lost(&self) -> usize {
        self.lost
    }

    /// From the volume's world (RAS, mm), displaced, to camera axes in the template's unit: 4 x 4.
    pub fn camera_from_world(&self) -> Matrix4<f64> {
        self.rigid.to_homogeneous()
            * self.body.template_from_mesh.to_homogeneous()
            * self.body.mesh_from_world.matrix()
    }

    /// Where a place in voxels goes, voxels; the place need not lie in the organ.
    pub fn at(&self, place: &Point3) -> Point3 {
        place + self.body.lattice.at(&self.displacement, place)
    }

    /// Slice `k` of the displacement, one component (0 to 2) of a vector in mm in LPS axes (as ITK
    /// has them), i fastest: where the voxel's content goes. 0 where the organ is farther than two
    /// voxels away.
    pub fn field_slice(&self, component: usize, k: usize) -> Vec<f32> {
        let [nx, ny, _] = self.body.grid.size();
        let sign = if component < 2 { -1.0 } else { 1.0 };
        let row = self.body.grid.linear().row(component) * sign;
        let value = |i: usize| {
            if !self.body.near[i + nx * ny * k] {
                return 0.0;
            }
            let at = Point3::new((i % nx) as f64, (i / nx) as f64, k as f64);
            (row * self.body.lattice.at(&self.displacement, &at)).x as f32
        };
        (0..nx * ny).map(value).collect()
    }

    /// Slice `k` of the volume with the organ displaced, on the same grid, as it is stored: every
    /// voxel inside the displaced organ has the value of the place it comes from, every other one
    /// `background`. What leaves the grid is cut off.
    ///
    /// # Panics
    /// A volume on another grid than that of the body.
    pub fn warped_slice(
        &self,
        volume: &VoxelVolume,
        background: f64,
        sampling: Sampling,
        k: usize,
    ) -> WarpedSlice {
        assert_eq!(volume.grid(), &self.body.grid, "the volume that the body was prepared for");
        let [nx, ny, _] = self.body.grid.size();
        let mut slice = WarpedSlice { bytes: Vec::new(), unsolved: 0 };
        slice.bytes.reserve_exact(nx * ny * volume.kind().bytes());
        let [low, high] = self.bounds;
        for i in 0..nx * ny {
            let at = Point3::new((i % nx) as f64, (i / nx) as f64, k as f64);
            let mut value = background;
            // Between voxels the organ ends half a voxel beyond its last.
            if (0..3).all(|c| (low[c] - 1.0..=high[c] + 1.0).contains(&at[c])) {
                match self.origin(at) {
                    None => slice.unsolved += 1,
                    Some(from) if self.is_inside(&from) => {
                        value = sample(volume, &from, sampling);
                    }
                    Some(_) => {}
                }
            }
            volume.kind().put(value, &mut slice.bytes);
        }
        slice
    }

    /// The place that goes to `to`: a fixed point of `x = to − u(x)`, voxels.
    fn origin(&self, to: Point3) -> Option<Point3> {
        let mut from = to;
        for _ in 0..MOST_STEPS {
            let next = to - self.body.lattice.at(&self.displacement, &from);
            let step = (next - from).amax();
            from = next;
            if step < FOUND {
                return Some(from);
            }
        }
        None
    }

    /// Whether more than half of the surrounding voxels, by weight, lie in the organ.
    fn is_inside(&self, at: &Point3) -> bool {
        let size = self.body.grid.size();
        if !(0..3).all(|c| (-0.5..=size[c] as f64 - 0.5).contains(&at[c])) {
            return false;
        }
        let corners = self.body.grid.corners(at);
        let weight: f64 = corners.iter().filter(|c| self.body.inside[c.0]).map(|c| c.1).sum();
        weight >= 0.5
    }
}

fn sample(volume: &VoxelVolume, at: &Point3, sampling: Sampling) -> f64 {
    match sampling {
        Sampling::Nearest => volume.value(volume.grid().nearest(at)),
        Sampling::Linear => {
            let corners = volume.grid().corners(at).into_iter().filter(|c| c.1 > 0.0);
            corners.map(|(place, weight)| weight * volume.value(place)).sum()
        }
    }
}
