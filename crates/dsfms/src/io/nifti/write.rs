//! Writing, packed, slice by slice.

use super::header::{
    BITPIX, CAL_MAX, CAL_MIN, DATA, DATATYPE, DESCRIPTION, DIM, FLOAT32, INTENT, INTENT_NAME,
    INTENT_VECTOR, INTERCEPT, LENGTH, NiftiHeader, SLOPE, VOX_OFFSET,
};
use super::read::NiftiFile;
use crate::io::atomic::{WriteError, write_atomic};
use flate2::Compression;
use flate2::write::GzEncoder;
use rayon::prelude::*;
use std::io::Write;
use std::path::Path;

/// Slices that are made at once.
const BATCH: usize = 16;

/// Write a warped volume (`.nii.gz`) with the header of `source`; `slice` gives the little-endian
/// voxels of slice k, in the source's format. Slices are made in parallel and written in order.
///
/// # Errors
/// A file that cannot be written.
pub fn write_warped(
    path: &Path,
    source: &NiftiFile,
    slice: impl Fn(usize) -> Vec<u8> + Sync,
) -> Result<(), WriteError> {
    let mut header = source.header.clone();
    describe(&mut header, "dsfms: organ deformed, rigid motion removed");
    let [_, _, nz] = source.volume.grid().size();
    write(path, header, nz, slice)
}

/// Write a displacement field (`.nii.gz`) on the grid of `source`, as ITK and ANTs have them: five
/// axes, intent vector, single precision. `slice(component, k)` gives one component of slice k in
/// mm, LPS axes.
///
/// # Errors
/// A file that cannot be written.
pub fn write_displacement(
    path: &Path,
    source: &NiftiFile,
    slice: impl Fn(usize, usize) -> Vec<f32> + Sync,
) -> Result<(), WriteError> {
    let mut header = source.header.clone();
    header.set_short(DIM, 5);
    for (axis, length) in [(4, 1), (5, 3), (6, 1), (7, 1)] {
        header.set_short(DIM + 2 * axis, length);
    }
    header.set_short(INTENT, INTENT_VECTOR);
    header.set(INTENT_NAME, &[0; 16]);
    header.set_short(DATATYPE, FLOAT32);
    header.set_short(BITPIX, 32);
    for (field, value) in [(SLOPE, 1.0), (INTERCEPT, 0.0), (CAL_MAX, 0.0), (CAL_MIN, 0.0)] {
        header.set_float(field, value);
    }
    describe(&mut header, "dsfms: x + u(x) is where x goes; mm, LPS (ITK, ANTs)");
    let [_, _, nz] = source.volume.grid().size();
    write(path, header, 3 * nz, |n| {
        slice(n / nz, n % nz).into_iter().flat_map(f32::to_le_bytes).collect()
    })
}

fn describe(header: &mut NiftiHeader, text: &str) {
    let mut bytes = [0; 80];
    bytes[..text.len()].copy_from_slice(text.as_bytes());
    header.set(DESCRIPTION, &bytes);
}

fn write(
    path: &Path,
    mut header: NiftiHeader,
    slices: usize,
    slice: impl Fn(usize) -> Vec<u8> + Sync,
) -> Result<(), WriteError> {
    // Extensions of the source are left out.
    header.set_float(VOX_OFFSET, DATA as f32);
    write_atomic(path, |file| {
        let mut packed = GzEncoder::new(file, Compression::fast());
        packed.write_all(&header.0)?;
        packed.write_all(&[0; DATA - LENGTH])?;
        for start in (0..slices).step_by(BATCH) {
            let batch = start..slices.min(start + BATCH);
            let made: Vec<Vec<u8>> = batch.into_par_iter().map(&slice).collect();
            made.iter().try_for_each(|bytes| packed.write_all(bytes))?;
        }
        packed.finish().map(drop)
    })
}
