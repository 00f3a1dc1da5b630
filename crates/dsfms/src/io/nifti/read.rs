//! Reading.

use super::header::{
    BITPIX, DATA, DATATYPE, DIM, INTENT, INTENT_LABEL, KINDS, LENGTH, MAGIC, NiftiHeader, SLOPE,
    VOX_OFFSET,
};
use super::place::world_from_voxel;
use crate::guard;
use crate::io::InputError;
use crate::voxels::{VoxelError, VoxelGrid, VoxelKind, VoxelVolume};
use flate2::bufread::MultiGzDecoder;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

/// A volume, and the header of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct NiftiFile {
    /// The voxels as they are stored, and where they lie.
    pub volume: VoxelVolume,
    pub(super) header: NiftiHeader,
}

impl NiftiFile {
    /// Of a volume that no file held: in mm, its place as `sform`, in single precision.
    pub fn new(volume: VoxelVolume) -> Self {
        Self { header: NiftiHeader::of(&volume), volume }
    }

    /// Whether the file says that its values are labels.
    pub fn is_labels(&self) -> bool {
        self.header.short(INTENT) == INTENT_LABEL
    }

    /// The stored value that means the least: of CT that of air.
    pub fn background(&self) -> f64 {
        let [low, high] = self.volume.range();
        if self.header.float(SLOPE) < 0.0 { high } else { low }
    }
}

/// Most bytes before the data, header and its extensions.
const MOST_BEFORE: f64 = (64 << 20) as f64;

/// Read a volume.
///
/// # Errors
/// [`InputError`] with the field, what was expected and found: no NIfTI-1, cut off, no orientation,
/// an affine map that is singular or not finite, sizes or a number format that are not read.
pub fn read_nifti(path: &Path) -> Result<NiftiFile, InputError> {
    let file = guard::open(path).map_err(|source| InputError::read(path, source))?;
    read_nifti_from(BufReader::new(file), path)
}

/// The same from an open stream; `path` is for messages.
///
/// # Errors
/// As [`read_nifti`].
pub fn read_nifti_from(mut stream: impl BufRead, path: &Path) -> Result<NiftiFile, InputError> {
    let start = stream.fill_buf().map_err(|source| InputError::read(path, source))?;
    let found = match start {
        [] => Err("the file is empty (0 bytes); copy or export it again".into()),
        [0x1f, 0x8b, ..] => unpacked(BufReader::new(MultiGzDecoder::new(stream))),
        _ => unpacked(stream),
    };
    found.map_err(|reason| InputError::format(path, reason))
}

/// Of a stream that is not packed; what is wrong otherwise.
fn unpacked(mut stream: impl Read) -> Result<NiftiFile, String> {
    let head = at_most(&mut stream, LENGTH, "the header of 348 bytes")?;
    let (header, big) = header(&head)?;
    let size = size(&header)?;
    let kind = kind(&header)?;
    let map = world_from_voxel(&header)?;
    let grid = VoxelGrid::new(size, map).map_err(|error| wrong_grid(&error))?;
    let length = grid.count() as u64 * kind.bytes() as u64;
    if length > guard::MOST_BYTES {
        return Err(format!(
            "header field dim: {size:?} voxels of {} bytes are {} MiB; expected at most {} MiB; crop or resample the volume",
            kind.bytes(),
            length >> 20,
            guard::MOST_BYTES >> 20
        ));
    }
    skip(&mut stream, &header)?;
    let what = format!("the {length} bytes of {size:?} voxels");
    let mut bytes = at_most(&mut stream, length as usize, &what)?;
    // What follows is nobody's; of packed data it is the checksum.
    stream.read(&mut [0]).map_err(|error| damaged(&error))?;
    if big && kind.bytes() > 1 {
        bytes.chunks_exact_mut(kind.bytes()).for_each(<[u8]>::reverse);
    }
    let volume = VoxelVolume::new(grid, kind, bytes).map_err(|error| error.to_string())?;
    Ok(NiftiFile { volume, header })
}

/// Exactly `length` bytes; memory grows as they come.
fn at_most(stream: &mut impl Read, length: usize, what: &str) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    stream.take(length as u64).read_to_end(&mut bytes).map_err(|error| damaged(&error))?;
    match bytes.len() {
        found if found == length => Ok(bytes),
        found => Err(format!(
            "the file is truncated: expected {what}, found {found} bytes; copy or export it again"
        )),
    }
}

