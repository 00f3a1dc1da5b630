//! Masks on disk (white = `true`), and which mask belongs to which frame.

use super::error::InputError;
use super::images::decode;
use super::names::{files_in, frame_number, name_of, stem_of};
use crate::image::names::EXTENSIONS;
use crate::image::{Frame, Mask};
use std::path::{Path, PathBuf};

/// What white means in a mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskKind {
    /// White = valid image content (`--masks`).
    Valid,
    /// White = organ (`--organ-masks`).
    Organ,
    /// White = instrument (`--instrument-masks`).
    Instrument,
}

impl MaskKind {
    /// Words in a stem that mark a file as this kind, best first.
    fn keywords(self) -> &'static [&'static str] {
        match self {
            Self::Valid => &["valid", "mask", "organ"],
            Self::Organ => &["organ", "mask"],
            Self::Instrument => &["instrument", "tool", "mask"],
        }
    }

    /// Words that mark a file as another kind.
    fn foreign(self) -> &'static [&'static str] {
        match self {
            Self::Valid | Self::Organ => &["instrument", "tool"],
            Self::Instrument => &["organ"],
        }
    }

    fn describe(self) -> &'static str {
        match self {
            Self::Valid => "mask (white = valid)",
            Self::Organ => "organ mask (white = organ)",
            Self::Instrument => "instrument mask (white = instrument)",
        }
    }
}

/// A mask that looks inverted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{}: white covers {:.1} % of the {}; it looks inverted", path.display(), 100.0 * coverage, kind.describe())]
pub struct MaskWarning {
    /// The mask file.
    pub path: PathBuf,
    /// What white should mean.
    pub kind: MaskKind,
    /// White fraction.
    pub coverage: f64,
}

impl MaskWarning {
    /// Warn above 98 % or below 0.1 % white. A frame without an instrument has an empty
    /// instrument mask, so nothing is wrong with that one.
    fn check(mask: &Mask, path: &Path, kind: MaskKind) -> Option<Self> {
        let coverage = mask.coverage();
        let empty = coverage < 0.001 && kind != MaskKind::Instrument;
        (coverage > 0.98 || empty).then(|| Self { path: path.into(), kind, coverage })
    }
}

/// One mask: `true` where the grey value is above 127.
///
/// # Errors
/// A file that is no readable image, one that is transparent in places, or one of many grey values:
/// a photograph is no mask.
pub fn read_mask(path: &Path) -> Result<Mask, InputError> {
    let picture = decode(path)?;
    if picture.color().has_alpha() && picture.to_rgba8().pixels().any(|p| p.0[3] < 255) {
        let reason =
            "it is transparent in places; expected black and white without an alpha channel";
        return Err(InputError::format(path, reason));
    }
    let grey = picture.to_luma8();
    two_valued(grey.as_raw()).map_err(|reason| InputError::format(path, reason))?;
    let size = [grey.width() as usize, grey.height() as usize];
    Ok(Mask { size, data: grey.pixels().map(|p| p.0[0] > 127).collect() })
}

/// One mask per frame, in the frames' order, and warnings about masks that look inverted.
///
/// `source` is a folder, or one file for all frames. `paths` are the frames' files where they
/// come from files (else empty): a frame is never its own mask.
///
/// The mask of a frame in a folder:
///
/// 1. a file whose stem says its kind (`mask`, `organ`, `instrument`, …) and holds the frame's
///    number, even where a file named like the frame lies beside it (the folder of the frames);
/// 2. a file with the frame's own stem;
/// 3. a file with the frame's number.
///
/// The number is the last one in the stem. Files of another kind are never taken.
///
/// ```no_run
/// use dsfms::io::masks::{MaskKind, read_masks};
/// use dsfms::{Exploration, Frame, Mask, find_frames, read_frames};
///
/// let paths = find_frames(&["exploration".into()])?;
/// let frames = read_frames(&paths)?;
/// let (masks, warnings) = read_masks(&frames, &paths, "masks".as_ref(), MaskKind::Organ)?;
/// let organ: Vec<Option<Mask>> = masks.into_iter().map(Some).collect();
/// # Ok::<_, dsfms::io::InputError>(())
/// ```
///
/// # Errors
/// A frame without a mask, a mask of another size, or one that cannot be read.
pub fn read_masks(
    frames: &[Frame],
    paths: &[PathBuf],
    source: &Path,
    kind: MaskKind,
) -> Result<(Vec<Mask>, Vec<MaskWarning>), InputError> {
    let files = if source.is_file() { Vec::new() } else { mask_files(source)? };
    let (mut masks, mut warnings) = (Vec::new(), Vec::new());
    for (i, frame) in frames.iter().enumerate() {
        let path = match files.as_slice() {
            [] => source.to_path_buf(),
            files => choose(files, &frame.name, paths.get(i).map(PathBuf::as_path), source, kind)?,
        };
        let mask = read_mask(&path)?;
        if mask.size != frame.size {
            let (found, expected) = (mask.size, frame.size);
            return Err(InputError::MaskSize { path, found, frame: frame.name.clone(), expected });
        }
        warnings.extend(MaskWarning::check(&mask, &path, kind).filter(|w| !warnings.contains(w)));
        masks.push(mask);
    }
    Ok((masks, warnings))
}

