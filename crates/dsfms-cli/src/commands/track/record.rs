//! What was seen while tracking: every frame that was taken, lossless, with its time.
//!
//! A folder of `frame_NNNNNN.png` (the number in the source) and `times.csv` (`file,unix_s`). It is
//! input for every command, and `track --realtime` plays it at its times.

use super::queue::{Full, Queue};
use crate::exit::Usage;
use crate::outputs::check_folder;
use anyhow::Context;
use dsfms::image::Frame;
use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Frames that wait to be written at most.
const WAITING: usize = 8;

/// Times of the frames.
const TIMES: &str = "times.csv";

struct Entry {
    number: usize,
    time: SystemTime,
    frame: Frame,
}

/// Writes frames on a thread of its own.
pub struct Recording {
    queue: Arc<Queue<Entry>>,
    left_out: Arc<AtomicUsize>,
    writer: JoinHandle<anyhow::Result<usize>>,
}

/// Where the source gives its frames.
#[derive(Clone)]
pub struct Recorder(Arc<Queue<Entry>>);

impl Recorder {
    pub fn add(&self, number: usize, time: SystemTime, frame: &Frame) {
        // After a failure nobody takes it; what failed is said at the end.
        self.0.push(Entry { number, time, frame: frame.clone() });
    }
}

impl Recording {
    /// Record into a folder that is new or empty. With `realtime` what the disk cannot keep up with
    /// is left out, else the source waits.
    pub fn start(folder: &Path, realtime: bool) -> anyhow::Result<Self> {
        let named = || format!("--record {}", folder.display());
        check_folder(folder).with_context(named)?;
        if folder.exists() && std::fs::read_dir(folder).with_context(named)?.next().is_some() {
            let text = format!("--record {}: the folder is not empty", folder.display());
            return Err(Usage(text).into());
        }
        let queue = Queue::new(WAITING, if realtime { Full::DropOldest } else { Full::Wait });
        let left_out = Arc::<AtomicUsize>::default();
        let (taker, lost, folder) = (queue.clone(), left_out.clone(), folder.to_owned());
        let writer = std::thread::spawn(move || {
            let end = super::queue::EndOnDrop(taker);
            let ends = || format!("the recording in {} ends", folder.display());
            let (mut count, mut times) = (0, None);
            while let Some((entry, dropped)) = end.0.pop() {
                lost.fetch_add(dropped, Ordering::Relaxed);
                let times = match &mut times {
                    Some(times) => times,
                    none => none.insert(begin(&folder).with_context(ends)?),
                };
                write(&folder, &entry, times).with_context(ends)?;
                count += 1;
            }
            Ok(count)
        });
        Ok(Self { queue, left_out, writer })
    }

    pub fn recorder(&self) -> Recorder {
        Recorder(self.queue.clone())
    }

    /// Write what waits; how many frames were written and left out.
    pub fn finish(self) -> anyhow::Result<[usize; 2]> {
        self.queue.end();
        let written =
            self.writer.join().map_err(|_| anyhow::anyhow!("the recording stopped"))??;
        Ok([written, self.left_out.load(Ordering::Relaxed)])
    }
}

/// The folder and its list of times, made with the first frame: without one nothing is left.
fn begin(folder: &Path) -> anyhow::Result<BufWriter<File>> {
    std::fs::create_dir_all(folder)?;
    let mut times = BufWriter::new(File::create(folder.join(TIMES))?);
    writeln!(times, "file,unix_s")?;
    Ok(times)
}

fn write(folder: &Path, entry: &Entry, times: &mut impl Write) -> anyhow::Result<()> {
    let name = format!("frame_{:06}.png", entry.number);
    // Not flushed to disk: a live source does not wait for that.
    let partial = folder.join(format!(".partial-{}-frame", std::process::id()));
    let done = write_picture(&partial, &entry.frame)
        .and_then(|()| Ok(std::fs::rename(&partial, folder.join(&name))?));
    if done.is_err() {
        let _ = std::fs::remove_file(&partial);
    }
    done?;
    // A line only of what is whole; out at once, so that a run that is killed leaves its times.
    let since = entry.time.duration_since(UNIX_EPOCH).unwrap_or_default();
    writeln!(times, "{name},{}.{:09}", since.as_secs(), since.subsec_nanos())?;
    Ok(times.flush()?)
}

