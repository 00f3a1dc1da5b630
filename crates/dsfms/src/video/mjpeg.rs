//! JPEG pictures out of a stream of bytes, by their markers (ITU T.81, annex B).

use std::io::{self, Read};

/// Most bytes of a picture; more is no picture.
const MOST_BYTES: usize = 64 << 20;

/// Bytes read at once.
const CHUNK: usize = 1 << 16;

/// Cuts a stream into JPEG pictures. What lies between two pictures (line ends, the head of a
/// multipart message) is passed over.
pub struct Pictures<R> {
    input: R,
    buffer: Vec<u8>,
    ended: bool,
    /// How far the picture at the start of the buffer has been walked.
    walked: Walked,
}

/// A place within a picture, so that nothing is looked at again when more bytes come.
#[derive(Clone, Copy, Default)]
struct Walked {
    /// Byte of the next marker; 0 before the first.
    at: usize,
    /// Within entropy-coded data.
    coded: bool,
}

/// What the beginning of the buffer is.
#[derive(Debug, PartialEq, Eq)]
enum Scanned {
    /// A whole picture of so many bytes.
    Whole(usize),
    /// More bytes are needed.
    Part,
    /// Broken at this byte.
    Broken(usize, String),
}

impl<R: Read> Pictures<R> {
    /// Of a stream.
    pub fn new(input: R) -> Self {
        Self { input, buffer: Vec::new(), ended: false, walked: Walked::default() }
    }

    /// The bytes of the next picture, or why it is none; `None` at the end of the stream.
    ///
    /// # Errors
    /// Those of the stream.
    #[allow(clippy::should_implement_trait, reason = "the stream itself can fail")]
    pub fn next(&mut self) -> io::Result<Option<Result<Vec<u8>, String>>> {
        loop {
            self.skip_to_start();
            let found = match self.buffer.len() {
                0 | 1 => Scanned::Part,
                _ => scan(&self.buffer, &mut self.walked),
            };
            if found != Scanned::Part || self.buffer.len() > MOST_BYTES || self.ended {
                self.walked = Walked::default();
            }
            match found {
                Scanned::Whole(length) => {
                    let rest = self.buffer.split_off(length);
                    return Ok(Some(Ok(std::mem::replace(&mut self.buffer, rest))));
                }
                Scanned::Broken(at, reason) => {
                    self.buffer.drain(..at.max(2));
                    return Ok(Some(Err(reason)));
                }
                Scanned::Part if self.buffer.len() > MOST_BYTES => {
                    self.buffer.clear();
                    return Ok(Some(Err(format!(
                        "no JPEG picture ends within {MOST_BYTES} bytes"
                    ))));
                }
                Scanned::Part if self.ended => {
                    let bytes = self.buffer.len();
                    self.buffer.clear();
                    let cut =
                        || Err(format!("the stream ends within a JPEG picture ({bytes} bytes)"));
                    return Ok((bytes > 1).then(cut));
                }
                Scanned::Part => self.fill()?,
            }
        }
    }

    /// Drop what stands before the start of a picture; a last `FF` may be half of it.
    fn skip_to_start(&mut self) {
        let start = self.buffer.windows(2).position(|w| w == [0xFF, 0xD8]);
        let half = self.buffer.last() == Some(&0xFF);
        let skip = start.unwrap_or(self.buffer.len() - usize::from(half && !self.ended));
        self.buffer.drain(..skip);
    }

    fn fill(&mut self) -> io::Result<()> {
        let before = self.buffer.len();
        self.buffer.resize(before + CHUNK, 0);
        let count = loop {
            match self.input.read(&mut self.buffer[before..]) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                other => break other,
            }
        };
        self.buffer.truncate(before + *count.as_ref().unwrap_or(&0));
        self.ended = count? == 0;
        Ok(())
    }
}

/// Walk the segments of a picture that starts the buffer, from where the last walk ended.
fn scan(bytes: &[u8], walked: &mut Walked) -> Scanned {
    let mut at = walked.at.max(2);
    loop {
        if walked.coded {
            let Some(end) = coded_end(bytes, at) else {
                // The last byte may be the first of a marker.
                walked.at = at.max(bytes.len().saturating_sub(1));
                return Scanned::Part;
            };
            (at, walked.coded) = (end, false);
        }
        walked.at = at;
        let Some(&[mark, kind]) = bytes.get(at..at + 2) else { return Scanned::Part };
        match (mark, kind) {
            (0xFF, 0xFF) => at += 1,
            (0xFF, 0xD9) => return Scanned::Whole(at + 2),
            (0xFF, 0xD8) => return cut_off(at),
            // Without content: TEM and the restart markers.
            (0xFF, 0x01 | 0xD0..=0xD7) => at += 2,
            (0xFF, 0xC0..=0xFE) => {
                let Some(&[high, low]) = bytes.get(at + 2..at + 4) else { return Scanned::Part };
                let length = usize::from(high) << 8 | usize::from(low);
                if length < 2 {
                    return broken(at);
                }
                let content = bytes.get(at..at + 2 + length);
                // Only segments of applications may hold a picture of their own, a thumbnail.
                if !matches!(kind, 0xE0..=0xEF | 0xFE) {
                    let seen = content.unwrap_or(&bytes[at..]);
                    if let Some(i) = seen.windows(3).position(|w| w == [0xFF, 0xD8, 0xFF]) {
                        return cut_off(at + i);
                    }
                }
                if content.is_none() {
                    return Scanned::Part;
                }
                at += 2 + length;
                walked.coded = kind == 0xDA;
            }
            _ => return broken(at),
        }
    }
}

