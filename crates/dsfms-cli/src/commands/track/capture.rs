//! Frames of a device or a network stream, read by an installed `ffmpeg` that we run and stop.

use super::args::TrackArgs;
use super::input::FrameTaker;
use crate::exit::Usage;
use anyhow::{Context, bail};
use dsfms::image::Frame;
use dsfms::video::passthrough::passthrough;
use dsfms::video::ppm::pictures;
use dsfms::video::watched::{Watched, WatchedPipe};
use std::io::BufReader;
use std::process::{ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A source that gives nothing for so long is gone: a scope that is taken out and wiped is back
/// sooner, and who waits can stop the run at any time.
const LIVE_SILENCE: Duration = Duration::from_secs(300);

/// A source that ffmpeg reads.
#[derive(Clone, Debug)]
pub struct Capture {
    /// As the user named it.
    name: String,
    /// What ffmpeg is told of its input.
    input: Vec<String>,
    silence: Duration,
    running: Arc<Mutex<Option<Watched>>>,
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
        Ok(Self::new(text, input))
    }

    /// `rtsp://...`
    pub fn address(text: &str) -> Self {
        // Over TCP: lost packets would be damaged frames.
        let tcp = if text.starts_with("rtsp") { &["-rtsp_transport", "tcp"][..] } else { &[] };
        let input = tcp.iter().chain(&["-i", text]).map(ToString::to_string).collect();
        Self::new(text, input)
    }

    fn new(text: &str, input: Vec<String>) -> Self {
        Self { name: text.to_owned(), input, silence: LIVE_SILENCE, running: Arc::default() }
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
        let Some(child) = self.lock().take() else { return Ok(()) };
        let ended = child.finish()?;
        if !more || (read.is_ok() && ended.is_some_and(|status| status.success())) {
            return Ok(());
        }
        if ended.is_none() {
            let seconds = self.silence.as_secs();
            bail!("{}: nothing came from ffmpeg for {seconds} s, and it was ended", self.name);
        }
        let said = std::fs::read_to_string(log.path()).unwrap_or_default();
        let own = read.err().map_or("nothing".into(), |error| error.to_string());
        bail!("{}: ffmpeg says: {}", self.name, said.lines().last().unwrap_or(&own))
    }

    fn start(&self, log: &tempfile::NamedTempFile) -> anyhow::Result<WatchedPipe<ChildStdout>> {
        let mut command = Command::new("ffmpeg");
        command
            .args(["-v", "error", "-nostdin", "-flags", "low_delay"])
            .args(&self.input)
            // Frames as they come: none doubled or left out to make an even rate.
            .args(["-map", "0:v:0"])
            .args(passthrough("ffmpeg", self.silence))
            .args(["-f", "image2pipe", "-c:v", "ppm", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log.reopen()?);
        let child = Watched::spawn(&mut command, self.silence).with_context(|| {
            format!("{} is read through ffmpeg, which was not found; install it (Debian: apt install ffmpeg)", self.name)
        })?;
        let out = child.output();
        *self.lock() = Some(child);
        out.context("ffmpeg has no output")
    }

    /// Stop ffmpeg, which may wait for a source that sends nothing.
    pub fn stop(&self) {
        if let Some(child) = &*self.lock() {
            child.stop();
        }
    }

    /// A poisoned lock only means that the other thread panicked.
    fn lock(&self) -> MutexGuard<'_, Option<Watched>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    struct Nobody;

    impl FrameTaker for Nobody {
        fn seen(&self) -> usize {
            0
        }
        fn name(&self) -> String {
            String::new()
        }
        fn made_at(&mut self, _: Option<std::time::SystemTime>) {}
        fn take(&mut self, _: Frame) -> bool {
            true
        }
        fn lose(&mut self, _: String, _: String) -> bool {
            true
        }
    }

    #[test]
    fn a_source_that_gives_nothing_is_named_and_its_ffmpeg_ended() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe").to_string_lossy().into_owned();
        let made =
            |program: &str, argument: &str| Command::new(program).arg(argument).output().is_ok();
        if !(made("ffmpeg", "-version") && made("mkfifo", &pipe)) {
            eprintln!("!! SKIPPED  no ffmpeg (Debian: apt install ffmpeg): silence is NOT tested");
            return;
        }
        // Nobody writes into it.
        let input = ["-f", "rawvideo", "-video_size", "16x16", "-i", &pipe].map(str::to_owned);
        let mut capture = Capture::new("v4l2:/dev/video9", input.into());
        capture.silence = Duration::from_secs(1);
        let error = capture.read(&mut Nobody).unwrap_err().to_string();
        assert!(error.contains("video9: nothing came from ffmpeg for 1 s"), "{error}");
    }
}
