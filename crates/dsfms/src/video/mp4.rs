//! H.264 in mp4, decoded without system packages.

use super::Picture;
use super::colour::Coding;
use rust_h264::decoder::{ChromaFormat, Frame};
use rust_h264::error::DecodeError;
use rust_h264::nal::{NalUnit, parse_avcc, parse_avcc_config, parse_sps_info};
use rust_h264::threading::ThreadedDecoder;

/// Why decoding stopped.
pub(super) enum Stop {
    /// A stream that another decoder may read.
    Unsupported(String),
    /// A broken stream.
    Damaged(String),
}

/// The video track of a file in memory.
pub(super) struct Stream<'a> {
    bytes: &'a [u8],
    samples: Vec<std::ops::Range<usize>>,
    config: Vec<u8>,
    /// Of the track, seconds.
    duration: f64,
}

/// Find the first H.264 track; the error says what the file holds instead.
pub(super) fn open(bytes: &[u8]) -> Result<Stream<'_>, String> {
    let file = re_mp4::Mp4::read_bytes(bytes).map_err(|error| format!("no mp4 file ({error})"))?;
    let is_video = |track: &&re_mp4::Track| track.kind == Some(re_mp4::TrackKind::Video);
    let Some(track) = file.tracks().values().find(is_video) else {
        return Err("the mp4 file has no video track".into());
    };
    let content = &track.trak(&file).mdia.minf.stbl.stsd.contents;
    if !matches!(content, re_mp4::StsdBoxContent::Avc1(_)) {
        let codec = track.codec_string(&file).unwrap_or("an unknown codec".into());
        return Err(format!("the video is coded as {codec}, not H.264"));
    }
    let Some(config) = track.raw_codec_config(&file) else {
        return Err("the H.264 track has no parameter sets".into());
    };
    let samples = track.samples.iter().map(|sample| sample.byte_range()).collect();
    let duration = track.duration as f64 / track.timescale as f64;
    Ok(Stream { bytes, samples, config, duration })
}

impl Stream<'_> {
    /// Pictures the container promises.
    pub(super) fn frame_count(&self) -> usize {
        self.samples.len()
    }

    /// Frames a second on average.
    pub(super) fn frame_rate(&self) -> Option<f64> {
        let rate = self.samples.len() as f64 / self.duration;
        (0.1..=1000.0).contains(&rate).then_some(rate)
    }

    /// Decode everything, in display order.
    pub(super) fn decode(&self, each: &mut dyn FnMut(Picture)) -> Result<(), Stop> {
        let config = parse_avcc_config(&self.config)
            .map_err(|error| Stop::Damaged(format!("parameter sets: {error}")))?;
        let colour = config.sps_nals.first().and_then(|sps| parse_sps_info(sps).ok());
        let (matrix, full) = colour.map_or((2, false), |info| (info.matrix, info.full_range));
        // The output does not depend on the number of threads.
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get()).min(8);
        let mut decoder = ThreadedDecoder::new(threads);
        let mut index = 0;
        let mut emit = |frames: Vec<Frame>| {
            for frame in frames {
                each(picture(&frame, index, matrix, full));
                index += 1;
            }
        };
        for nal in config.sps_nals.iter().chain(&config.pps_nals) {
            emit(decode_nal(&mut decoder, nal, "parameter sets")?);
        }
        for (number, range) in self.samples.iter().enumerate() {
            let name = format!("frame {number} in decoding order");
            let cut = || {
                Stop::Damaged(format!("{name} lies beyond the end of the file (truncated file)"))
            };
            let data = self.bytes.get(range.clone()).ok_or_else(cut)?;
            for nal in parse_avcc(data, config.length_size) {
                emit(decode_nal(&mut decoder, &nal, &name)?);
            }
        }
        emit(decoder.flush());
        Ok(())
    }
}

fn decode_nal(
    decoder: &mut ThreadedDecoder,
    nal: &NalUnit,
    name: &str,
) -> Result<Vec<Frame>, Stop> {
    decoder.decode_nal(nal).map_err(|error| match error {
        DecodeError::Unsupported(_) => Stop::Unsupported(format!("H.264 with {error}")),
        error => Stop::Damaged(format!("{name}: {error}")),
    })
}

/// Encoded RGB of a decoded frame; each chroma sample serves the pixels it covers.
fn picture(frame: &Frame, index: usize, matrix: u8, full_range: bool) -> Picture {
    let size = [frame.width as usize, frame.height as usize];
    let factors = Coding::new(matrix, full_range, size).factors();
    let shift = frame.bit_depth.saturating_sub(8);
    let value = |plane: &[u8], i: usize| (frame.sample(plane, i) >> shift) as u8;
    let rows = if frame.chroma_format == ChromaFormat::Yuv420 { 2 } else { 1 };
    let chroma_width = frame.chroma_width() as usize;
    let mut rgb = Vec::with_capacity(size[0] * size[1]);
    for y in 0..size[1] {
        for x in 0..size[0] {
            let chroma = (y / rows) * chroma_width + x / 2;
            let luma = value(&frame.y, y * size[0] + x);
            rgb.push(factors.rgb(luma, value(&frame.u, chroma), value(&frame.v, chroma)));
        }
    }
    Picture { index, size, rgb }
}
