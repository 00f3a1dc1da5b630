//! Kinds of input, and what takes the frames of a stream.

use clap::ValueEnum;
use dsfms::image::Frame;
use std::path::Path;
use std::time::SystemTime;

/// What standard input holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum InputFormat {
    /// RGB, 8 bits a channel, row by row, of the size that --size says.
    #[default]
    Raw,
    /// JPEG pictures one after the other.
    Mjpeg,
}

/// Beginnings of addresses that ffmpeg reads.
const SCHEMES: [&str; 7] =
    ["rtsp://", "rtsps://", "rtmp://", "srt://", "udp://", "http://", "https://"];

/// Whether an input names no file.
pub fn is_address(input: &Path) -> bool {
    is_igtl(input) || begins(input, &SCHEMES)
}

/// Whether an input names an OpenIGTLink server.
pub fn is_igtl(input: &Path) -> bool {
    begins(input, &["igtl://"])
}

fn begins(input: &Path, schemes: &[&str]) -> bool {
    input.to_str().is_some_and(|text| schemes.iter().any(|scheme| text.starts_with(scheme)))
}

/// What takes the frames of a stream, one after the other.
pub trait FrameTaker {
    /// Frames until now.
    fn seen(&self) -> usize;
    /// The name of the next frame, where it has none of its own.
    fn name(&self) -> String;
    /// When the next frame was made.
    fn made_at(&mut self, time: Option<SystemTime>);
    /// The next frame; `false` where nobody wants more.
    fn take(&mut self, frame: Frame) -> bool;
    /// The next frame cannot be read; `false` where nobody wants more.
    fn lose(&mut self, name: String, reason: String) -> bool;
}
