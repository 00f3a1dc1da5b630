//! Frames from files, videos or standard input, read on a thread of their own so that the next is
//! ready when the last is solved.

use super::incoming::Stream;
use super::input::{FrameTaker, InputFormat};
use super::item::{Content, FrameItem, Ready};
use super::queue::{EndOnDrop, Full, Queue};
use super::record::{Recorder, Times, number_of};
use crate::exit::describe;
use crate::inputs::{predicted_from, rest_lost};
use crate::outputs::FrameMasks;
use anyhow::Context;
use dsfms::image::{Frame, Mask};
use dsfms::io::images::{decode_bytes, find_frames, read_frame};
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::track::{Preparation, Regions};
use dsfms::video::mjpeg::Pictures;
use dsfms::video::{VideoFrame, each_frame, frame_name, frame_rate, is_video};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

/// Frames that wait for the solver where none are dropped.
const WAITING: usize = 2;

/// Files or folders of masks.
#[derive(Clone, Default)]
pub struct MaskFiles {
    pub instrument: Option<PathBuf>,
    pub organ: Option<PathBuf>,
    pub valid: Option<PathBuf>,
}

/// Where frames come from.
#[derive(Clone)]
pub struct FrameSource {
    /// Files, folders and videos; nothing for standard input and streams.
    pub inputs: Vec<PathBuf>,
    /// What comes by network or from a device.
    pub stream: Option<Stream>,
    /// Keeps the frames that are taken.
    pub recorder: Option<Recorder>,
    pub format: InputFormat,
    /// Size of raw frames.
    pub size: [usize; 2],
    pub masks: MaskFiles,
    pub stride: usize,
    /// Drop what cannot be kept up with; files play at so many frames a second.
    pub realtime: bool,
    /// Files of a recording keep the numbers that they have by their names.
    pub numbered: bool,
}

/// The queue of a source, and what ended it.
pub struct Reading {
    queue: Arc<Queue<Result<FrameItem, anyhow::Error>>>,
    stream: Option<Stream>,
    /// The frame that was waited for.
    first: Option<(FrameItem, usize)>,
}

impl Reading {
    /// Wait until a frame is there; an error where none comes.
    pub fn with_first(mut self) -> anyhow::Result<Self> {
        self.first = self.next()?;
        match &self.first {
            Some(_) => Ok(self),
            None if crate::interrupt::asked() => {
                anyhow::bail!("stopped before the first frame; nothing is written")
            }
            None => anyhow::bail!("the input holds no frame"),
        }
    }

    /// The next frame and how many were dropped before it.
    pub fn next(&mut self) -> anyhow::Result<Option<(FrameItem, usize)>> {
        if let Some(first) = self.first.take() {
            return Ok(Some(first));
        }
        match self.queue.pop_unless(crate::interrupt::asked) {
            Some((Ok(item), dropped)) => Ok(Some((item, dropped))),
            Some((Err(error), _)) => Err(error),
            None => Ok(None),
        }
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        self.queue.end();
        if let Some(stream) = &self.stream {
            stream.stop();
        }
    }
}

impl FrameSource {
    /// Frames a second of the first input, where it is a video that says so.
    pub fn rate(&self) -> Option<f64> {
        let first = self.inputs.first()?;
        (first.is_file() && is_video(first)).then(|| frame_rate(first)).flatten()
    }

    /// A picture decoded: for a live source by the pool, whose second thread is awake while a frame
    /// is solved and would be in the way of a third.
    fn decoded<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        if self.realtime { rayon::scope(|_| work()) } else { work() }
    }

    /// Start to read and prepare. The thread is not waited for: it may be within a read that never
    /// returns.
    pub fn start(self, rate: f64, preparation: Preparation) -> Reading {
        let (room, full) =
            if self.realtime { (1, Full::DropOldest) } else { (WAITING, Full::Wait) };
        let queue = Queue::new(room, full);
        let (giver, stream) = (queue.clone(), self.stream.clone());
        std::thread::spawn(move || {
            let end = EndOnDrop(giver);
            let paced = self.realtime && !self.inputs.is_empty();
            let pace = paced.then(|| Duration::from_secs_f64(1.0 / rate));
            let (queue, start) = (&end.0, Instant::now());
            let (seen, time, due) = (0, None, None);
            let mut reader =
                Reader { source: &self, queue, preparation, pace, start, seen, time, due };
            if let Err(error) = reader.run() {
                // Behind the last frame, which must not give way to it.
                end.0.push_last(Err(error));
            }
        });
        Reading { queue, stream, first: None }
    }
}

