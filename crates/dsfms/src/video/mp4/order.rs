//! From decoding order to that of the time stamps.

use super::super::colour::Coding;
use super::super::frame::DecodedPicture;
use super::coded::Outcome;
use super::track::Track;
use rust_h264::decoder::{ChromaFormat, Frame};
use std::collections::BTreeMap;

/// Pictures that wait for one that is shown before them; H.264 allows 16.
const MOST_WAITING: usize = 17;

/// A picture of the stream, in display order.
pub(in crate::video) struct ShownPicture {
    /// The picture, or why it is lost.
    pub(in crate::video) content: Result<DecodedPicture, String>,
    /// From 0.
    pub(in crate::video) number: usize,
    /// A lost picture from which this one was predicted, directly or by others.
    pub(in crate::video) rests_on: Option<usize>,
}

/// Brings samples from decoding order to that of their time stamps.
pub(super) struct Order<'a> {
    each: &'a mut dyn FnMut(ShownPicture) -> bool,
    /// Place of every sample in display order.
    rank: Vec<usize>,
    waiting: BTreeMap<usize, Outcome>,
    /// Rank of the next to show.
    next: usize,
    /// Pictures shown or lost.
    given: usize,
    /// No more is wanted.
    pub enough: bool,
}

impl<'a> Order<'a> {
    pub(super) fn new(track: &Track, each: &'a mut dyn FnMut(ShownPicture) -> bool) -> Self {
        let mut order: Vec<usize> = (0..track.samples.len()).collect();
        order.sort_by_key(|&i| track.samples[i].time);
        let mut rank = vec![0; order.len()];
        order.into_iter().enumerate().for_each(|(r, i)| rank[i] = r);
        Self { each, rank, waiting: BTreeMap::new(), next: 0, given: 0, enough: false }
    }

    pub(super) fn resolve(&mut self, index: usize, outcome: Outcome) {
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
        self.enough |= !(self.each)(ShownPicture { content, number: self.given, rests_on });
        self.given += 1;
    }

    /// What is not known by now never came: of a stream in fields the second halves.
    pub(super) fn finish(&mut self) {
        for rank in self.next..self.rank.len() {
            self.waiting.entry(rank).or_insert(Outcome::Half);
        }
        while !self.enough && self.next < self.rank.len() {
            self.show();
        }
    }
}

/// Encoded RGB of a decoded frame; each chroma sample serves the pixels it covers.
fn picture(frame: &Frame, matrix: u8, full_range: bool) -> Result<DecodedPicture, String> {
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
    Ok(DecodedPicture { size, rgb })
}
