//! H.264 in mp4, decoded without system packages.
//!
//! The container is read by an own bounded parser, picture by picture from the file. A picture that
//! cannot be decoded costs itself: the others keep their numbers, which are the order of the
//! container's time stamps.

mod boxes;
mod fragments;
mod lists;
mod samples;
mod track;

use super::Picture;
use super::colour::Coding;
use crate::guard::caught;
use lists::Lists;
use rust_h264::decoder::{ChromaFormat, Decoder, Frame};
use rust_h264::error::DecodeError;
use rust_h264::nal::{NalUnit, NalUnitType, parse_avcc, parse_avcc_config, parse_sps_info};
use std::collections::BTreeMap;
use std::io::{Read, Seek};
use track::{Track, read_at};

/// Most macroblocks of a picture: level 5.2 of H.264, 4096 x 2304 px.
const MOST_BLOCKS: u64 = 36_864;
/// Most bytes of one coded picture.
const MOST_PICTURE: u32 = 64 << 20;
/// Pictures that wait for one that is shown before them; H.264 allows 16.
const MOST_WAITING: usize = 17;

/// Samples with what the decoder does not know after which another decoder is asked.
const MOST_UNKNOWN: usize = 50;

/// Why nothing more is decoded.
#[derive(Debug)]
pub(super) enum Stop {
    /// A stream that another decoder may read.
    Unsupported(String),
    /// Broken from the start.
    Damaged(String),
}

/// A picture of the stream, in display order.
pub(super) struct Shown {
    /// The picture, or why it is lost.
    pub(super) content: Result<Picture, String>,
    /// From 0.
    pub(super) number: usize,
    /// A lost picture from which this one was predicted, directly or by others.
    pub(super) rests_on: Option<usize>,
}

/// The video track of a file.
pub(super) struct Stream<R> {
    source: R,
    track: Track,
    config: Vec<u8>,
}

/// Find the first video track; the error says what the file holds instead.
pub(super) fn open<R: Read + Seek>(mut source: R) -> Result<Stream<R>, String> {
    let mut track = Track::read(&mut source)?;
    if ![*b"avc1", *b"avc3"].contains(&track.codec) {
        let codec = track.codec.escape_ascii();
        return Err(format!("the video is coded as {codec}, not H.264"));
    }
    let Some(config) = track.config.take() else {
        return Err("the H.264 track has no parameter sets".into());
    };
    Ok(Stream { source, track, config })
}

impl<R: Read + Seek> Stream<R> {
    /// Pictures the container promises.
    pub(super) fn frame_count(&self) -> usize {
        self.track.samples.len()
    }

    /// Frames a second on average.
    pub(super) fn frame_rate(&self) -> Option<f64> {
        let rate = self.frame_count() as f64 / self.track.seconds?;
        (0.1..=1000.0).contains(&rate).then_some(rate)
    }

    /// Decode everything, in display order, until `each` wants no more.
    pub(super) fn decode(mut self, each: &mut dyn FnMut(Shown) -> bool) -> Result<(), Stop> {
        let config = std::mem::take(&mut self.config);
        let mut coded = Coded::new(&config)?;
        let mut order = Order::new(&self.track, each);
        for index in 0..self.track.samples.len() {
            let mut outcome = |index: usize, outcome| order.resolve(index, outcome);
            match self.sample(index) {
                Ok(bytes) => coded.sample(index, &bytes, &mut outcome)?,
                Err(reason) => coded.lost(index, reason, &mut outcome),
            }
            if order.enough {
                return Ok(());
            }
        }
        coded.finish(&mut |index, outcome| order.resolve(index, outcome))?;
        order.finish();
        Ok(())
    }

    fn sample(&mut self, index: usize) -> Result<Vec<u8>, String> {
        let sample = self.track.samples[index];
        if sample.size > MOST_PICTURE {
            return Err(format!("a coded picture of {} bytes, which none is", sample.size));
        }
        read_at(&mut self.source, sample.offset, u64::from(sample.size))
    }
}

/// What became of a sample.
enum Outcome {
    /// A picture, and its colours.
    Picture(Box<Frame>, [u8; 2], Option<usize>),
    Lost(String),
    /// Half a picture, whose other half is in another sample.
    Half,
}

