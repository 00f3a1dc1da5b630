//! Any other video, through an installed `ffmpeg` that writes PPM pictures into a pipe.

use super::{Picture, VideoError};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Stdio};

/// Decode a video with `program`; `reason` says why it was not decoded directly.
pub(super) fn decode(
    program: &str,
    path: &Path,
    reason: &str,
    each: &mut dyn FnMut(usize, Picture) -> bool,
) -> Result<(), VideoError> {
    let read = |source| VideoError::Read { path: path.into(), source };
    // Into a file: a pipe that nobody empties would stop ffmpeg.
    let log = tempfile::NamedTempFile::new().map_err(read)?;
    let mut input = std::ffi::OsString::from("file:");
    input.push(path);
    let child = Command::new(program)
        .args(["-v", "error", "-nostdin", "-i"])
        .arg(input)
        .args(["-map", "0:v:0", "-f", "image2pipe", "-c:v", "ppm", "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(log.reopen().map_err(read)?)
        .spawn();
    let Ok(mut child) = child else {
        let reason = format!("{reason}, and no ffmpeg was found");
        return Err(VideoError::Unsupported { path: path.into(), reason });
    };
    let pictures =
        child.stdout.take().map_or(Ok(Ended::After(0)), |out| pictures(BufReader::new(out), each));
    // Its output is closed by now: it ends by itself.
    let status = child.wait().map_err(read)?;
    match pictures {
        Ok(Ended::Enough) => Ok(()),
        Ok(Ended::After(count)) if status.success() && count > 0 => Ok(()),
        result => {
            let said = std::fs::read_to_string(log.path()).unwrap_or_default();
            let own = result.err().map(|error| error.to_string()).unwrap_or_default();
            let said = said.lines().last().unwrap_or(&own);
            let reason = format!("{reason}, and ffmpeg failed: {said}");
            Err(VideoError::Damaged { path: path.into(), reason })
        }
    }
}

/// How a stream ended.
#[derive(Debug, PartialEq)]
enum Ended {
    /// After so many pictures.
    After(usize),
    /// No more were wanted.
    Enough,
}

/// Every PPM picture of a stream.
fn pictures(
    mut stream: impl BufRead,
    each: &mut dyn FnMut(usize, Picture) -> bool,
) -> std::io::Result<Ended> {
    let mut index = 0;
    while let Some(size) = header(&mut stream)? {
        let mut bytes = vec![0; 3 * size[0] * size[1]];
        stream.read_exact(&mut bytes)?;
        let (pixels, _) = bytes.as_chunks::<3>();
        if !each(index, Picture { size, rgb: pixels.to_vec() }) {
            return Ok(Ended::Enough);
        }
        index += 1;
    }
    Ok(Ended::After(index))
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
        let ended = pictures(bytes.as_slice(), &mut |index, p| {
            seen.push((index, p.size, p.rgb));
            true
        });
        assert_eq!(ended.unwrap(), Ended::After(2));
        assert_eq!(seen[0], (0, [2, 1], vec![[1, 2, 3], [4, 5, 6]]));
        assert_eq!(seen[1], (1, [1, 1], vec![[10, 11, 12]]));
        assert!(pictures(&b"P6\n2 1\n255\n\x01"[..], &mut |_, _| true).is_err());
        assert!(pictures(&b"JUNK"[..], &mut |_, _| true).is_err());
    }

    #[test]
    fn without_ffmpeg_the_error_says_what_to_do() {
        let error = decode("no-such-ffmpeg", Path::new("a.mkv"), "no mp4 file", &mut |_, _| true);
        let message = error.unwrap_err().to_string();
        assert!(
            message.contains("a.mkv: no mp4 file, and no ffmpeg") && message.contains("install")
        );
    }
}
