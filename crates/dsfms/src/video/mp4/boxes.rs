//! Boxes of the ISO base media file format (ISO/IEC 14496-12): a length, a kind, content. Every
//! step goes forward, within the bytes that are there.

/// Four letters.
pub(super) type Kind = [u8; 4];

/// The boxes within the content of another.
pub(super) struct Boxes<'a>(pub(super) &'a [u8]);

impl<'a> Iterator for Boxes<'a> {
    type Item = Result<(Kind, &'a [u8]), String>;

    fn next(&mut self) -> Option<Self::Item> {
        let bytes = self.0;
        // Up to seven bytes of padding are seen at the end of sample entries.
        if bytes.len() < 8 {
            return None;
        }
        let header = match BoxHeader::parse(bytes, bytes.len() as u64) {
            Ok(header) => header,
            Err(reason) => {
                self.0 = &[];
                return Some(Err(reason));
            }
        };
        let (start, end) = (header.start as usize, header.length as usize);
        self.0 = &bytes[end..];
        Some(Ok((header.kind, &bytes[start..end])))
    }
}

/// Where a box lies, counted from its first byte.
pub(super) struct BoxHeader {
    pub(super) kind: Kind,
    /// First byte of the content.
    pub(super) start: u64,
    /// Of the whole box.
    pub(super) length: u64,
}

impl BoxHeader {
    /// From the first 8 to 16 bytes of a box, of which at most `room` bytes are there.
    pub(super) fn parse(bytes: &[u8], room: u64) -> Result<Self, String> {
        let mut fields = BoxFields(bytes);
        let short = u64::from(fields.u32()?);
        let kind = fields.take()?;
        let (start, length) = match short {
            0 => (8, room),
            1 => (16, fields.u64()?),
            length => (8, length),
        };
        let name = kind.escape_ascii();
        if length < start {
            return Err(format!(
                "box '{name}' is {length} bytes long, shorter than its own header"
            ));
        }
        if length > room {
            return Err(format!(
                "box '{name}' is {length} bytes long, only {room} are there (truncated file)"
            ));
        }
        Ok(Self { kind, start, length })
    }
}

/// The first box of a kind.
pub(super) fn child(bytes: &[u8], kind: Kind) -> Result<Option<&[u8]>, String> {
    for found in Boxes(bytes) {
        let (k, content) = found?;
        if k == kind {
            return Ok(Some(content));
        }
    }
    Ok(None)
}

/// The box at the end of a path.
pub(super) fn descend<'a>(mut bytes: &'a [u8], path: &[Kind]) -> Result<Option<&'a [u8]>, String> {
    for &kind in path {
        let Some(content) = child(bytes, kind)? else { return Ok(None) };
        bytes = content;
    }
    Ok(Some(bytes))
}

/// Big-endian numbers one after the other.
#[derive(Clone, Copy)]
pub(super) struct BoxFields<'a>(pub(super) &'a [u8]);

impl<'a> BoxFields<'a> {
    pub(super) fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let Some((first, rest)) = self.0.split_first_chunk::<N>() else {
            return Err("a box ends within its fields (truncated file)".into());
        };
        self.0 = rest;
        Ok(*first)
    }

    pub(super) fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_be_bytes(self.take()?))
    }

    pub(super) fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_be_bytes(self.take()?))
    }

    /// Version and flags.
    pub(super) fn full(&mut self) -> Result<(u8, u32), String> {
        let word = self.u32()?;
        Ok(((word >> 24) as u8, word & 0xFF_FFFF))
    }

    /// A counted table of `N`-byte entries, which must all be there.
    pub(super) fn table<const N: usize>(&mut self, name: &str) -> Result<&'a [[u8; N]], String> {
        let count = self.u32()? as usize;
        let (entries, _) = self.0.as_chunks::<N>();
        entries.get(..count).ok_or_else(|| {
            format!("table '{name}' states {count} entries, only {} are there", entries.len())
        })
    }
}

/// A 32-bit number within an entry.
pub(super) fn word<const N: usize>(entry: &[u8; N], at: usize) -> u32 {
    entry.get(at..at + 4).map_or(0, |b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_end_where_they_must() {
        let free = [&12u32.to_be_bytes()[..], b"freeabcd"].concat();
        let all: Vec<_> =
            Boxes(&[&free[..], &free].concat()).map(|b| b.unwrap().1.to_vec()).collect();
        assert_eq!(all, [b"abcd", b"abcd"]);
        // Length 0 to the end, 1 with 64 bits, less than a header, more than there is.
        let with = |length: u32| [&length.to_be_bytes()[..], &free[4..]].concat();
        assert_eq!(Boxes(&with(0)).next().unwrap().unwrap().1, b"abcd");
        for bad in [1, 7, 13, u32::MAX] {
            assert!(Boxes(&with(bad)).next().unwrap().is_err(), "{bad}");
        }
        let long = [&1u32.to_be_bytes()[..], b"free", &17u64.to_be_bytes(), b"x"].concat();
        assert_eq!(Boxes(&long).next().unwrap().unwrap().1, b"x");
    }
}
