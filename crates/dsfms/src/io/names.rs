//! File names: natural order, frame numbers, and which files of a folder are frames.

use super::error::InputError;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Natural order: digits compare as numbers, so `frame_9` comes before `frame_10`.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (left, right) = (chunks(a), chunks(b));
    let by_chunk = left.iter().zip(&right).map(|(a, b)| match (a.0, b.0) {
        // Without leading zeros, the longer number is the larger.
        (true, true) => {
            let (a, b) = (a.1.trim_start_matches('0'), b.1.trim_start_matches('0'));
            a.len().cmp(&b.len()).then_with(|| a.cmp(b))
        }
        _ => a.1.cmp(b.1),
    });
    let first = by_chunk.into_iter().find(|order| order.is_ne()).unwrap_or(Ordering::Equal);
    first.then(left.len().cmp(&right.len())).then_with(|| a.cmp(b))
}

/// Runs of digits (`true`) and of anything else.
fn chunks(name: &str) -> Vec<(bool, &str)> {
    let mut out = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let digits = first.is_ascii_digit();
        let end = rest.find(|c: char| c.is_ascii_digit() != digits).unwrap_or(rest.len());
        out.push((digits, &rest[..end]));
        rest = &rest[end..];
    }
    out
}

/// The last number in a stem: 3 for `frame_003`, `organ_3` and `frame_003_mask`.
pub fn frame_number(stem: &str) -> Option<u64> {
    chunks(stem).iter().rev().find(|c| c.0).and_then(|c| c.1.parse().ok())
}

pub(super) fn stem_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

pub(super) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Files directly in a folder with one of the extensions (any case), in natural order; hidden
/// files are left out.
pub(super) fn files_in(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>, InputError> {
    let entries = std::fs::read_dir(folder).map_err(|source| InputError::read(folder, source))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|source| InputError::read(folder, source))?.path();
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let hidden = name_of(&path).starts_with('.');
        if path.is_file() && !hidden && extensions.contains(&extension.as_str()) {
            files.push(path);
        }
    }
    files.sort_by(|a, b| natural_order(&name_of(a), &name_of(b)));
    Ok(files)
}

/// Whether a file name matches a pattern of literal characters, `*` and `?`.
pub(super) fn matches_pattern(name: &str, pattern: &str) -> bool {
    let (name, pattern): (Vec<char>, Vec<char>) =
        (name.chars().collect(), pattern.chars().collect());
    // reachable[i]: the pattern so far matches the first i characters.
    let mut reachable = vec![false; name.len() + 1];
    reachable[0] = true;
    for p in pattern {
        let mut next = vec![false; name.len() + 1];
        next[0] = p == '*' && reachable[0];
        for (i, &character) in name.iter().enumerate() {
            next[i + 1] = match p {
                '*' => reachable[i + 1] || next[i],
                '?' => reachable[i],
                _ => reachable[i] && p == character,
            };
        }
        reachable = next;
    }
    reachable[name.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_sort_as_numbers() {
        let mut names = ["f10.png", "f9.png", "f09a.png", "a.png", "f2_10.png", "f2_9.png"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["a.png", "f2_9.png", "f2_10.png", "f9.png", "f09a.png", "f10.png"]);
        assert_eq!(natural_order("x1", "x1"), Ordering::Equal);
    }

    #[test]
    fn the_number_of_a_frame() {
        assert_eq!(frame_number("frame_003"), Some(3));
        assert_eq!(frame_number("frame_003_mask"), Some(3));
        assert_eq!(frame_number("organ"), None);
        assert_eq!(frame_number("99999999999999999999999"), None);
    }

    #[test]
    fn patterns() {
        assert!(matches_pattern("frame_003.png", "frame_*.png"));
        assert!(matches_pattern("frame_003.png", "*_00?.*"));
        assert!(!matches_pattern("frame_003.png", "frame_?.png"));
        assert!(matches_pattern("", "*") && !matches_pattern("", "?"));
    }
}
