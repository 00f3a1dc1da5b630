//! The video track of an mp4 file, found box by box without reading the pictures.

use super::boxes::{BoxFields, BoxHeader, Boxes, Kind, child, descend};
use super::fragments::{self, Defaults};
use super::samples::{self, CodedSample};
use std::io::{Read, Seek, SeekFrom};

/// Most bytes of the boxes that describe a video (`moov`, and all `moof` together).
const MOST_DESCRIPTION: u64 = 128 << 20;
/// Most boxes at the top of a file.
const MOST_BOXES: usize = 1 << 20;

/// The first video track.
#[derive(Clone, Debug)]
pub(super) struct Track {
    /// Four letters of the coding, `avc1` for H.264.
    pub(super) codec: Kind,
    /// The parameter sets of H.264 (`avcC`).
    pub(super) config: Option<Vec<u8>>,
    /// In decoding order.
    pub(super) samples: Vec<CodedSample>,
    /// Of all samples.
    pub(super) seconds: Option<f64>,
}

impl Track {
    /// Read the description of a file; the error says what it holds instead.
    pub(super) fn read(source: &mut (impl Read + Seek)) -> Result<Self, String> {
        let length = source.seek(SeekFrom::End(0)).map_err(|e| e.to_string())?;
        let mut moov = None;
        let mut moofs: Vec<(u64, Vec<u8>)> = Vec::new();
        let (mut at, mut described) = (0, 0);
        for _ in 0..MOST_BOXES {
            let header = match top(source, at, length) {
                Ok(Some(header)) => header,
                Ok(None) => break,
                // Of a copy that was cut off: the pictures that are there can be decoded.
                Err(_) if moov.is_some() => break,
                Err(reason) => return Err(reason),
            };
            let wanted = [*b"moov", *b"moof"].contains(&header.kind);
            if wanted {
                described += header.length;
                if described > MOST_DESCRIPTION {
                    return Err(format!(
                        "no mp4 file (descriptions of more than {described} bytes)"
                    ));
                }
                let content = read_at(source, at + header.start, header.length - header.start)?;
                if header.kind == *b"moov" {
                    moov.get_or_insert(content);
                } else {
                    moofs.push((at, content));
                }
            }
            at += header.length;
        }
        let Some(moov) = moov else {
            return Err("no mp4 file (no 'moov' box; a recording that was cut off has none)".into());
        };
        Self::of_movie(&moov, &moofs)?.within(length)
    }

    /// Refuse samples that together are larger than the file: they lie over each other, so that one
    /// picture would be decoded for every sample that points to it. What lies beyond the end, of a
    /// copy that was cut off, is not counted.
    fn within(self, length: u64) -> Result<Self, String> {
        let end = |s: &&CodedSample| s.offset.saturating_add(u64::from(s.size));
        let inside = self.samples.iter().filter(|s| end(s) <= length);
        let taken: u64 = inside.map(|s| u64::from(s.size)).sum();
        if taken > length {
            let count = self.samples.len();
            return Err(format!(
                "a damaged mp4 file (its {count} frames take {taken} of its {length} bytes)"
            ));
        }
        Ok(self)
    }

    fn of_movie(moov: &[u8], moofs: &[(u64, Vec<u8>)]) -> Result<Self, String> {
        let wrong = |reason: String| format!("a damaged mp4 file ({reason})");
        for found in Boxes(moov) {
            let (kind, trak) = found.map_err(wrong)?;
            if kind != *b"trak" || !is_video(trak).map_err(wrong)? {
                continue;
            }
            return Self::of_trak(trak, moov, moofs).map_err(wrong);
        }
        Err("the mp4 file has no video track".into())
    }

    fn of_trak(trak: &[u8], moov: &[u8], moofs: &[(u64, Vec<u8>)]) -> Result<Self, String> {
        let missing = || "its video track has no sample table".to_owned();
        let stbl = descend(trak, &[*b"mdia", *b"minf", *b"stbl"])?.ok_or_else(missing)?;
        let (codec, config) = coding(stbl)?;
        let (mut samples, mut ticks) = samples::read(stbl)?;
        let track = track_id(trak)?;
        let defaults = Defaults::read(moov, track)?;
        for (start, moof) in moofs {
            fragments::read(moof, *start, track, defaults, &mut ticks, &mut samples)?;
        }
        let scale = timescale(trak)?.filter(|scale| *scale > 0);
        let seconds = scale.map(|scale| ticks as f64 / f64::from(scale));
        Ok(Self { codec, config, samples, seconds })
    }
}

/// The header of the box at byte `at`; `None` at the end, where less than a header may remain.
fn top(source: &mut (impl Read + Seek), at: u64, length: u64) -> Result<Option<BoxHeader>, String> {
    let room = length.saturating_sub(at);
    if room < 8 {
        return Ok(None);
    }
    let bytes = read_at(source, at, room.min(16))?;
    BoxHeader::parse(&bytes, room).map(Some).map_err(|reason| format!("no mp4 file ({reason})"))
}

/// Bytes of the file; the caller has bounded `count`.
pub(super) fn read_at(
    source: &mut (impl Read + Seek),
    at: u64,
    count: u64,
) -> Result<Vec<u8>, String> {
    source.seek(SeekFrom::Start(at)).map_err(|e| e.to_string())?;
    let mut bytes = Vec::new();
    source.take(count).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    match bytes.len() as u64 == count {
        true => Ok(bytes),
        false => Err("it lies beyond the end of the file (truncated file)".into()),
    }
}

fn is_video(trak: &[u8]) -> Result<bool, String> {
    let hdlr = descend(trak, &[*b"mdia", *b"hdlr"])?;
    Ok(hdlr.and_then(|h| h.get(8..12)) == Some(b"vide"))
}

fn track_id(trak: &[u8]) -> Result<u32, String> {
    let Some(tkhd) = child(trak, *b"tkhd")? else { return Ok(0) };
    let mut fields = BoxFields(tkhd);
    let (version, _) = fields.full()?;
    if version == 1 {
        fields.take::<16>()?;
    } else {
        fields.take::<8>()?;
    }
    fields.u32()
}

fn timescale(trak: &[u8]) -> Result<Option<u32>, String> {
    let Some(mdhd) = descend(trak, &[*b"mdia", *b"mdhd"])? else { return Ok(None) };
    let mut fields = BoxFields(mdhd);
    let (version, _) = fields.full()?;
    if version == 1 {
        fields.take::<16>()?;
    } else {
        fields.take::<8>()?;
    }
    fields.u32().map(Some)
}

/// Bytes of a visual sample entry before its own boxes.
const ENTRY: usize = 78;

/// Kind of the first sample entry, and its `avcC`.
fn coding(stbl: &[u8]) -> Result<(Kind, Option<Vec<u8>>), String> {
    let missing = || "it does not say how its video is coded".to_owned();
    let mut fields = BoxFields(child(stbl, *b"stsd")?.ok_or_else(missing)?);
    fields.full()?;
    fields.u32()?;
    let (kind, entry) = Boxes(fields.0).next().ok_or_else(missing)??;
    let inner = entry.get(ENTRY..).unwrap_or_default();
    Ok((kind, child(inner, *b"avcC")?.map(<[u8]>::to_vec)))
}