/// How far a grey value may be from the usual one of its side: edges and JPEG blur them.
const SIDE_WIDTH: usize = 24;
/// Most pixels that may be farther.
const MOST_BETWEEN: f64 = 0.1;

/// Refuse what is no mask: pixels must have one value below and one above 127, but for few at
/// edges.
fn two_valued(grey: &[u8]) -> Result<(), String> {
    let mut counts = [0usize; 256];
    grey.iter().for_each(|&value| counts[usize::from(value)] += 1);
    let between: usize = [0..128, 128..256]
        .into_iter()
        .map(|side| {
            let usual = side.clone().max_by_key(|&value| counts[value]).unwrap_or_default();
            side.filter(|value| value.abs_diff(usual) > SIDE_WIDTH)
                .map(|v| counts[v])
                .sum::<usize>()
        })
        .sum();
    let share = between as f64 / grey.len().max(1) as f64;
    let brightest = grey.iter().copied().max().unwrap_or_default();
    if share > MOST_BETWEEN {
        return Err(format!(
            "not a mask: {:.0} % of its pixels are neither black nor white; expected two values, split at \
             127 (is this a photograph, or a mask that must be thresholded first?)",
            100.0 * share
        ));
    }
    if (1..128).contains(&brightest) {
        return Err(format!(
            "the brightest pixel of this mask is {brightest} of 255, so all of it counts as black; are \
             these labels? give 255 to what is meant"
        ));
    }
    Ok(())
}

fn mask_files(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let files = files_in(folder, &EXTENSIONS)?;
    if files.is_empty() {
        let expected = "expected PNG, JPEG or TIFF masks directly in this folder".into();
        return Err(InputError::Empty { path: folder.into(), expected });
    }
    Ok(files)
}

/// The mask of a frame among the files of a folder; the rules stand at [`read_masks`].
fn choose(
    files: &[PathBuf],
    frame: &str,
    frame_path: Option<&Path>,
    folder: &Path,
    kind: MaskKind,
) -> Result<PathBuf, InputError> {
    let own = frame_path.and_then(|path| path.canonicalize().ok());
    let is_own = |path: &PathBuf| own.is_some() && path.canonicalize().ok() == own;
    let foreign = |stem: &str| kind.foreign().iter().any(|word| stem.contains(word));
    let candidates: Vec<(&PathBuf, String)> = files
        .iter()
        .map(|path| (path, stem_of(path).to_lowercase()))
        .filter(|(path, stem)| !is_own(path) && !foreign(stem))
        .collect();
    let number = frame_number(frame);
    let same_number = |stem: &str| number.is_some() && frame_number(stem) == number;
    let lower = frame.to_lowercase();
    let names_frame = |stem: &str| stem == lower || (stem.contains(&lower) && number.is_none());
    let by_keyword = kind
        .keywords()
        .iter()
        .map(|word| pick(&candidates, |s| s.contains(word) && (same_number(s) || names_frame(s))));
    let others = [pick(&candidates, |s| s == lower), pick(&candidates, same_number)];
    let found = by_keyword.chain(others).find(|found| !found.is_empty()).unwrap_or_default();
    match found.as_slice() {
        [path] => Ok(path.to_path_buf()),
        [] => Err(no_partner(frame, number, folder, kind)),
        several => Err(InputError::Ambiguous {
            path: folder.into(),
            what: kind.describe(),
            frame: frame.into(),
            candidates: several.iter().map(|path| name_of(path)).collect(),
        }),
    }
}

/// Candidates whose stem fulfils a condition.
fn pick<'a>(
    candidates: &[(&'a PathBuf, String)],
    condition: impl Fn(&str) -> bool,
) -> Vec<&'a PathBuf> {
    candidates.iter().filter(|(_, stem)| condition(stem)).map(|(path, _)| *path).collect()
}

