//! Frames of a device or a network stream, read by an installed `ffmpeg` that we run and stop.

use super::args::TrackArgs;
use super::input::FrameTaker;
use crate::exit::Usage;
use anyhow::{Context, bail};
use dsfms::image::Frame;
use dsfms::video::ppm::pictures;
use std::io::BufReader;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A source that ffmpeg reads.
#[derive(Clone, Debug)]
pub struct Capture {
    /// As the user named it.
    name: String,
    /// What ffmpeg is told of its input.
    input: Vec<String>,
    running: Arc<Mutex<Option<Child>>>,
}

impl Capture {
    /// `v4l2:/dev/video0`: a format of ffmpeg and the device's name in it.
    pub fn device(text: &str, args: &TrackArgs) -> Result<Self, Usage> {
        let parts =
            text.split_once(':').filter(|(kind, name)| !kind.is_empty() && !name.is_empty());
        let Some((kind, name)) = parts else {
            let text = format!("--device {text}: expected KIND:NAME, for example v4l2:/dev/video0");
            return Err(Usage(text));
        };
        let mut input = vec!["-f".to_owned(), kind.to_owned()];
        if let Some([w, h]) = args.size {
            input.extend(["-video_size".to_owned(), format!("{w}x{h}")]);
        }
        if let Some(rate) = args.rate {
            input.extend(["-framerate".to_owned(), rate.to_string()]);
        }
        input.extend(["-i".to_owned(), name.to_owned()]);
        Ok(Self { name: text.to_owned(), input, running: Arc::default() })
    }

    /// `rtsp://...`
    pub fn address(text: &str) -> Self {
        // Over TCP: lost packets would be damaged frames.
        let tcp = if text.starts_with("rtsp") { &["-rtsp_transport", "tcp"][..] } else { &[] };
        let input = tcp.iter().chain(&["-i", text]).map(ToString::to_string).collect();
        Self { name: text.to_owned(), input, running: Arc::default() }
    }

    /// Hand over frame after frame, until the source ends or nobody wants more.
    pub(super) fn read(&self, reader: &mut impl FrameTaker) -> anyhow::Result<()> {
        // Into a file: a pipe that nobody empties would stop ffmpeg.
        let log = tempfile::NamedTempFile::new()?;
        let out = self.start(&log)?;
        let mut more = true;
        let read = pictures(BufReader::with_capacity(1 << 16, out), &mut |size, rgb| {
            let name = reader.name();
            more = reader.take(Frame { name, size, rgb });
            more
        });
        if !more {
            self.stop();
        }
        let Some(mut child) = self.lock().take() else { return Ok(()) };
        let status = child.wait()?;
        if !more || (read.is_ok() && status.success()) {
            return Ok(());
        }
        let said = std::fs::read_to_string(log.path()).unwrap_or_default();
        let own = read.err().map_or("nothing".into(), |error| error.to_string());
        bail!("{}: ffmpeg says: {}", self.name, said.lines().last().unwrap_or(&own))
    }

    fn start(&self, log: &tempfile::NamedTempFile) -> anyhow::Result<ChildStdout> {
        let child = Command::new("ffmpeg")
            .args(["-v", "error", "-nostdin", "-flags", "low_delay"])
            .args(&self.input)
            // Frames as they come: none doubled or left out to make an even rate.
            .args(["-map", "0:v:0", "-vsync", "passthrough"])
            .args(["-f", "image2pipe", "-c:v", "ppm", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log.reopen()?)
            .spawn();
        let mut child = child.with_context(|| {
            format!("{} is read through ffmpeg, which was not found; install it (Debian: apt install ffmpeg)", self.name)
        })?;
        let out = child.stdout.take();
        *self.lock() = Some(child);
        out.context("ffmpeg has no output")
    }

    /// Stop ffmpeg, which may wait for a source that sends nothing.
    pub fn stop(&self) {
        if let Some(child) = &mut *self.lock() {
            // It may have ended.
            let _ = child.kill();
        }
    }

    /// A poisoned lock only means that the other thread panicked.
    fn lock(&self) -> MutexGuard<'_, Option<Child>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
