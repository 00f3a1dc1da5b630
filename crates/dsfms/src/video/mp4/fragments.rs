//! Movie fragments (`moof`): the samples of files that are written while they are recorded.

use super::boxes::{BoxFields, Boxes, child};
use super::samples::{CodedSample, MOST_SAMPLES};

/// What a fragment leaves unsaid (`trex`, then `tfhd`).
#[derive(Clone, Copy, Default)]
pub(super) struct Defaults {
    duration: u32,
    size: u32,
    flags: u32,
}

/// Bit of the sample flags: needs other samples.
const NOT_KEY: u32 = 0x1_0000;

impl Defaults {
    /// Of a track, from `moov`.
    pub(super) fn read(moov: &[u8], track: u32) -> Result<Self, String> {
        let Some(mvex) = child(moov, *b"mvex")? else { return Ok(Self::default()) };
        for found in Boxes(mvex) {
            let (kind, content) = found?;
            let mut fields = BoxFields(content);
            if kind == *b"trex" && fields.full().is_ok() && fields.u32()? == track {
                fields.u32()?;
                let (duration, size, flags) = (fields.u32()?, fields.u32()?, fields.u32()?);
                return Ok(Self { duration, size, flags });
            }
        }
        Ok(Self::default())
    }
}

/// The samples of a fragment at byte `start` of the file; `now`: the ticks so far, moved on.
pub(super) fn read(
    moof: &[u8],
    start: u64,
    track: u32,
    defaults: Defaults,
    now: &mut u64,
    samples: &mut Vec<CodedSample>,
) -> Result<(), String> {
    for found in Boxes(moof) {
        let (kind, traf) = found?;
        if kind != *b"traf" {
            continue;
        }
        let Some((own, base, defaults)) = header(traf, start, defaults)? else { continue };
        if own != track {
            continue;
        }
        if let Some(tfdt) = child(traf, *b"tfdt")? {
            let mut fields = BoxFields(tfdt);
            let (version, _) = fields.full()?;
            // Two thirds of a century at any usual tick: the sums below stay within 64 bits.
            let decode = if version == 1 { fields.u64()? } else { u64::from(fields.u32()?) };
            *now = decode.min(1 << 60);
        }
        let mut offset = base;
        for found in Boxes(traf) {
            let (kind, trun) = found?;
            if kind == *b"trun" {
                offset = run(trun, base, offset, defaults, now, samples)?;
            }
        }
    }
    Ok(())
}

/// `tfhd`: track, first byte of its data, defaults.
fn header(
    traf: &[u8],
    start: u64,
    mut defaults: Defaults,
) -> Result<Option<(u32, u64, Defaults)>, String> {
    let Some(tfhd) = child(traf, *b"tfhd")? else { return Ok(None) };
    let mut fields = BoxFields(tfhd);
    let (_, flags) = fields.full()?;
    let track = fields.u32()?;
    let base = if flags & 0x1 != 0 { fields.u64()? } else { start };
    if flags & 0x2 != 0 {
        fields.u32()?;
    }
    for (bit, value) in
        [(0x8, &mut defaults.duration), (0x10, &mut defaults.size), (0x20, &mut defaults.flags)]
    {
        if flags & bit != 0 {
            *value = fields.u32()?;
        }
    }
    Ok(Some((track, base, defaults)))
}

/// `trun`: samples one after the other. Returns the byte behind the last.
fn run(
    trun: &[u8],
    base: u64,
    follows: u64,
    defaults: Defaults,
    now: &mut u64,
    samples: &mut Vec<CodedSample>,
) -> Result<u64, String> {
    let mut fields = BoxFields(trun);
    let (_, flags) = fields.full()?;
    let count = fields.u32()? as usize;
    if count > MOST_SAMPLES - samples.len().min(MOST_SAMPLES) {
        return Err(format!("it states more than {MOST_SAMPLES} frames"));
    }
    let mut offset = follows;
    if flags & 0x1 != 0 {
        offset = base.saturating_add_signed(i64::from(fields.u32()? as i32));
    }
    let mut first = if flags & 0x4 != 0 { Some(fields.u32()?) } else { None };
    for _ in 0..count {
        let mut value =
            |bit: u32, usual: u32| if flags & bit != 0 { fields.u32() } else { Ok(usual) };
        let duration = value(0x100, defaults.duration)?;
        let size = value(0x200, defaults.size)?;
        let own = value(0x400, defaults.flags)?;
        let shift = i64::from(value(0x800, 0)? as i32);
        let key = first.take().unwrap_or(own) & NOT_KEY == 0;
        samples.push(CodedSample { offset, size, time: *now as i64 + shift, key });
        offset = offset.saturating_add(u64::from(size));
        *now += u64::from(duration);
    }
    Ok(offset)
}