fn cut_off(at: usize) -> Scanned {
    Scanned::Broken(at, "a JPEG picture is cut off where the next begins".into())
}

fn broken(at: usize) -> Scanned {
    Scanned::Broken(at, format!("no JPEG marker at byte {at} of a picture: the data are damaged"))
}

/// The first marker after entropy-coded data, in which `FF00` is a value and `FFD0` to `FFD7`
/// restart.
fn coded_end(bytes: &[u8], from: usize) -> Option<usize> {
    let coded = bytes.get(from..)?;
    let marker = |w: &[u8]| w[0] == 0xFF && !matches!(w[1], 0x00 | 0xFF | 0xD0..=0xD7);
    coded.windows(2).position(marker).map(|i| from + i)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jpeg(value: u8) -> Vec<u8> {
        let mut bytes = Vec::new();
        let picture = image::RgbImage::from_pixel(24, 16, image::Rgb([value, 90, 40]));
        image::codecs::jpeg::JpegEncoder::new(&mut bytes).encode_image(&picture).unwrap();
        bytes
    }

    /// Gives few bytes at a time.
    struct Slow(std::vec::IntoIter<u8>, usize);

    impl Read for Slow {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(buffer.len());
            let given: Vec<u8> = self.0.by_ref().take(count).collect();
            buffer[..given.len()].copy_from_slice(&given);
            Ok(given.len())
        }
    }

    fn all(bytes: Vec<u8>, step: usize) -> Vec<Result<Vec<u8>, String>> {
        let mut pictures = Pictures::new(Slow(bytes.into_iter(), step));
        std::iter::from_fn(|| pictures.next().unwrap()).collect()
    }

    #[test]
    fn pictures_come_out_as_they_went_in() {
        let (a, b) = (jpeg(10), jpeg(200));
        let stream = [
            b"--boundary\r\nContent-Type: image/jpeg\r\n\r\n".to_vec(),
            a.clone(),
            b"\r\n".to_vec(),
            b.clone(),
        ]
        .concat();
        for step in [1, 7, 100_000] {
            assert_eq!(all(stream.clone(), step), [Ok(a.clone()), Ok(b.clone())], "step {step}");
        }
        assert!(all(Vec::new(), 5).is_empty() && all(b"no picture\xff".to_vec(), 3).is_empty());
    }

    #[test]
    fn a_picture_without_end_is_looked_at_once() {
        let a = jpeg(10);
        let start = a.windows(2).position(|w| w == [0xFF, 0xDA]).unwrap() + 14;
        let mut bytes = a[..start].to_vec();
        bytes.resize(MOST_BYTES + (8 << 20), 0x55);
        bytes.extend(&a);
        let begin = std::time::Instant::now();
        let mut pictures = Pictures::new(bytes.as_slice());
        let found: Vec<_> = std::iter::from_fn(|| pictures.next().unwrap()).collect();
        assert!(found[0].as_ref().is_err_and(|e| e.contains("no JPEG picture ends within")));
        assert_eq!(found.last(), Some(&Ok(a)));
        assert!(begin.elapsed() < std::time::Duration::from_secs(20), "{:?}", begin.elapsed());
    }

    #[test]
    fn a_broken_picture_costs_itself_only() {
        let (a, b) = (jpeg(10), jpeg(200));
        let half = a[..a.len() / 2].to_vec();
        let cut = all([half.clone(), b.clone()].concat(), 64);
        assert!(
            cut.last() == Some(&Ok(b.clone())) && cut.iter().any(Result::is_err),
            "{}",
            cut.len()
        );
        let tail = all([b.clone(), half].concat(), 64);
        assert_eq!(tail[0], Ok(b.clone()));
        assert!(tail[1].as_ref().is_err_and(|e| e.contains("stream ends")) && tail.len() == 2);
        // A thumbnail within a segment is no picture of its own.
        let segment = [&[0xFF, 0xE1], &(2 + b.len() as u16).to_be_bytes()[..], &b].concat();
        let nested = [&a[..2], &segment, &a[2..]].concat();
        assert_eq!(all(nested.clone(), 64), [Ok(nested)]);
        // A segment without length.
        let mut torn = a.clone();
        torn[4..6].copy_from_slice(&[0, 0]);
        let torn = all([torn, b.clone()].concat(), 64);
        assert!(torn[0].is_err() && torn.last() == Some(&Ok(b)));
    }
}
