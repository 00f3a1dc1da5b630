//! Messages that others send.

use super::IgtlError;
use super::crc::crc64;
use super::header::{HEADER, Header};
use std::io::{ErrorKind, Read};

/// A message whose checksum is right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// What stood before it.
    pub header: Header,
    /// Its content, without the extended header and the metadata of version 3.
    pub content: Vec<u8>,
}

/// The next message of a stream; `None` at its end. Bodies of messages that are not `wanted` are
/// read past and never stored; of the others no more is stored than has come.
///
/// # Errors
/// Those after which the stream is of no more use ([`IgtlError::fatal`]), and those of one message.
pub fn read(
    stream: &mut impl Read,
    wanted: impl Fn(&Header) -> bool,
) -> Result<Option<Received>, IgtlError> {
    loop {
        let mut bytes = [0; HEADER];
        match fill(stream, &mut bytes)? {
            0 => return Ok(None),
            HEADER => {}
            read => return Err(IgtlError::Half { read: read as u64, of: HEADER as u64 }),
        }
        let header = Header::parse(&bytes)?;
        let half = |read| IgtlError::Half { read, of: header.body };
        let mut body = stream.take(header.body);
        if !wanted(&header) {
            let read = std::io::copy(&mut body, &mut std::io::sink())?;
            if read < header.body {
                return Err(half(read));
            }
            continue;
        }
        let mut content = Vec::new();
        body.read_to_end(&mut content)?;
        if (content.len() as u64) < header.body {
            return Err(half(content.len() as u64));
        }
        let crc = crc64(&content);
        if crc != header.crc {
            return Err(IgtlError::Crc { found: crc, said: header.crc });
        }
        if header.version >= 2 {
            content = without_extension(content)?;
        }
        return Ok(Some(Received { header, content }));
    }
}

/// Fill a buffer; how much of it, where the stream ends.
fn fill(stream: &mut impl Read, bytes: &mut [u8]) -> Result<usize, IgtlError> {
    let mut filled = 0;
    while filled < bytes.len() {
        match stream.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(filled)
}

/// The content between the extended header and the metadata.
fn without_extension(body: Vec<u8>) -> Result<Vec<u8>, IgtlError> {
    let damaged = || IgtlError::Content("its extended header does not fit its body".into());
    let fixed: &[u8; 12] = body.first_chunk().ok_or_else(damaged)?;
    let short = |at: usize| usize::from(u16::from_be_bytes([fixed[at], fixed[at + 1]]));
    let metadata = u32::from_be_bytes([fixed[4], fixed[5], fixed[6], fixed[7]]);
    let behind = short(2).checked_add(metadata as usize).ok_or_else(damaged)?;
    let end = body.len().checked_sub(behind).ok_or_else(damaged)?;
    let start = short(0);
    if start < 12 || start > end {
        return Err(damaged());
    }
    Ok(body[start..end].to_vec())
}
