//! H.264 in mp4, decoded without system packages.
//!
//! The container is read by an own bounded parser, picture by picture from the file. A picture that
//! cannot be decoded costs itself: the others keep their numbers, which are the order of the
//! container's time stamps.

mod boxes;
mod coded;
mod fragments;
mod lists;
mod order;
mod samples;
mod track;

use coded::Coded;
pub(super) use coded::DecodeStop;
use order::Order;
pub(super) use order::ShownPicture;
use std::io::{Read, Seek};
use track::{Track, read_at};

/// Most bytes of one coded picture.
const MOST_PICTURE: u32 = 64 << 20;

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
    pub(super) fn decode(
        mut self,
        each: &mut dyn FnMut(ShownPicture) -> bool,
    ) -> Result<(), DecodeStop> {
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