/// The decoder and what it is in the middle of.
struct Coded<'c> {
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
    fn new(config: &'c [u8]) -> Result<Self, Stop> {
        let damaged = |reason: String| Stop::Damaged(format!("parameter sets: {reason}"));
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
    fn restart(&mut self) -> Result<(), Stop> {
        (self.decoder, self.lists) = (Decoder::new(), Lists::default());
        self.open = None;
        for nal in &self.parameters {
            bounded(nal).map_err(Stop::Unsupported)?;
            self.lists.check(nal).map_err(Stop::Damaged)?;
            let decoder = &mut self.decoder;
            let fed = caught(|| decoder.decode_nal(nal)).map_err(Stop::Damaged)?;
            fed.map_err(|error| stop(error, "parameter sets"))?;
        }
        Ok(())
    }

    fn sample(&mut self, index: usize, bytes: &[u8], tell: &mut Tell) -> Result<(), Stop> {
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
                Err(Stop::Unsupported(reason)) if !self.decoded => {
                    (self.open, self.damage) = (None, Some(self.damage.unwrap_or(index)));
                    self.unknown.push((index, reason));
                    return if self.unknown.len() < MOST_UNKNOWN {
                        Ok(())
                    } else {
                        self.finish(tell)
                    };
                }
                Err(Stop::Unsupported(reason) | Stop::Damaged(reason)) => {
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
    fn feed(&mut self, nal: &NalUnit) -> Result<Option<Frame>, Stop> {
        bounded(nal).map_err(Stop::Unsupported)?;
        self.lists.check(nal).map_err(Stop::Damaged)?;
        let decoder = &mut self.decoder;
        match caught(|| decoder.decode_nal(nal)) {
            Ok(fed) => fed.map_err(|error| stop(error, "its coded data")),
            Err(reason) => {
                self.restart()?;
                Err(Stop::Damaged(reason))
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
    fn lost(&mut self, index: usize, reason: String, tell: &mut Tell) {
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
    fn finish(&mut self, tell: &mut Tell) -> Result<(), Stop> {
        if let Ok(Some(frame)) = self.flush() {
            self.give(frame, tell);
        }
        match self.unknown.pop() {
            Some((_, reason)) if !self.decoded => Err(Stop::Unsupported(reason)),
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

fn stop(error: DecodeError, what: &str) -> Stop {
    match error {
        DecodeError::Unsupported(_) => Stop::Unsupported(format!("H.264 with {error}")),
        error => Stop::Damaged(format!("{what}: {error}")),
    }
}

/// Brings samples from decoding order to that of their time stamps.
struct Order<'a> {
    each: &'a mut dyn FnMut(Shown) -> bool,
    /// Place of every sample in display order.
    rank: Vec<usize>,
    waiting: BTreeMap<usize, Outcome>,
    /// Rank of the next to show.
    next: usize,
    /// Pictures shown or lost.
    given: usize,
    enough: bool,
}

impl<'a> Order<'a> {
    fn new(track: &Track, each: &'a mut dyn FnMut(Shown) -> bool) -> Self {
        let mut order: Vec<usize> = (0..track.samples.len()).collect();
        order.sort_by_key(|&i| track.samples[i].time);
        let mut rank = vec![0; order.len()];
        order.into_iter().enumerate().for_each(|(r, i)| rank[i] = r);
        Self { each, rank, waiting: BTreeMap::new(), next: 0, given: 0, enough: false }
    }

    fn resolve(&mut self, index: usize, outcome: Outcome) {
        let rank = self.rank[index];
        if rank >= self.next {
            self.waiting.insert(rank, outcome);
        }
        while self.waiting.contains_key(&self.next) || self.waiting.len() > MOST_WAITING {
            self.show();
        }
    }

    /// The next in turn, whether it is there or not.
    fn show(&mut self) {
        let late = || Outcome::Lost("it comes more than 16 pictures late in the file".into());
        let outcome = self.waiting.remove(&self.next).unwrap_or_else(late);
        self.next += 1;
        let (content, damage) = match outcome {
            Outcome::Half => return,
            Outcome::Lost(reason) => (Err(reason), None),
            Outcome::Picture(frame, [matrix, full], damage) => {
                (picture(&frame, matrix, full == 1), damage)
            }
        };
        let rests_on = damage.map(|index| self.rank[index]);
        self.enough |= !(self.each)(Shown { content, number: self.given, rests_on });
        self.given += 1;
    }

    /// What is not known by now never came: of a stream in fields the second halves.
    fn finish(&mut self) {
        for rank in self.next..self.rank.len() {
            self.waiting.entry(rank).or_insert(Outcome::Half);
        }
        while !self.enough && self.next < self.rank.len() {
            self.show();
        }
    }
}

/// Encoded RGB of a decoded frame; each chroma sample serves the pixels it covers.
fn picture(frame: &Frame, matrix: u8, full_range: bool) -> Result<Picture, String> {
    let size = [frame.width as usize, frame.height as usize];
    let factors = Coding::new(matrix, full_range, size).factors();
    let shift = frame.bit_depth.saturating_sub(8);
    let value = |plane: &[u8], i: usize| (frame.sample(plane, i) >> shift) as u8;
    let rows = if frame.chroma_format == ChromaFormat::Yuv420 { 2 } else { 1 };
    let chroma = [frame.chroma_width() as usize, frame.chroma_height() as usize];
    let bytes = frame.bytes_per_sample();
    let short = |plane: &[u8], [w, h]: [usize; 2]| w * h == 0 || plane.len() < w * h * bytes;
    if short(&frame.y, size) || short(&frame.u, chroma) || short(&frame.v, chroma) {
        return Err(format!("a picture of {} x {} px without all its samples", size[0], size[1]));
    }
    let mut rgb = Vec::with_capacity(size[0] * size[1]);
    for y in 0..size[1] {
        // Of an odd size the last sample serves one pixel more.
        let row = (y / rows).min(chroma[1] - 1) * chroma[0];
        for x in 0..size[0] {
            let i = row + (x / 2).min(chroma[0] - 1);
            let luma = value(&frame.y, y * size[0] + x);
            rgb.push(factors.rgb(luma, value(&frame.u, i), value(&frame.v, i)));
        }
    }
    Ok(Picture { size, rgb })
}
