//! NIfTI-1 volumes (`.nii`, `.nii.gz`): a header of 348 bytes, and numbers.
//!
//! Read are volumes of three axes (further ones of length 1) in either byte order, of whole numbers
//! of 8 to 32 bits or floats of 32 or 64. Where they lie is said by `sform`, else by `qform`, in
//! mm, m or µm; a file with neither is refused, as its voxels have no place. `scl_slope` and
//! `scl_inter` are kept and not applied. Written are a volume with the header that it was read
//! with, and displacement fields as ITK and ANTs have them. Packed or not is told by content.
//!
//! Bounds: a regular file, 2²⁹ voxels, 1 GiB of them unpacked; memory is taken as data come, not as
//! the header states.

mod header;
mod place;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use read::{NiftiFile, read_nifti, read_nifti_from};
pub use write::{write_displacement, write_warped};