/// The reading thread.
struct Reader<'a> {
    source: &'a FrameSource,
    queue: &'a Queue<Result<FrameItem, anyhow::Error>>,
    preparation: Preparation,
    /// Time of a frame, where files play at their own pace.
    pace: Option<Duration>,
    start: Instant,
    /// Frames read.
    seen: usize,
    /// When the next frame was made, where its source tells.
    time: Option<SystemTime>,
    /// When the next frame is to be given, where it is not by the pace.
    due: Option<Instant>,
}

impl Reader<'_> {
    fn run(&mut self) -> anyhow::Result<()> {
        if let Some(stream) = &self.source.stream {
            return stream.read(self);
        }
        if self.source.inputs.is_empty() {
            return match self.source.format {
                InputFormat::Raw => self.raw(),
                InputFormat::Mjpeg => self.mjpeg(),
            };
        }
        for input in &self.source.inputs {
            if input.is_file() && is_video(input) {
                self.video(input)?;
            } else {
                let paths = find_frames(std::slice::from_ref(input))?;
                let times = Times::of(input);
                for path in &paths {
                    self.as_recorded(path, &times);
                    if let Some(number) = number_of(path).filter(|_| self.source.numbered) {
                        self.seen = number;
                    }
                    let more = match self.source.decoded(|| read_frame(path)) {
                        Ok(frame) => self.give(frame, Some(path), Some(paths.len())),
                        Err(error) => {
                            let name = path.file_stem().unwrap_or_default().to_string_lossy();
                            self.lose(name.into_owned(), describe(&error.into()))
                        }
                    };
                    if !more {
                        return Ok(());
                    }
                }
            }
        }
        Ok(())
    }

    /// Give the next frame when it was recorded, and with that time.
    fn as_recorded(&mut self, path: &Path, times: &Times) {
        if let Some((time, since)) = times.get(path) {
            (self.time, self.due) = (Some(time), Some(self.start + since));
        }
    }

    fn video(&mut self, path: &Path) -> anyhow::Result<()> {
        let mut given = 0;
        let read = each_frame(path, &mut |VideoFrame { number, total, content, rests_on }| {
            given = number + 1;
            match content {
                Ok(frame) => {
                    let reservation = rests_on.map(predicted_from);
                    self.give_with(frame, None, total, reservation)
                }
                Err(reason) => self.lose(frame_name(number), reason),
            }
        });
        match read {
            Err(error) if given > 0 => {
                self.lose(frame_name(given), rest_lost(&error));
                Ok(())
            }
            read => Ok(read?),
        }
    }

    fn raw(&mut self) -> anyhow::Result<()> {
        let [w, h] = self.source.size;
        let mut input = std::io::stdin().lock();
        let mut bytes = vec![0; 3 * w * h];
        loop {
            let mut filled = 0;
            while filled < bytes.len() {
                match input.read(&mut bytes[filled..]) {
                    Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                    Err(error) => return Err(error).context("standard input"),
                    Ok(0) if filled == 0 => return Ok(()),
                    Ok(0) => {
                        let whole = bytes.len();
                        self.lose(self.name(), format!(
                            "standard input ends within a frame: {filled} of {whole} bytes; check --size"
                        ));
                        return Ok(());
                    }
                    Ok(n) => filled += n,
                }
            }
            let rgb = bytes.as_chunks::<3>().0.to_vec();
            if !self.give(Frame { name: self.name(), size: [w, h], rgb }, None, None) {
                return Ok(());
            }
        }
    }

    fn mjpeg(&mut self) -> anyhow::Result<()> {
        let mut pictures = Pictures::new(std::io::stdin().lock());
        let mut first = None;
        while let Some(picture) = pictures.next().context("standard input")? {
            let decoded = picture.and_then(|bytes| self.source.decoded(|| decode(&bytes)));
            let more = match decoded {
                Ok((size, rgb)) if *first.get_or_insert(size) == size => {
                    self.give(Frame { name: self.name(), size, rgb }, None, None)
                }
                Ok((size, _)) => {
                    let reason = format!("the picture is {size:?} px, those before {first:?}");
                    self.lose(self.name(), reason)
                }
                Err(reason) => self.lose(self.name(), reason),
            };
            if !more {
                return Ok(());
            }
        }
        Ok(())
    }

    /// When the frame at hand was made, or now.
    fn now(&mut self) -> SystemTime {
        self.time.take().unwrap_or_else(SystemTime::now)
    }

    /// Whether the next frame is one of those that are taken, at its time.
    fn taken(&mut self) -> Option<usize> {
        let number = self.seen;
        self.seen += 1;
        if let Some(pace) = self.pace {
            let due = self.due.take().unwrap_or_else(|| self.start + pace * number as u32);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        number.is_multiple_of(self.source.stride).then_some(number)
    }

    /// Hand a frame over; `false` where nobody wants more.
    fn give(&mut self, frame: Frame, path: Option<&Path>, total: Option<usize>) -> bool {
        self.give_with(frame, path, total, None)
    }

    fn give_with(
        &mut self,
        frame: Frame,
        path: Option<&Path>,
        total: Option<usize>,
        reservation: Option<String>,
    ) -> bool {
        let Some(number) = self.taken() else { return true };
        let (name, time, came) = (frame.name.clone(), self.now(), Instant::now());
        if let Some(recorder) = &self.source.recorder {
            recorder.add(number, time, &frame);
        }
        let item = self.item(number, (time, came), frame, path, total, reservation);
        // Of another size, or without its mask: this frame is lost, and no other.
        let lost = |error: anyhow::Error| FrameItem {
            number,
            time,
            came,
            total,
            warnings: Vec::new(),
            content: Content::Unreadable(name, describe(&error)),
        };
        self.queue.push(Ok(item.unwrap_or_else(lost)))
    }

    fn item(
        &mut self,
        number: usize,
        (time, came): (SystemTime, Instant),
        frame: Frame,
        path: Option<&Path>,
        total: Option<usize>,
        reservation: Option<String>,
    ) -> anyhow::Result<FrameItem> {
        let mut warnings = Vec::new();
        let MaskFiles { instrument, organ, valid } = &self.source.masks;
        let mut mask = |files: &Option<PathBuf>, kind| -> anyhow::Result<Option<Mask>> {
            let Some(files) = files else { return Ok(None) };
            let paths: Vec<PathBuf> = path.map(Path::to_path_buf).into_iter().collect();
            let (masks, said) = read_masks(std::slice::from_ref(&frame), &paths, files, kind)?;
            warnings.extend(said.iter().map(ToString::to_string));
            Ok(masks.into_iter().next())
        };
        let instrument = mask(instrument, MaskKind::Instrument)?;
        let organ = mask(organ, MaskKind::Organ)?;
        let valid = mask(valid, MaskKind::Valid)?;
        let regions = Regions {
            instrument: instrument.as_ref(),
            organ: organ.as_ref(),
            valid: valid.as_ref(),
        };
        let prepared = self.preparation.prepare(frame, regions)?;
        let masks = FrameMasks { instrument, organ };
        let ready = Ready { prepared, masks, reservation, answered: None };
        let content = Content::Frame(Box::new(ready));
        Ok(FrameItem { number, time, came, total, warnings, content })
    }
}

impl FrameTaker for Reader<'_> {
    fn seen(&self) -> usize {
        self.seen
    }

    fn name(&self) -> String {
        format!("frame_{:03}", self.seen)
    }

    fn made_at(&mut self, time: Option<SystemTime>) {
        self.time = time;
    }

    fn take(&mut self, frame: Frame) -> bool {
        self.give(frame, None, None)
    }

    fn lose(&mut self, name: String, reason: String) -> bool {
        let Some(number) = self.taken() else { return true };
        let content = Content::Unreadable(name, reason);
        let (time, came, warnings) = (self.now(), Instant::now(), Vec::new());
        self.queue.push(Ok(FrameItem { number, time, came, total: None, warnings, content }))
    }
}

/// Size and pixels of a JPEG picture.
fn decode(bytes: &[u8]) -> Result<([usize; 2], Vec<[u8; 3]>), String> {
    let picture = decode_bytes(bytes).map_err(|error| format!("damaged JPEG picture: {error}"))?;
    let rgb = picture.to_rgb8();
    let size = [rgb.width() as usize, rgb.height() as usize];
    Ok((size, rgb.pixels().map(|p| p.0).collect()))
}
