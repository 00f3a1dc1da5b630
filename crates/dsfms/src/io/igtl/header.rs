//! What stands before every message: 58 bytes, and in messages of header version 2 (OpenIGTLink 3)
//! an extended header within the body.

use super::IgtlError;
use super::crc::crc64;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Bytes of a header.
pub const HEADER: usize = 58;

/// Most bytes of a body: a frame of 64 million px, and more.
pub const MOST_BODY: u64 = 256 << 20;

/// Of whom and when a message tells.
#[derive(Clone, Copy, Debug)]
pub struct Head<'a> {
    /// Name of the device, ASCII; what goes beyond 20 characters is cut off.
    pub device: &'a str,
    /// When what is told was so; `None` writes no time.
    pub time: Option<SystemTime>,
}

/// A header that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// 1, or 2 where the body has an extended header.
    pub version: u16,
    /// `IMAGE`, `TRANSFORM`, ...
    pub kind: String,
    /// Name of the device.
    pub device: String,
    /// Time stamp; `None` where the sender gave none.
    pub time: Option<SystemTime>,
    /// Bytes that follow.
    pub body: u64,
    /// Their checksum.
    pub crc: u64,
}

impl Header {
    /// Take a header apart.
    ///
    /// # Errors
    /// Another version than 1 and 2, a body beyond [`MOST_BODY`]: what follows cannot be found.
    pub fn parse(bytes: &[u8; HEADER]) -> Result<Self, IgtlError> {
        let version = u16::from_be_bytes([bytes[0], bytes[1]]);
        if !(1..=2).contains(&version) {
            return Err(IgtlError::Version(version));
        }
        let number = |at: usize| u64::from_be_bytes(std::array::from_fn(|k| bytes[at + k]));
        let body = number(42);
        if body > MOST_BODY {
            return Err(IgtlError::TooLong(body));
        }
        let (kind, device) = (text(&bytes[2..14]), text(&bytes[14..34]));
        Ok(Self { version, kind, device, time: time(number(34)), body, crc: number(50) })
    }
}

/// Text up to its first zero byte.
pub(super) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim_end().to_owned()
}

/// Seconds since 1970 in 32.32 fixed point; 0 is no time.
fn stamp(time: Option<SystemTime>) -> u64 {
    let since = time.and_then(|t| t.duration_since(UNIX_EPOCH).ok()).unwrap_or_default();
    let fraction = (u64::from(since.subsec_nanos()) << 32) / 1_000_000_000;
    since.as_secs() << 32 | fraction
}

fn time(stamp: u64) -> Option<SystemTime> {
    // Rounded up, so that a stamp of whole nanoseconds comes back.
    let nanoseconds = ((stamp & 0xFFFF_FFFF) * 1_000_000_000).div_ceil(1 << 32);
    let since = Duration::from_secs(stamp >> 32) + Duration::from_nanos(nanoseconds);
    (stamp != 0).then(|| UNIX_EPOCH + since)
}

/// ASCII in a field of fixed length, zeros behind it.
pub(super) fn put_text(out: &mut Vec<u8>, text: &str, length: usize) {
    let ascii = text.chars().map(|c| if c.is_ascii() { c as u8 } else { b'?' });
    let end = out.len() + length;
    out.extend(ascii.take(length));
    out.resize(end, 0);
}

/// A message of header version 1, which every reader knows: `body` appends its body.
pub(super) fn message(kind: &str, head: Head, body: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut out = Vec::new();
    out.extend(1u16.to_be_bytes());
    put_text(&mut out, kind, 12);
    put_text(&mut out, head.device, 20);
    out.extend(stamp(head.time).to_be_bytes());
    out.extend([0; 16]);
    body(&mut out);
    let (length, crc) = ((out.len() - HEADER) as u64, crc64(&out[HEADER..]));
    out[42..50].copy_from_slice(&length.to_be_bytes());
    out[50..58].copy_from_slice(&crc.to_be_bytes());
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_come_back_to_the_nanosecond() {
        for nanoseconds in [0, 1, 499_999_999, 500_000_000, 999_999_999] {
            let known = UNIX_EPOCH + Duration::new(1_700_000_000, nanoseconds);
            assert_eq!(time(stamp(Some(known))), Some(known));
        }
        let half = UNIX_EPOCH + Duration::new(3, 500_000_000);
        assert_eq!(stamp(Some(half)), 0x3_8000_0000, "fixed point, not nanoseconds");
        assert_eq!((stamp(None), time(0)), (0, None));
    }

    #[test]
    fn names_are_cut_to_their_field() {
        let bytes = message("STRING", Head { device: &"x".repeat(30), time: None }, |_| {});
        assert_eq!((bytes.len(), &bytes[14..34]), (HEADER, "x".repeat(20).as_bytes()));
        let header = Header::parse(bytes.first_chunk().unwrap()).unwrap();
        assert_eq!((header.kind.as_str(), header.device.len()), ("STRING", 20));
        assert_eq!((header.version, header.body, header.crc, header.time), (1, 0, 0, None));
    }
}