fn no_partner(frame: &str, number: Option<u64>, folder: &Path, kind: MaskKind) -> InputError {
    let word = kind.keywords()[0];
    let expected = match number {
        Some(n) => format!("{frame}.png, {word}_{n:03}.png, or another name with the number {n}"),
        None => format!("{frame}.png or {word}_{frame}.png"),
    };
    InputError::NoPartner {
        path: folder.into(),
        what: kind.describe(),
        frame: frame.into(),
        expected,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn save(path: &Path, size: [u32; 2], white: bool) {
        let value = image::Luma([if white { 255 } else { 0 }]);
        image::GrayImage::from_pixel(size[0], size[1], value).save(path).unwrap();
    }

    fn frame(name: &str) -> Frame {
        Frame { name: name.into(), size: [6, 5], rgb: vec![[0; 3]; 30] }
    }

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| save(&dir.path().join(name), [6, 5], name.contains("white")));
        dir
    }

    fn find_mask(
        frame: &str,
        frame_path: Option<&Path>,
        folder: &Path,
        kind: MaskKind,
    ) -> Result<PathBuf, InputError> {
        choose(&mask_files(folder)?, frame, frame_path, folder, kind)
    }

    fn found(dir: &tempfile::TempDir, frame: &str, kind: MaskKind) -> Result<String, InputError> {
        let own = dir.path().join(format!("{frame}.png"));
        find_mask(frame, Some(&own), dir.path(), kind).map(|path| name_of(&path))
    }

    #[test]
    fn a_photograph_or_labels_are_no_mask() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mask.png");
        let read = |value: &dyn Fn(u32, u32) -> u8| {
            let pixel = |x, y| image::Luma([value(x, y)]);
            image::GrayImage::from_fn(32, 32, pixel).save(&path).unwrap();
            read_mask(&path).map(|mask| mask.coverage()).map_err(|error| error.to_string())
        };
        let photograph = read(&|x, y| (7 * x + y) as u8).unwrap_err();
        assert!(photograph.contains("mask.png: not a mask") && photograph.contains("photograph"));
        let labels = read(&|x, _| u8::from(x > 16)).unwrap_err();
        assert!(labels.contains("brightest pixel of this mask is 1 of 255"), "{labels}");
        // Blurred edges, other values than 0 and 255, and masks of one value are masks.
        let edge = |x: u32, _| [0, 90, 180, 255][(x.clamp(14, 17) - 14) as usize];
        assert_eq!(read(&edge), Ok(0.5));
        assert_eq!(read(&|x, _| if x < 16 { 60 } else { 200 }), Ok(0.5));
        assert_eq!((read(&|_, _| 0), read(&|_, _| 255)), (Ok(0.0), Ok(1.0)));
    }

    #[test]
    fn masks_beside_the_frames() {
        let dir = folder(&["frame_003.png", "frame_004.png", "instrument_mask_003.png"]);
        let name = found(&dir, "frame_003", MaskKind::Instrument).unwrap();
        assert_eq!(name, "instrument_mask_003.png");
        let message = found(&dir, "frame_004", MaskKind::Instrument).unwrap_err().to_string();
        assert!(message.contains("instrument_004.png"), "{message}");
        // The instrument's mask is no organ mask, and the frame is not its own mask.
        assert!(found(&dir, "frame_003", MaskKind::Organ).is_err());
    }

    #[test]
    fn masks_elsewhere_by_name_and_by_number() {
        let dir = folder(&["organ_3.png", "organ_13.png", "tool_3.png"]);
        assert_eq!(found(&dir, "frame_003", MaskKind::Organ).unwrap(), "organ_3.png");
        assert_eq!(found(&dir, "frame_013", MaskKind::Valid).unwrap(), "organ_13.png");
        assert_eq!(found(&dir, "frame_003", MaskKind::Instrument).unwrap(), "tool_3.png");
        let dir = folder(&["frame_003.png", "frame_013.png", "x_7.png"]);
        let elsewhere = find_mask("frame_003", None, dir.path(), MaskKind::Organ).unwrap();
        assert_eq!(name_of(&elsewhere), "frame_003.png");
        assert_eq!(found(&dir, "frame_007", MaskKind::Organ).unwrap(), "x_7.png");
        let dir = folder(&["mask_a_3.png", "mask_b_3.png"]);
        let message = found(&dir, "frame_003", MaskKind::Organ).unwrap_err().to_string();
        assert!(message.contains("mask_a_3.png, mask_b_3.png"), "{message}");
    }

    #[test]
    fn inverted_looks_and_wrong_sizes() {
        let dir = folder(&["mask_0.png", "mask_1_white.png"]);
        let frames = [frame("f_0"), frame("f_1")];
        let read = |kind| read_masks(&frames, &[], dir.path(), kind).unwrap();
        let (masks, warnings) = read(MaskKind::Organ);
        assert_eq!((masks[0].coverage(), masks[1].coverage()), (0.0, 1.0));
        assert_eq!(warnings.len(), 2);
        assert!(warnings[1].to_string().contains("looks inverted"));
        assert_eq!(read(MaskKind::Instrument).1.len(), 1);
        save(&dir.path().join("mask_1_white.png"), [7, 5], true);
        let error = read_masks(&frames, &[], dir.path(), MaskKind::Organ).unwrap_err();
        assert!(error.to_string().contains("7x5"));
        // One file for all frames.
        let one = dir.path().join("mask_0.png");
        assert_eq!(read_masks(&frames, &[], &one, MaskKind::Organ).unwrap().1.len(), 1);
    }
}
