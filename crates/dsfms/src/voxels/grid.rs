//! Voxels and where they lie.

use super::VoxelError;
use crate::geometry::Point3;
use nalgebra::{Affine3, Matrix3, Vector3};

/// Most voxels of a volume, and of its sides (as NIfTI can state them).
const MOST_VOXELS: usize = 1 << 29;
const MOST_ALONG: usize = i16::MAX as usize;
/// Sides of a voxel that can be, mm.
const SIDES: std::ops::RangeInclusive<f64> = 1e-4..=1e4;
/// Share of the volume of a box with the same sides, below which a voxel is flat.
const FLAT: f64 = 1e-4;

/// A regular grid of voxels; voxel (i, j, k) stands at place `i + nx (j + ny k)`.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelGrid {
    size: [usize; 3],
    world_from_voxel: Affine3<f64>,
}

impl VoxelGrid {
    /// `world_from_voxel`: from indices of voxel centres to mm (RAS).
    ///
    /// # Errors
    /// [`VoxelError::Size`]; [`VoxelError::NotFinite`] and [`VoxelError::Singular`] of the map.
    pub fn new(size: [usize; 3], world_from_voxel: Affine3<f64>) -> Result<Self, VoxelError> {
        let all = size.iter().try_fold(1usize, |all, &n| all.checked_mul(n));
        let fits = all.is_some_and(|all| (1..=MOST_VOXELS).contains(&all));
        if !fits || size.iter().any(|&n| n > MOST_ALONG) {
            return Err(VoxelError::Size(size));
        }
        if !world_from_voxel.matrix().iter().all(|v| v.is_finite()) {
            return Err(VoxelError::NotFinite);
        }
        let grid = Self { size, world_from_voxel };
        let sides = grid.spacing();
        let solid = grid.linear().determinant().abs() > FLAT * sides.iter().product::<f64>();
        if !solid || !sides.iter().all(|side| SIDES.contains(side)) {
            return Err(VoxelError::Singular(sides));
        }
        Ok(grid)
    }

    /// Voxels along i, j and k.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// All voxels.
    pub fn count(&self) -> usize {
        self.size.iter().product()
    }

    /// From indices of voxel centres to mm (RAS).
    pub fn world_from_voxel(&self) -> &Affine3<f64> {
        &self.world_from_voxel
    }

    /// The same for differences.
    pub(super) fn linear(&self) -> Matrix3<f64> {
        self.world_from_voxel.matrix().fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Distances of neighbours along i, j and k, mm.
    pub fn spacing(&self) -> [f64; 3] {
        let linear = self.linear();
        [0, 1, 2].map(|c| Vector3::from(linear.column(c)).norm())
    }

    /// Corners of the cell around a place in voxels and their weights; at the border the nearest
    /// voxels.
    pub(super) fn corners(&self, at: &Point3) -> [(usize, f64); 8] {
        cell(self.size, at)
    }

    /// Place of the voxel nearest to a place in voxels.
    pub(super) fn nearest(&self, at: &Point3) -> usize {
        let [i, j, k] =
            [0, 1, 2].map(|c| at[c].round().clamp(0.0, (self.size[c] - 1) as f64) as usize);
        i + self.size[0] * (j + self.size[1] * k)
    }
}

/// Places and weights of the eight nodes around a point of a regular lattice, clamped to it.
pub(super) fn cell(size: [usize; 3], at: &Point3) -> [(usize, f64); 8] {
    let axis = |c: usize| {
        let x = at[c].clamp(0.0, (size[c] - 1) as f64);
        // NaN becomes 0.
        let low = (x as usize).min(size[c].saturating_sub(2));
        (low, (low + 1).min(size[c] - 1), x - low as f64)
    };
    let axes = [axis(0), axis(1), axis(2)];
    std::array::from_fn(|corner| {
        let pick = |c: usize| {
            let (low, high, t) = axes[c];
            if corner >> c & 1 == 0 { (low, 1.0 - t) } else { (high, t) }
        };
        let [(i, u), (j, v), (k, w)] = [pick(0), pick(1), pick(2)];
        (i + size[0] * (j + size[1] * k), u * v * w)
    })
}

/// Number format of voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VoxelKind {
    /// 8 bits, unsigned.
    U8,
    /// 8 bits, signed.
    I8,
    /// 16 bits, unsigned.
    U16,
    /// 16 bits, signed.
    I16,
    /// 32 bits, unsigned.
    U32,
    /// 32 bits, signed.
    I32,
    /// Single precision.
    F32,
    /// Double precision.
    F64,
}

/// The `i`th number of a slice of little-endian bytes.
fn number<const N: usize>(bytes: &[u8], i: usize) -> [u8; N] {
    bytes.as_chunks::<N>().0[i]
}

impl VoxelKind {
    /// Bytes of a voxel.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn get(self, bytes: &[u8], i: usize) -> f64 {
        match self {
            Self::U8 => bytes[i].into(),
            Self::I8 => i8::from_le_bytes(number(bytes, i)).into(),
            Self::U16 => u16::from_le_bytes(number(bytes, i)).into(),
            Self::I16 => i16::from_le_bytes(number(bytes, i)).into(),
            Self::U32 => u32::from_le_bytes(number(bytes, i)).into(),
            Self::I32 => i32::from_le_bytes(number(bytes, i)).into(),
            Self::F32 => f32::from_le_bytes(number(bytes, i)).into(),
            Self::F64 => f64::from_le_bytes(number(bytes, i)),
        }
    }

    /// Append a value, rounded to the nearest that the kind has.
    pub(super) fn put(self, value: f64, out: &mut Vec<u8>) {
        let whole = value.round();
        // `as` clamps to the range of the kind.
        match self {
            Self::U8 => out.push(whole as u8),
            Self::I8 => out.extend((whole as i8).to_le_bytes()),
            Self::U16 => out.extend((whole as u16).to_le_bytes()),
            Self::I16 => out.extend((whole as i16).to_le_bytes()),
            Self::U32 => out.extend((whole as u32).to_le_bytes()),
            Self::I32 => out.extend((whole as i32).to_le_bytes()),
            Self::F32 => out.extend((value as f32).to_le_bytes()),
            Self::F64 => out.extend(value.to_le_bytes()),
        }
    }
}

