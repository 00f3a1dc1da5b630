//! Frames from PNG, JPEG and TIFF files, and the masks that go with them (see [`super::masks`]).

use super::error::InputError;
use super::names::{files_in, matches_pattern, name_of, natural_order, stem_of};
use crate::guard;
use crate::image::Frame;
use crate::image::names::EXTENSIONS;
use image::ImageFormat::{Jpeg, Png, Tiff};
use image::{DynamicImage, ImageDecoder};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// The frames named by files, folders and patterns (`*` and `?` in the last component), in the
/// order given; folders and patterns in natural name order. A folder gives the images directly in
/// it whose stem does not contain `mask`.
///
/// # Errors
/// A path that is not there, or a folder or pattern without images.
pub fn find_frames(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, InputError> {
    let mut frames = Vec::new();
    for input in inputs {
        if input.is_dir() {
            frames.extend(frames_in(input)?);
        } else if input.exists() {
            frames.push(input.clone());
        } else if name_of(input).contains(['*', '?']) {
            frames.extend(frames_like(input)?);
        } else {
            return Err(InputError::Missing(input.clone()));
        }
    }
    Ok(frames)
}

fn frames_in(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let mut files = files_in(folder, &EXTENSIONS)?;
    files.retain(|path| !stem_of(path).to_lowercase().contains("mask"));
    non_empty(files, folder, "expected PNG, JPEG or TIFF frames directly in this folder")
}

fn frames_like(pattern: &Path) -> Result<Vec<PathBuf>, InputError> {
    let folder = pattern.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut files = files_in(folder, &EXTENSIONS)?;
    files.retain(|path| matches_pattern(&name_of(path), &name_of(pattern)));
    files.sort_by(|a, b| natural_order(&name_of(a), &name_of(b)));
    non_empty(files, pattern, "expected PNG, JPEG or TIFF files matching this pattern")
}

fn non_empty(files: Vec<PathBuf>, path: &Path, expected: &str) -> Result<Vec<PathBuf>, InputError> {
    if files.is_empty() {
        return Err(InputError::Empty { path: path.into(), expected: expected.into() });
    }
    Ok(files)
}

/// One frame. 16-bit images are scaled to 8 bits, grey is repeated in all channels, alpha is
/// dropped. The format is told from the content, not from the name.
///
/// # Errors
/// A file that is missing, damaged, or of no known format.
pub fn read_frame(path: &Path) -> Result<Frame, InputError> {
    let rgb = decode(path)?.to_rgb8();
    let size = [rgb.width() as usize, rgb.height() as usize];
    Ok(Frame { name: stem_of(path), size, rgb: rgb.pixels().map(|p| p.0).collect() })
}

/// Width and height of an image, upright as its EXIF orientation says, without decoding its pixels.
///
/// # Errors
/// A file that cannot be read, or whose head is not that of a PNG, JPEG or TIFF.
pub fn read_size(path: &Path) -> Result<[usize; 2], InputError> {
    let bytes = guard::read(path).map_err(|source| InputError::read(path, source))?;
    let head = || -> image::ImageResult<[u32; 2]> {
        let reader = image::ImageReader::new(Cursor::new(&bytes)).with_guessed_format()?;
        let mut decoder = reader.into_decoder()?;
        let upright = decoder.orientation()?.to_exif();
        let (w, h) = decoder.dimensions();
        // EXIF 5 to 8 lie on their side.
        Ok(if upright > 4 { [h, w] } else { [w, h] })
    };
    let size = guard::caught(head).and_then(|size| size.map_err(|error| error.to_string()));
    let size = size.map_err(|reason| InputError::Image { path: path.into(), reason })?;
    Ok(size.map(|side| side as usize))
}

/// Frames of one size with different names, decoded in parallel; the first error in the order of
/// `paths` is returned.
///
/// ```no_run
/// let frames = dsfms::read_frames(&dsfms::find_frames(&["exploration".into()])?)?;
/// # Ok::<_, dsfms::io::InputError>(())
/// ```
///
/// # Errors
/// A file that is no readable image, frames of different sizes, two of the same name.
pub fn read_frames(paths: &[PathBuf]) -> Result<Vec<Frame>, InputError> {
    let mut names = BTreeMap::new();
    for path in paths {
        if let Some(first) = names.insert(stem_of(path), path) {
            let name = stem_of(path);
            return Err(InputError::SameName { name, first: first.clone(), second: path.clone() });
        }
    }
    let frames: Vec<_> = paths.par_iter().map(|path| read_frame(path)).collect();
    let frames = frames.into_iter().collect::<Result<Vec<Frame>, _>>()?;
    match frames.iter().position(|frame| frame.size != frames[0].size) {
        None => Ok(frames),
        Some(i) => Err(InputError::FrameSizes {
            first: paths[0].clone(),
            first_size: frames[0].size,
            other: paths[i].clone(),
            other_size: frames[i].size,
        }),
    }
}

/// Check that the frames have the size of the camera read from `path`.
///
/// # Errors
/// [`InputError::CameraSize`] of the first frame of another size.
pub(crate) fn check_camera_size(
    frames: &[Frame],
    expected: [usize; 2],
    path: &Path,
) -> Result<(), InputError> {
    match frames.iter().find(|frame| frame.size != expected) {
        None => Ok(()),
        Some(frame) => Err(InputError::CameraSize {
            frame: frame.name.clone(),
            found: frame.size,
            path: path.into(),
            expected,
        }),
    }
}

pub(super) fn decode(path: &Path) -> Result<DynamicImage, InputError> {
    let bytes = guard::read(path).map_err(|source| InputError::read(path, source))?;
    decode_bytes(&bytes).map_err(|reason| InputError::Image { path: path.into(), reason })
}

/// The picture in the bytes of a PNG, JPEG or TIFF file, upright as its EXIF orientation says; or
/// what is wrong with it. At most 16384 px wide and high, and 512 MiB while it is decoded.
///
/// # Errors
/// What is wrong with them.
pub fn decode_bytes(bytes: &[u8]) -> Result<DynamicImage, String> {
    if bytes.is_empty() {
        return Err("the file has zero bytes".into());
    }
    let format = image::guess_format(bytes).ok();
    let Some(format) = format.filter(|f| [Png, Jpeg, Tiff].contains(f)) else {
        return Err("the content is not PNG, JPEG or TIFF".into());
    };
    if format == Jpeg && !jpeg_is_complete(bytes) {
        return Err("the JPEG data ends too early (truncated file)".into());
    }
    let image = guard::caught(|| decode_as(bytes, format))?
        .map_err(|reason| format!("{reason} (truncated or damaged {format:?} file?)"))?;
    if image.width() == 0 || image.height() == 0 {
        return Err("the image has no pixels".into());
    }
    Ok(image)
}

fn decode_as(bytes: &[u8], format: image::ImageFormat) -> Result<DynamicImage, String> {
    let told = |error: image::ImageError| error.to_string();
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(guard::MOST_IMAGE_SIDE);
    limits.max_image_height = Some(guard::MOST_IMAGE_SIDE);
    limits.max_alloc = Some(guard::MOST_IMAGE_BYTES);
    let mut reader = image::ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits.clone());
    let mut decoder = reader.into_decoder().map_err(told)?;
    limits.reserve(decoder.total_bytes()).map_err(told)?;
    if format == Jpeg {
        jpeg_can_hold(bytes, decoder.dimensions())?;
    }
    let upright = decoder.orientation().map_err(told)?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(told)?;
    image.apply_orientation(upright);
    Ok(image)
}

