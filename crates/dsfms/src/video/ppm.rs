//! PPM pictures one after the other, as ffmpeg writes them into a pipe.

use std::io::{BufRead, Read};

/// How a stream ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// After so many pictures.
    After(usize),
    /// No more were wanted.
    Enough,
}

/// Size and pixels of every picture of a stream, until `each` answers `false`.
///
/// # Errors
/// Those of the stream, and [`std::io::ErrorKind::InvalidData`] for what is no picture.
pub fn pictures(
    mut stream: impl BufRead,
    each: &mut dyn FnMut([usize; 2], Vec<[u8; 3]>) -> bool,
) -> std::io::Result<Ended> {
    let mut count = 0;
    while let Some(size) = header(&mut stream)? {
        let mut bytes = vec![0; 3 * size[0] * size[1]];
        stream.read_exact(&mut bytes)?;
        let (pixels, _) = bytes.as_chunks::<3>();
        if !each(size, pixels.to_vec()) {
            return Ok(Ended::Enough);
        }
        count += 1;
    }
    Ok(Ended::After(count))
}

/// `P6 WIDTH HEIGHT 255` and one white space; `None` at the end of the stream.
fn header(stream: &mut impl BufRead) -> std::io::Result<Option<[usize; 2]>> {
    if stream.fill_buf()?.is_empty() {
        return Ok(None);
    }
    let mut words = Vec::new();
    for _ in 0..4 {
        let mut word = String::new();
        for byte in stream.by_ref().bytes().take(12) {
            match byte? {
                b if b.is_ascii_whitespace() => break,
                b => word.push(b as char),
            }
        }
        words.push(word);
    }
    let bad = || std::io::Error::new(std::io::ErrorKind::InvalidData, "unexpected PPM header");
    let number = |word: &String| word.parse::<usize>().map_err(|_| bad());
    match words.as_slice() {
        [magic, width, height, depth] if magic == "P6" && depth == "255" => {
            let size = [number(width)?, number(height)?];
            size.iter().all(|n| (1..=8192).contains(n)).then_some(Some(size)).ok_or_else(bad)
        }
        _ => Err(bad()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_of_two_pictures() {
        let mut bytes = b"P6\n2 1\n255\n\x01\x02\x03\x04\x05\x06".to_vec();
        bytes.extend(b"P6\n1 1\n255\n\x0a\x0b\x0c");
        let mut seen = Vec::new();
        let ended = pictures(bytes.as_slice(), &mut |size, rgb| {
            seen.push((size, rgb));
            true
        });
        assert_eq!(ended.unwrap(), Ended::After(2));
        assert_eq!(seen[0], ([2, 1], vec![[1, 2, 3], [4, 5, 6]]));
        assert_eq!(seen[1], ([1, 1], vec![[10, 11, 12]]));
        assert!(pictures(&b"P6\n2 1\n255\n\x01"[..], &mut |_, _| true).is_err());
        assert!(pictures(&b"JUNK"[..], &mut |_, _| true).is_err());
    }
}