fn write_picture(path: &Path, frame: &Frame) -> anyhow::Result<()> {
    let [w, h] = frame.size.map(|n| n as u32);
    let mut out = BufWriter::new(File::create(path)?);
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Up).write_image(
        frame.rgb.as_flattened(),
        w,
        h,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(out.flush()?)
}

/// The number in the source of a frame of a recording.
pub fn number_of(path: &Path) -> Option<usize> {
    let digits = path.file_name()?.to_str()?.strip_prefix("frame_")?.strip_suffix(".png")?;
    (digits.len() >= 6).then(|| digits.parse().ok())?
}

/// When the files of a recording were seen.
#[derive(Default)]
pub struct Times {
    first: Option<SystemTime>,
    at: HashMap<PathBuf, SystemTime>,
}

impl Times {
    /// Of a folder; of one that is no recording none.
    pub fn of(folder: &Path) -> Self {
        let text = dsfms::guard::read_text(&folder.join(TIMES)).unwrap_or_default();
        let mut lines = text.lines();
        if lines.next() != Some("file,unix_s") {
            return Self::default();
        }
        let entry = |line: &str| -> Option<(PathBuf, SystemTime)> {
            let (file, time) = line.split_once(',')?;
            let (seconds, nanoseconds) = time.split_once('.')?;
            let nanoseconds = (nanoseconds.len() == 9).then(|| nanoseconds.parse().ok())??;
            let seconds = Duration::from_secs(seconds.parse().ok()?);
            let since = seconds.checked_add(Duration::from_nanos(nanoseconds))?;
            Some((folder.join(file), UNIX_EPOCH.checked_add(since)?))
        };
        let at: HashMap<_, _> = lines.filter_map(entry).collect();
        Self { first: at.values().min().copied(), at }
    }

    /// When a file was seen, and how long after the first.
    pub fn get(&self, path: &Path) -> Option<(SystemTime, Duration)> {
        let time = *self.at.get(path)?;
        Some((time, time.duration_since(self.first?).ok()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_and_times_come_back_and_a_full_folder_is_refused() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("new");
        let recording = Recording::start(&folder, false).unwrap();
        let frame = |k: usize| Frame {
            name: "any".into(),
            size: [5, 3],
            rgb: (0..15).map(|i| [i as u8, k as u8, 200]).collect(),
        };
        let time = |k: usize| UNIX_EPOCH + Duration::new(1_700_000_000 + k as u64, 7 + k as u32);
        for k in 0..20 {
            recording.recorder().add(3 * k, time(k), &frame(k));
        }
        assert_eq!(recording.finish().unwrap(), [20, 0]);
        let times = Times::of(&folder);
        for k in 0..20 {
            let path = folder.join(format!("frame_{:06}.png", 3 * k));
            let after = Duration::new(k as u64, k as u32);
            assert_eq!(times.get(&path), Some((time(k), after)));
            assert_eq!(dsfms::io::images::read_frame(&path).unwrap().rgb, frame(k).rgb);
            assert_eq!(number_of(&path), Some(3 * k));
        }
        let error = Recording::start(&folder, false).err().unwrap().to_string();
        assert!(error.contains("not empty"), "{error}");
        let of = |text: &str| {
            std::fs::write(parent.path().join(TIMES), text).unwrap();
            Times::of(parent.path()).at.len()
        };
        assert_eq!(of("file,unix_s\na.png,yesterday\nb.png,12.000000001\nc.png,1.5\n"), 1);
        assert_eq!((of("name,time\na.png,1.000000000\n"), of("")), (0, 0));
    }

    #[test]
    fn a_disk_that_fails_is_told_at_the_end_and_stops_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let recording = Recording::start(folder.path(), false).unwrap();
        std::fs::create_dir(folder.path().join("frame_000001.png")).unwrap();
        let frame = Frame { name: String::new(), size: [1, 1], rgb: vec![[0; 3]] };
        for k in 0..50 {
            recording.recorder().add(k, UNIX_EPOCH, &frame);
        }
        let error = format!("{:#}", recording.finish().unwrap_err());
        assert!(error.contains("the recording in"), "{error}");
    }
}
