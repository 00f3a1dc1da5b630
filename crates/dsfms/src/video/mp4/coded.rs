//! The decoder, fed sample by sample; what fails costs its own sample.

use super::lists::Lists;
use crate::guard::caught;
use rust_h264::decoder::{Decoder, Frame};
use rust_h264::error::DecodeError;
use rust_h264::nal::{NalUnit, NalUnitType, parse_avcc, parse_avcc_config, parse_sps_info};

/// Most macroblocks of a picture: level 5.2 of H.264, 4096 x 2304 px.
const MOST_BLOCKS: u64 = 36_864;

/// Samples with what the decoder does not know after which another decoder is asked.
const MOST_UNKNOWN: usize = 50;

/// Why nothing more is decoded.
#[derive(Debug)]
pub(in crate::video) enum DecodeStop {
    /// A stream that another decoder may read.
    Unsupported(String),
    /// Broken from the start.
    Damaged(String),
}

/// What became of a sample.
pub(super) enum Outcome {
    /// A picture, and its colours.
    Picture(Box<Frame>, [u8; 2], Option<usize>),
    Lost(String),
    /// Half a picture, whose other half is in another sample.
    Half,
}

/// The decoder and what it is in the middle of.
pub(super) struct Coded<'c> {
    decoder: Decoder,
    lists: Lists,
    parameters: Vec<NalUnit<'c>>,
    length_size: usize,
    /// Matrix, and 1 for the full range.
    colour: [u8; 2],
    /// Every sample is a whole picture.
    whole: bool,
    /// The sample of the picture that is not finished.
    open: Option<usize>,
    /// The first lost sample since the last that needs no other.
    damage: Option<usize>,
    /// A picture has been decoded.
    decoded: bool,
    /// Before that: samples with what the decoder does not know. Damage can look so, too.
    unknown: Vec<(usize, String)>,
}

type Tell<'a> = dyn FnMut(usize, Outcome) + 'a;

impl<'c> Coded<'c> {
    pub(super) fn new(config: &'c [u8]) -> Result<Self, DecodeStop> {
        let damaged = |reason: String| DecodeStop::Damaged(format!("parameter sets: {reason}"));
        let config = caught(|| parse_avcc_config(config)).map_err(damaged)?;
        let config = config.map_err(|reason| damaged(reason.into()))?;
        let sps = config.sps_nals.first().map(|sps| caught(|| parse_sps_info(sps)));
        let info = sps.transpose().map_err(damaged)?.and_then(Result::ok);
        let mut coded = Self {
            decoder: Decoder::new(),
            lists: Lists::default(),
            parameters: config.sps_nals.into_iter().chain(config.pps_nals).collect(),
            length_size: config.length_size,
            colour: info.map_or([2, 0], |i| [i.matrix, u8::from(i.full_range)]),
            whole: info.is_none_or(|i| i.progressive),
            open: None,
            damage: None,
            decoded: false,
            unknown: Vec::new(),
        };
        coded.restart()?;
        Ok(coded)
    }

    /// A fresh decoder with the parameter sets of the container.
    fn restart(&mut self) -> Result<(), DecodeStop> {
        (self.decoder, self.lists) = (Decoder::new(), Lists::default());
        self.open = None;
        for nal in &self.parameters {
            bounded(nal).map_err(DecodeStop::Unsupported)?;
            self.lists.check(nal).map_err(DecodeStop::Damaged)?;
            let decoder = &mut self.decoder;
            let fed = caught(|| decoder.decode_nal(nal)).map_err(DecodeStop::Damaged)?;
            fed.map_err(|error| stop(error, "parameter sets"))?;
        }
        Ok(())
    }

    pub(super) fn sample(
        &mut self,
        index: usize,
        bytes: &[u8],
        tell: &mut Tell,
    ) -> Result<(), DecodeStop> {
        if !lengths_add_up(bytes, self.length_size) {
            self.lost(index, "its coded parts do not add up to its length".into(), tell);
            return Ok(());
        }
        let nals = parse_avcc(bytes, self.length_size);
        let is_slice =
            |n: &&NalUnit| matches!(n.nal_unit_type, NalUnitType::Slice | NalUnitType::SliceIdr);
        let slices = || nals.iter().filter(is_slice);
        if slices().any(|n| n.nal_unit_type == NalUnitType::SliceIdr) {
            self.damage = None;
        }
        let needed = slices().count() == 0 || slices().any(|n| n.nal_ref_idc > 0);
        let mut failed = None;
        for nal in &nals {
            match self.feed(nal) {
                Ok(Some(frame)) => self.give(frame, tell),
                Ok(None) => {}
                Err(DecodeStop::Unsupported(reason)) if !self.decoded => {
                    (self.open, self.damage) = (None, Some(self.damage.unwrap_or(index)));
                    self.unknown.push((index, reason));
                    return if self.unknown.len() < MOST_UNKNOWN {
                        Ok(())
                    } else {
                        self.finish(tell)
                    };
                }
                Err(DecodeStop::Unsupported(reason) | DecodeStop::Damaged(reason)) => {
                    failed = Some(reason);
                    break;
                }
            }
            if is_slice(&nal) {
                self.open.get_or_insert(index);
            }
        }
        if let Some(reason) = failed {
            self.fail(index, reason, needed, tell);
        } else if self.whole {
            match self.flush() {
                Ok(Some(frame)) => self.give(frame, tell),
                Ok(None) => self.fail(index, "it holds no picture".into(), needed, tell),
                Err(reason) => self.fail(index, reason, needed, tell),
            }
        }
        Ok(())
    }

