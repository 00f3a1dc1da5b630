//! A known albedo: an sRGB picture in the mesh's UV.

use super::images::decode_bytes;
use crate::guard;
use crate::image::{ColorImage, ToneCurve};
use std::path::{Path, PathBuf};

/// Why an albedo file cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AlbedoFileError {
    /// Missing, unreadable or damaged.
    #[error("cannot read albedo {}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        reason: String,
    },
}

/// Read an 8-bit albedo picture as linear RGB (the file is taken to be sRGB-encoded).
///
/// # Errors
/// A file that is missing or no picture.
pub fn read_albedo_image(path: &Path) -> Result<ColorImage, AlbedoFileError> {
    let wrong = |reason| AlbedoFileError::Unreadable { path: path.into(), reason };
    let bytes = guard::read(path).map_err(|e| wrong(e.to_string()))?;
    let picture = decode_bytes(&bytes).map_err(wrong)?.to_rgb8();
    let table = ToneCurve::Srgb.table();
    let size = [picture.width() as usize, picture.height() as usize];
    let data = picture.pixels().map(|p| p.0.map(|v| table[v as usize])).collect();
    Ok(ColorImage { size, data })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_picture_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(read_albedo_image(&folder.path().join("no.png")).is_err());
    }
}
