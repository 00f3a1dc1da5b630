//! Names of frames, and of the picture files they come from.

/// Extensions of picture files.
pub const EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "tif", "tiff"];

/// A file name without a picture's extension: names of frames may hold dots.
pub fn stem(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, end)) if EXTENSIONS.contains(&end.to_lowercase().as_str()) => stem,
        _ => name,
    }
}

/// Index of the frame that is named, with or without a picture's extension.
pub(crate) fn position_named<'a>(
    mut frames: impl Iterator<Item = &'a str> + Clone,
    name: &str,
) -> Option<usize> {
    let exact = frames.clone().position(|frame| frame == name);
    exact.or_else(|| frames.position(|frame| frame == stem(name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exact_name_counts_more_than_one_without_extension() {
        let found = |name| position_named(["scan", "scan.1", "a.png", "a"].into_iter(), name);
        assert_eq!(found("scan.1"), Some(1));
        assert_eq!(found("scan.PNG"), Some(0));
        assert_eq!(found("a.png"), Some(2));
        assert_eq!(found("scan.2"), None);
    }
}
