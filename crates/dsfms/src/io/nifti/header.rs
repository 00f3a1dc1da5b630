//! The 348 bytes, as offsets and numbers.

use crate::voxels::{VoxelKind, VoxelVolume};

/// Length of the header, and of header with the four bytes that say whether more follows.
pub(super) const LENGTH: usize = 348;
pub(super) const DATA: usize = LENGTH + 4;

// Offsets.
pub(super) const DIM: usize = 40;
pub(super) const INTENT: usize = 68;
pub(super) const DATATYPE: usize = 70;
pub(super) const BITPIX: usize = 72;
pub(super) const PIXDIM: usize = 76;
pub(super) const VOX_OFFSET: usize = 108;
pub(super) const SLOPE: usize = 112;
pub(super) const INTERCEPT: usize = 116;
pub(super) const UNITS: usize = 123;
pub(super) const CAL_MAX: usize = 124;
pub(super) const CAL_MIN: usize = 128;
pub(super) const DESCRIPTION: usize = 148;
pub(super) const QFORM: usize = 252;
pub(super) const SFORM: usize = 254;
pub(super) const QUATERNION: usize = 256;
pub(super) const Q_OFFSET: usize = 268;
pub(super) const ROWS: usize = 280;
pub(super) const INTENT_NAME: usize = 328;
pub(super) const MAGIC: usize = 344;

/// Labels, which are not mixed.
pub(super) const INTENT_LABEL: i16 = 1002;
/// A vector in every voxel.
pub(super) const INTENT_VECTOR: i16 = 1007;
/// Single precision.
pub(super) const FLOAT32: i16 = 16;

/// Code, kind.
pub(super) const KINDS: [(i16, VoxelKind); 8] = [
    (2, VoxelKind::U8),
    (4, VoxelKind::I16),
    (8, VoxelKind::I32),
    (FLOAT32, VoxelKind::F32),
    (64, VoxelKind::F64),
    (256, VoxelKind::I8),
    (512, VoxelKind::U16),
    (768, VoxelKind::U32),
];

/// A header in little-endian order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct NiftiHeader(pub [u8; LENGTH]);

impl NiftiHeader {
    /// Of a volume that no file held.
    pub(super) fn of(volume: &VoxelVolume) -> Self {
        let (grid, kind) = (volume.grid(), volume.kind());
        let mut header = Self([0; LENGTH]);
        header.set(0, &(LENGTH as i32).to_le_bytes());
        let size = grid.size().map(|n| n as i16);
        let dims = [3, size[0], size[1], size[2], 1, 1, 1, 1];
        dims.iter().enumerate().for_each(|(i, &n)| header.set_short(DIM + 2 * i, n));
        let code = KINDS.iter().find(|k| k.1 == kind).map_or(0, |k| k.0);
        header.set_short(DATATYPE, code);
        header.set_short(BITPIX, 8 * kind.bytes() as i16);
        header.set_float(PIXDIM, 1.0);
        let sides = grid.spacing();
        (1..4).for_each(|c| header.set_float(PIXDIM + 4 * c, sides[c - 1] as f32));
        header.set_float(SLOPE, 1.0);
        // mm, and the axes of a scanner.
        header.set(UNITS, &[2]);
        header.set_short(SFORM, 1);
        let map = grid.world_from_voxel().matrix();
        let at = |r: usize, c: usize| ROWS + 16 * r + 4 * c;
        (0..3).for_each(|r| (0..4).for_each(|c| header.set_float(at(r, c), map[(r, c)] as f32)));
        header.set(MAGIC, b"n+1\0");
        header
    }

    fn bytes<const N: usize>(&self, offset: usize) -> [u8; N] {
        std::array::from_fn(|i| self.0[offset + i])
    }

    pub(super) fn short(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.bytes(offset))
    }

    pub(super) fn float(&self, offset: usize) -> f64 {
        f32::from_le_bytes(self.bytes(offset)).into()
    }

    /// `count` floats in a row.
    pub(super) fn floats<const N: usize>(&self, offset: usize) -> [f64; N] {
        std::array::from_fn(|i| self.float(offset + 4 * i))
    }

    pub(super) fn set_short(&mut self, offset: usize, value: i16) {
        self.set(offset, &value.to_le_bytes());
    }

    pub(super) fn set_float(&mut self, offset: usize, value: f32) {
        self.set(offset, &value.to_le_bytes());
    }

    pub(super) fn set(&mut self, offset: usize, bytes: &[u8]) {
        self.0[offset..offset + bytes.len()].copy_from_slice(bytes);
    }

    /// From big-endian order.
    pub(super) fn turn(&mut self) {
        let short = [36, INTENT, DATATYPE, BITPIX, 74, 120, QFORM, SFORM];
        let shorts = short.into_iter().chain((DIM..DIM + 16).step_by(2));
        let long = [0, 32, 56, 60, 64];
        let runs = (PIXDIM..120).chain(CAL_MAX..DESCRIPTION).chain(QUATERNION..INTENT_NAME);
        let longs = long.into_iter().chain(runs.step_by(4));
        shorts.for_each(|at| self.0[at..at + 2].reverse());
        longs.for_each(|at| self.0[at..at + 4].reverse());
    }
}