fn damaged(error: &io::Error) -> String {
    format!("its data cannot be read ({error}); copy or export it again")
}

/// The header in little-endian order, and whether the file is big-endian.
fn header(bytes: &[u8]) -> Result<(NiftiHeader, bool), String> {
    let mut header = NiftiHeader(std::array::from_fn(|i| bytes[i]));
    let stated = [0, 1, 2, 3].map(|i| bytes[i]);
    let (little, large) = (i32::from_le_bytes(stated), i32::from_be_bytes(stated));
    let big = large == LENGTH as i32;
    if big {
        header.turn();
    } else if little != LENGTH as i32 {
        let what = match little {
            _ if little == 540 || large == 540 => {
                "540 (NIfTI-2); save the volume as NIfTI-1".into()
            }
            _ => format!(
                "{little}; is it NIfTI-1? Convert DICOM, NRRD and others, for example with dcm2niix or 3D Slicer"
            ),
        };
        return Err(format!("header field sizeof_hdr: expected 348, found {what}"));
    }
    match &bytes[MAGIC..LENGTH] {
        b"n+1\0" => Ok((header, big)),
        b"ni1\0" => Err(
            "header field magic: expected \"n+1\", found \"ni1\" (header and data in two files); save the volume as one \
             .nii file"
                .into(),
        ),
        other => Err(format!(
            "header field magic: expected \"n+1\", found {:?}; save the volume as NIfTI-1 (Analyze 7.5 has no orientation)",
            String::from_utf8_lossy(other)
        )),
    }
}

fn size(header: &NiftiHeader) -> Result<[usize; 3], String> {
    let axes = header.short(DIM);
    if !(3..=7).contains(&axes) {
        return Err(format!(
            "header field dim[0]: expected 3 axes (up to 7), found {axes}; give one volume"
        ));
    }
    for axis in 4..=axes as usize {
        let length = header.short(DIM + 2 * axis);
        if length != 1 {
            return Err(format!(
                "header field dim[{axis}]: expected one volume (1), found {length}; give one volume of the series"
            ));
        }
    }
    let mut size = [0; 3];
    for (c, n) in size.iter_mut().enumerate() {
        let length = header.short(DIM + 2 * (c + 1));
        *n = usize::try_from(length).ok().filter(|&n| n > 0).ok_or_else(|| {
            format!(
                "header field dim[{}]: expected 1 to 32767 voxels, found {length}; export the volume again",
                c + 1
            )
        })?;
    }
    Ok(size)
}

fn kind(header: &NiftiHeader) -> Result<VoxelKind, String> {
    let code = header.short(DATATYPE);
    let kind = KINDS.iter().find(|k| k.0 == code).map(|k| k.1).ok_or_else(|| {
        format!(
            "header field datatype: expected whole numbers of 8 to 32 bits (2, 4, 8, 256, 512, 768) or floats (16, 64), \
             found {code}; convert the volume, for example to 16 bits or float"
        )
    })?;
    let (bits, expected) = (header.short(BITPIX), 8 * kind.bytes());
    if usize::try_from(bits) != Ok(expected) {
        return Err(format!(
            "header field bitpix: expected {expected} (of datatype {code}), found {bits}; export the volume again"
        ));
    }
    Ok(kind)
}

fn wrong_grid(error: &VoxelError) -> String {
    let field = match error {
        VoxelError::Size(_) => "header field dim",
        _ => "header fields srow, quatern and pixdim",
    };
    format!("{field}: {error}")
}

/// On to the data.
fn skip(stream: &mut impl Read, header: &NiftiHeader) -> Result<(), String> {
    let offset = header.float(VOX_OFFSET);
    // 0 is written by programs that mean the least.
    let offset = if offset == 0.0 { DATA as f64 } else { offset };
    if !(DATA as f64..=MOST_BEFORE).contains(&offset) || offset.fract() != 0.0 {
        return Err(format!(
            "header field vox_offset: expected a whole number from {DATA} to {MOST_BEFORE}, found {offset}; export the volume again"
        ));
    }
    let before = offset as u64 - LENGTH as u64;
    let found =
        io::copy(&mut stream.take(before), &mut io::sink()).map_err(|error| damaged(&error))?;
    if found < before {
        return Err(format!(
            "the file is truncated: expected data at byte {offset}, found {} bytes; copy or export it again",
            LENGTH as u64 + found
        ));
    }
    Ok(())
}
