//! A volume of the organ (CT, MRI) that follows its deformation.
//!
//! The motion inside is that of [`crate::structures`]: the surface's rigid motion, and the smooth
//! continuation of the rest. [`VoxelBody`] is prepared once: which voxels lie inside the closed
//! surface of the organ, and a lattice over its surroundings whose nodes are taken to the template.
//! [`VoxelBody::motion`] moves the nodes with the surface of one frame; between them the
//! displacement is trilinear. The rigid motion is taken away, so that the deformed organ stays in
//! the volume's own axes; [`VoxelMotion::camera_from_world`] brings it before the camera.
//!
//! The world of a volume is that of NIfTI: mm, x to the patient's right, y to the front, z to the
//! head (RAS). Outside the organ nothing is known, and nothing is moved.

mod body;
mod grid;
mod inside;
mod lattice;
mod motion;
#[cfg(test)]
mod tests;

pub use body::{MeshAxes, PlacedOrgan, VoxelBody};
pub use grid::{VoxelGrid, VoxelKind, VoxelVolume};
pub use motion::{Sampling, VoxelMotion, WarpedSlice};

use crate::structures::StructureError;

/// Why a volume cannot be carried.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VoxelError {
    /// A side without voxels, or more voxels than can be.
    #[error(
        "{0:?} voxels; expected 1 to 32767 a side and at most 2^29 in all; crop or resample the volume"
    )]
    Size([usize; 3]),
    /// The affine map holds NaN or infinity.
    #[error("the affine map from voxels to mm is not finite; export the volume again")]
    NotFinite,
    /// The affine map lays the volume flat.
    #[error(
        "the affine map from voxels to mm is singular (voxels of {0:?} mm); export the volume again"
    )]
    Singular([f64; 3]),
    /// Not as many bytes as the voxels take.
    #[error("{found} bytes of voxels; expected {expected}")]
    Bytes {
        /// By size and kind.
        expected: usize,
        /// Given.
        found: usize,
    },
    /// The organ's surface has a boundary.
    #[error(
        "the organ's surface is open ({edges} boundary edges), so that nothing lies inside it; expected a closed \
         mesh (fill its holes, or register a closed mesh of the volume to this template)"
    )]
    Open {
        /// Edges with one face.
        edges: usize,
    },
    /// No voxel lies inside the organ.
    #[error(
        "no voxel of the volume lies inside the organ's surface ({others} would with the mesh in {}); expected both \
         of one patient, in one place", turned.label()
    )]
    Beside {
        /// Axes that were not asked for.
        turned: MeshAxes,
        /// Voxels inside with these.
        others: usize,
    },
    /// The surface carries nothing.
    #[error(transparent)]
    Structure(#[from] StructureError),
}