/// Voxels as they are stored: a scale of the file is not applied.
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelVolume {
    grid: VoxelGrid,
    kind: VoxelKind,
    /// Little-endian.
    bytes: Vec<u8>,
}

impl VoxelVolume {
    /// Little-endian bytes of all voxels, i fastest.
    ///
    /// # Errors
    /// [`VoxelError::Bytes`] where they are not as many as the grid has voxels.
    pub fn new(grid: VoxelGrid, kind: VoxelKind, bytes: Vec<u8>) -> Result<Self, VoxelError> {
        let (expected, found) = (grid.count() * kind.bytes(), bytes.len());
        if expected != found {
            return Err(VoxelError::Bytes { expected, found });
        }
        Ok(Self { grid, kind, bytes })
    }

    /// Where the voxels lie.
    pub fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    /// Format of the voxels.
    pub fn kind(&self) -> VoxelKind {
        self.kind
    }

    /// Little-endian bytes of all voxels.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The voxel at a place in the order of the grid.
    ///
    /// # Panics
    /// Beyond the last voxel.
    pub fn value(&self, place: usize) -> f64 {
        self.kind.get(&self.bytes, place)
    }

    /// Smallest and largest finite value; 0 where there is none.
    pub fn range(&self) -> [f64; 2] {
        let values = (0..self.grid.count()).map(|i| self.value(i)).filter(|v| v.is_finite());
        let all = values.fold(None, |range: Option<[f64; 2]>, v| {
            let [low, high] = range.unwrap_or([v, v]);
            Some([low.min(v), high.max(v)])
        });
        all.unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix4;

    fn map(rows: [[f64; 4]; 3]) -> Affine3<f64> {
        let row = |r: usize, c: usize| if r < 3 { rows[r][c] } else { f64::from(u8::from(c == 3)) };
        Affine3::from_matrix_unchecked(Matrix4::from_fn(row))
    }

    #[test]
    fn grids_that_cannot_be_are_refused() {
        let good = map([[-0.7, 0., 0., 9.], [0., 0.7, 0., 3.], [0., 0., 1.5, -4.]]);
        let grid = VoxelGrid::new([4, 3, 2], good).unwrap();
        assert_eq!((grid.spacing(), grid.count()), ([0.7, 0.7, 1.5], 24));
        for size in [[0, 3, 2], [usize::MAX, 2, 1], [32768, 1, 1], [32767, 32767, 1]] {
            assert_eq!(VoxelGrid::new(size, good), Err(VoxelError::Size(size)));
        }
        let nan = map([[f64::NAN, 0., 0., 0.], [0., 1., 0., 0.], [0., 0., 1., 0.]]);
        assert_eq!(VoxelGrid::new([2; 3], nan), Err(VoxelError::NotFinite));
        let flat = map([[1., 1., 0., 0.], [1., 1., 0., 0.], [0., 0., 1., 0.]]);
        assert!(matches!(VoxelGrid::new([2; 3], flat), Err(VoxelError::Singular(_))));
        let none = map([[0.; 4], [0., 1., 0., 0.], [0., 0., 1., 0.]]);
        assert_eq!(VoxelGrid::new([2; 3], none), Err(VoxelError::Singular([0.0, 1.0, 1.0])));
    }

    #[test]
    fn weights_of_a_cell_by_hand() {
        let found = cell([3, 2, 1], &Point3::new(1.25, 0.5, 7.0));
        let mut weight = [0.0; 6];
        found.iter().for_each(|&(place, w)| weight[place] += w);
        assert_eq!(weight, [0.0, 0.375, 0.125, 0.0, 0.375, 0.125]);
    }

    #[test]
    fn values_round_and_clamp_to_their_kind() {
        let kinds = [VoxelKind::U8, VoxelKind::I8, VoxelKind::U16, VoxelKind::I16];
        let kinds = [&kinds[..], &[VoxelKind::U32, VoxelKind::I32, VoxelKind::F32, VoxelKind::F64]]
            .concat();
        let back = |kind: VoxelKind, value: f64| {
            let mut bytes = Vec::new();
            kind.put(0.0, &mut bytes);
            kind.put(value, &mut bytes);
            assert_eq!(bytes.len(), 2 * kind.bytes());
            kind.get(&bytes, 1)
        };
        let found: Vec<f64> = kinds.iter().map(|&kind| back(kind, -1e12)).collect();
        assert_eq!(
            found,
            [0.0, -128.0, 0.0, -32768.0, 0.0, -2147483648.0, f64::from(-1e12f32), -1e12]
        );
        let found: Vec<f64> = kinds.iter().map(|&kind| back(kind, 99.5)).collect();
        assert_eq!(found, [100.0, 100.0, 100.0, 100.0, 100.0, 100.0, 99.5, 99.5]);
    }
}
