//! The sample table of a track: where every coded picture lies, and when it is shown.

use super::boxes::{BoxFields, child, word};

/// Most coded pictures of a video: 19 hours at 30 frames a second.
pub(super) const MOST_SAMPLES: usize = 1 << 21;

/// A coded picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CodedSample {
    /// Place in the file, bytes.
    pub(super) offset: u64,
    pub(super) size: u32,
    /// When it is shown, in ticks of the track.
    pub(super) time: i64,
    /// Nothing before it is needed to decode it.
    pub(super) key: bool,
}

/// The samples of `stbl` and the ticks that they last.
pub(super) fn read(stbl: &[u8]) -> Result<(Vec<CodedSample>, u64), String> {
    let sizes = Sizes::read(stbl)?;
    let mut samples = Vec::with_capacity(sizes.count.min(MOST_SAMPLES));
    place(stbl, &sizes, &mut samples)?;
    if samples.len() < sizes.count {
        return Err(format!("its chunks hold {} of {} samples", samples.len(), sizes.count));
    }
    let ticks = times(stbl, &mut samples)?;
    if let Some(stss) = child(stbl, *b"stss")? {
        let mut fields = BoxFields(stss);
        fields.full()?;
        for entry in fields.table::<4>("stss")? {
            let number = u32::from_be_bytes(*entry) as usize;
            if let Some(sample) = number.checked_sub(1).and_then(|i| samples.get_mut(i)) {
                sample.key = true;
            }
        }
    } else {
        samples.iter_mut().for_each(|s| s.key = true);
    }
    Ok((samples, ticks))
}

/// `stsz`: one size for all, or each its own; `stz2` is not written for video.
struct Sizes<'a> {
    count: usize,
    common: u32,
    each: &'a [[u8; 4]],
}

impl<'a> Sizes<'a> {
    fn read(stbl: &'a [u8]) -> Result<Self, String> {
        let Some(stsz) = child(stbl, *b"stsz")? else {
            // A fragmented file has its samples elsewhere.
            return Ok(Self { count: 0, common: 0, each: &[] });
        };
        let mut fields = BoxFields(stsz);
        fields.full()?;
        let common = fields.u32()?;
        let mut peek = fields;
        let count = peek.u32()? as usize;
        if count > MOST_SAMPLES {
            return Err(format!("it states {count} frames, at most {MOST_SAMPLES} are read"));
        }
        let each = if common == 0 { fields.table::<4>("stsz")? } else { &[] };
        Ok(Self { count, common, each })
    }

    fn of(&self, sample: usize) -> u32 {
        self.each.get(sample).map_or(self.common, |size| u32::from_be_bytes(*size))
    }
}

/// Offsets from the chunks (`stco` or `co64`) and the samples in each (`stsc`).
fn place(stbl: &[u8], sizes: &Sizes, samples: &mut Vec<CodedSample>) -> Result<(), String> {
    let Some(stsc) = child(stbl, *b"stsc")? else { return Ok(()) };
    let mut fields = BoxFields(stsc);
    fields.full()?;
    let runs = fields.table::<12>("stsc")?;
    let mut run = 0;
    for (chunk, start) in chunks(stbl)?.into_iter().enumerate() {
        // Runs count their first chunk from 1.
        while runs.get(run + 1).is_some_and(|next| word(next, 0) as usize <= chunk + 1) {
            run += 1;
        }
        let Some(entry) = runs.get(run) else { break };
        let mut offset = start;
        for _ in 0..word(entry, 4) {
            if samples.len() == sizes.count {
                return Ok(());
            }
            let size = sizes.of(samples.len());
            samples.push(CodedSample { offset, size, time: 0, key: false });
            offset = offset.saturating_add(u64::from(size));
        }
    }
    Ok(())
}

fn chunks(stbl: &[u8]) -> Result<Vec<u64>, String> {
    let (content, wide) = match child(stbl, *b"stco")? {
        Some(content) => (content, false),
        None => match child(stbl, *b"co64")? {
            Some(content) => (content, true),
            None => return Ok(Vec::new()),
        },
    };
    let mut fields = BoxFields(content);
    fields.full()?;
    Ok(if wide {
        fields.table::<8>("co64")?.iter().map(|entry| u64::from_be_bytes(*entry)).collect()
    } else {
        fields.table::<4>("stco")?.iter().map(|entry| u64::from(word(entry, 0))).collect()
    })
}

/// Times of showing: durations (`stts`) summed, moved by `ctts`. Returns the sum of the durations.
fn times(stbl: &[u8], samples: &mut [CodedSample]) -> Result<u64, String> {
    let entries = |kind| -> Result<(u8, &[[u8; 8]]), String> {
        let Some(content) = child(stbl, kind)? else { return Ok((0, &[])) };
        let mut fields = BoxFields(content);
        let (version, _) = fields.full()?;
        Ok((version, fields.table::<8>("stts or ctts")?))
    };
    let (_, durations) = entries(*b"stts")?;
    let mut now = 0_u64;
    let mut at = 0;
    let mut last = 0;
    for entry in durations {
        last = u64::from(word(entry, 4));
        let more = (word(entry, 0) as usize).min(samples.len() - at);
        for sample in &mut samples[at..at + more] {
            sample.time = now as i64;
            now += last;
        }
        at += more;
    }
    // Where the table is too short, the last duration goes on.
    for sample in &mut samples[at..] {
        sample.time = now as i64;
        now += last;
    }
    let (_, offsets) = entries(*b"ctts")?;
    let mut at = 0;
    for entry in offsets {
        let more = (word(entry, 0) as usize).min(samples.len() - at);
        // Version 0 says unsigned, but files with negative offsets exist in it too.
        let shift = i64::from(word(entry, 4) as i32);
        samples[at..at + more].iter_mut().for_each(|s| s.time += shift);
        at += more;
    }
    Ok(now)
}