/// Most px that a byte of a JPEG can stand for: every block of 8 x 8 px has a code of at least one
/// bit.
const MOST_PIXELS_A_BYTE: u64 = 512;
/// Most scans of a JPEG, each of which may go over all of its pixels; progressive files have about
/// ten.
const MOST_SCANS: usize = 64;

/// Refuse what costs a decoder much more than its bytes: pixels that they cannot hold, and scans
/// without end.
fn jpeg_can_hold(bytes: &[u8], (width, height): (u32, u32)) -> Result<(), String> {
    let length = bytes.len() as u64;
    if u64::from(width) * u64::from(height) > MOST_PIXELS_A_BYTE * length {
        return Err(format!("it states {width}x{height} px, which its {length} bytes cannot hold"));
    }
    let scans = bytes.windows(2).filter(|w| *w == [0xff, 0xda]).count();
    if scans > MOST_SCANS {
        return Err(format!("it has {scans} scans; at most {MOST_SCANS} are read"));
    }
    Ok(())
}

/// Decoders fill the missing end of a JPEG with grey, which would pass for image content: ask for
/// the end marker after the last scan.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|w| w == marker);
    match (last([0xff, 0xda]), last([0xff, 0xd9])) {
        (Some(scan), Some(end)) => end > scan,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{DynamicImage, GrayImage, ImageBuffer, Luma, RgbImage, Rgba, RgbaImage};

    fn folder() -> tempfile::TempDir {
        tempfile::tempdir().unwrap()
    }

    fn rgb(path: &Path, w: u32, h: u32) {
        let pixel = |x, y| image::Rgb([(10 * x) as u8, (10 * y) as u8, 77]);
        RgbImage::from_fn(w, h, pixel).save(path).unwrap();
    }

    #[test]
    fn a_folder_in_natural_order_without_masks() {
        let dir = folder();
        for name in ["frame_10.png", "frame_9.png", "instrument_mask_009.png"] {
            rgb(&dir.path().join(name), 4, 3);
        }
        std::fs::write(dir.path().join("notes.txt"), "x").unwrap();
        let paths = find_frames(&[dir.path().into()]).unwrap();
        let frames = read_frames(&paths).unwrap();
        assert_eq!(
            frames.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(),
            ["frame_9", "frame_10"]
        );
        assert_eq!(frames[0].size, [4, 3]);
        assert_eq!(frames[0].rgb[4 + 2], [20, 10, 77]);
        assert_eq!(find_frames(&[dir.path().join("frame_?.png")]).unwrap().len(), 1);
    }

    #[test]
    fn every_pixel_format_becomes_rgb8() {
        let dir = folder();
        let images: [(&str, DynamicImage); 4] = [
            ("grey.png", GrayImage::from_pixel(2, 2, Luma([9])).into()),
            ("alpha.png", RgbaImage::from_pixel(2, 2, Rgba([1, 2, 3, 0])).into()),
            ("deep.tiff", ImageBuffer::from_pixel(2, 2, Luma([65535_u16])).into()),
            ("small.jpg", RgbImage::from_pixel(2, 2, image::Rgb([200, 200, 200])).into()),
        ];
        let expected = [[9; 3], [1, 2, 3], [255; 3], [200; 3]];
        for ((name, image), expected) in images.iter().zip(expected) {
            let path = dir.path().join(name);
            image.save(&path).unwrap();
            assert_eq!(read_frame(&path).unwrap().rgb[3], expected, "{name}");
        }
    }

    /// Six by four px, the left half red; EXIF says to turn it by 90 degrees to the right.
    #[test]
    fn pictures_stand_upright_as_exif_says() {
        let dir = folder();
        let path = dir.path().join("turned.jpg");
        let half = |x, _| image::Rgb(if x < 16 { [220, 20, 20] } else { [20, 20, 220] });
        let mut bytes = Vec::new();
        let picture = RgbImage::from_fn(32, 16, half);
        picture.write_with_encoder(image::codecs::jpeg::JpegEncoder::new(&mut bytes)).unwrap();
        let exif = b"\xFF\xE1\x00\x22Exif\0\0II\x2A\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
        bytes.splice(2..2, exif.iter().copied());
        std::fs::write(&path, bytes).unwrap();
        let frame = read_frame(&path).unwrap();
        assert_eq!(frame.size, [16, 32]);
        assert!(frame.rgb[0][0] > 180 && frame.rgb[31 * 16][2] > 180);
    }

    #[test]
    fn pictures_that_would_take_all_memory_are_refused() {
        // A PNG of 60000 x 60000 px in a few bytes: only its header is needed.
        let dir = folder();
        let path = dir.path().join("a.png");
        rgb(&path, 2, 2);
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[16..20].copy_from_slice(&60_000u32.to_be_bytes());
        bytes[20..24].copy_from_slice(&60_000u32.to_be_bytes());
        // The check sum of the header, which a decoder may look at first.
        let sum = bytes[12..29].iter().fold(!0u32, |mut c, &b| {
            c ^= u32::from(b);
            (0..8).for_each(|_| c = if c & 1 == 1 { c >> 1 ^ 0xEDB8_8320 } else { c >> 1 });
            c
        });
        bytes[29..33].copy_from_slice(&(!sum).to_be_bytes());
        let reason = decode_bytes(&bytes).unwrap_err();
        assert!(reason.to_lowercase().contains("limit"), "{reason}");
    }

    #[test]
    fn damaged_files_are_named() {
        let dir = folder();
        let good = dir.path().join("good.png");
        RgbImage::from_fn(40, 40, |x, y| image::Rgb([(x * y) as u8, x as u8, y as u8]))
            .save(&good)
            .unwrap();
        let jpeg = dir.path().join("good.jpg");
        image::open(&good).unwrap().to_rgb8().save(&jpeg).unwrap();
        for (name, bytes) in [
            ("cut.png", std::fs::read(&good).unwrap()[..300].to_vec()),
            ("cut.jpg", std::fs::read(&jpeg).unwrap()[..700].to_vec()),
            ("text.png", b"not an image".to_vec()),
            ("empty.png", Vec::new()),
        ] {
            let path = dir.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let message = read_frame(&path).unwrap_err().to_string();
            assert!(
                message.contains(name) && message.contains("not a readable image"),
                "{message}"
            );
        }
    }

    #[test]
    fn missing_empty_and_uneven_inputs() {
        let dir = folder();
        let error = find_frames(&[dir.path().into()]).unwrap_err();
        assert!(matches!(error, InputError::Empty { .. }));
        let error = find_frames(&[dir.path().join("nowhere")]).unwrap_err();
        assert!(matches!(error, InputError::Missing(_)));
        rgb(&dir.path().join("a.png"), 4, 3);
        rgb(&dir.path().join("b.png"), 5, 3);
        let paths = find_frames(&[dir.path().into()]).unwrap();
        let message = read_frames(&paths).unwrap_err().to_string();
        assert!(message.contains("a.png") && message.contains("b.png is 5x3"), "{message}");
        rgb(&dir.path().join("a.tif"), 4, 3);
        let twice = [dir.path().join("a.png"), dir.path().join("a.tif")];
        assert!(matches!(read_frames(&twice), Err(InputError::SameName { .. })));
        let frames = read_frames(&paths[..1]).unwrap();
        let error = check_camera_size(&frames, [640, 480], Path::new("camera.json")).unwrap_err();
        assert!(error.to_string().contains("says 640x480"));
    }
}