    /// One unit; a decoder that panicked is replaced.
    fn feed(&mut self, nal: &NalUnit) -> Result<Option<Frame>, DecodeStop> {
        bounded(nal).map_err(DecodeStop::Unsupported)?;
        self.lists.check(nal).map_err(DecodeStop::Damaged)?;
        let decoder = &mut self.decoder;
        match caught(|| decoder.decode_nal(nal)) {
            Ok(fed) => fed.map_err(|error| stop(error, "its coded data")),
            Err(reason) => {
                self.restart()?;
                Err(DecodeStop::Damaged(reason))
            }
        }
    }

    fn flush(&mut self) -> Result<Option<Frame>, String> {
        let decoder = &mut self.decoder;
        let flushed = caught(|| decoder.flush());
        if flushed.is_err() && self.restart().is_err() {
            self.decoder = Decoder::new();
        }
        flushed
    }

    /// A finished picture goes to the sample in which it began.
    fn give(&mut self, frame: Frame, tell: &mut Tell) {
        self.decoded = true;
        self.unknown.drain(..).for_each(|(index, reason)| tell(index, Outcome::Lost(reason)));
        if let Some(index) = self.open.take() {
            tell(index, Outcome::Picture(Box::new(frame), self.colour, self.damage));
        }
    }

    /// A sample whose bytes are not there or not whole.
    pub(super) fn lost(&mut self, index: usize, reason: String, tell: &mut Tell) {
        self.fail(index, reason, true, tell);
    }

    fn fail(&mut self, index: usize, reason: String, needed: bool, tell: &mut Tell) {
        // A picture that began before goes down with it: the decoder does not give it out any more.
        if let Some(before) = self.open.take().filter(|before| *before != index) {
            tell(
                before,
                Outcome::Lost(format!("the data of its second half are damaged: {reason}")),
            );
        }
        tell(index, Outcome::Lost(reason));
        if needed {
            self.damage.get_or_insert(index);
        }
    }

    /// The end; an error where nothing was decoded and the decoder says that it cannot.
    pub(super) fn finish(&mut self, tell: &mut Tell) -> Result<(), DecodeStop> {
        if let Ok(Some(frame)) = self.flush() {
            self.give(frame, tell);
        }
        match self.unknown.pop() {
            Some((_, reason)) if !self.decoded => Err(DecodeStop::Unsupported(reason)),
            _ => Ok(()),
        }
    }
}

/// Parameter sets within bounds: what they say is allocated.
fn bounded(nal: &NalUnit) -> Result<(), String> {
    if nal.nal_unit_type != NalUnitType::Sps {
        return Ok(());
    }
    // What cannot be understood is refused by the decoder too.
    let Ok(Ok(info)) = caught(|| parse_sps_info(nal)) else { return Ok(()) };
    let [w, h] = [info.coded_width, info.coded_height].map(u64::from);
    if w * h > 256 * MOST_BLOCKS || w > 16384 || h > 16384 || info.reference_frames > 16 {
        return Err(format!("H.264 pictures of {w} x {h} px, more than 4096 x 2304"));
    }
    Ok(())
}

/// Whether the lengths before the units cover the sample; zeros at the end are padding.
fn lengths_add_up(mut bytes: &[u8], length_size: usize) -> bool {
    while bytes.iter().any(|&b| b != 0) {
        let Some((head, rest)) = bytes.split_at_checked(length_size) else { return false };
        let length = head.iter().fold(0_usize, |n, &b| n << 8 | usize::from(b));
        let Some(rest) = rest.get(length..) else { return false };
        bytes = rest;
    }
    true
}

fn stop(error: DecodeError, what: &str) -> DecodeStop {
    match error {
        DecodeError::Unsupported(_) => DecodeStop::Unsupported(format!("H.264 with {error}")),
        error => DecodeStop::Damaged(format!("{what}: {error}")),
    }
}
