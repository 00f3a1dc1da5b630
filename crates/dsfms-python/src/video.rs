//! `dsfms.Frames`: frames of a video or a folder as arrays, decoded on a thread of their own.

use crate::convert::array1;
use crate::errors::{IntoPython, wrong};
use crate::work::receive;
use dsfms::image::Frame;
use dsfms::pipeline::Silent;
use dsfms::pipeline::inputs::{Purpose, Source, sources};
use dsfms::video::{each_frame, is_video};
use numpy::{PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// Frames that wait to be taken.
const WAITING: usize = 2;

/// What stops a decoder that nobody listens to.
struct Enough;

/// Decode on another thread, which ends with the receiver.
pub fn decoded(path: PathBuf, start: usize, stop: usize) -> Receiver<PyResult<Frame>> {
    let (give, frames) = sync_channel(WAITING);
    std::thread::spawn(move || {
        // A decoder cannot be told to stop; it is unwound.
        let result = catch_unwind(AssertUnwindSafe(|| read(&path, start, stop, &give)));
        if let Ok(Err(error)) = result {
            let _ = give.send(Err(error));
        }
    });
    frames
}

fn read(
    path: &Path,
    start: usize,
    stop: usize,
    give: &SyncSender<PyResult<Frame>>,
) -> PyResult<()> {
    let mut number = 0;
    let mut take = |frame: Frame| {
        let wanted = number >= start;
        if number >= stop || (wanted && give.send(Ok(frame)).is_err()) {
            resume_unwind(Box::new(Enough));
        }
        number += 1;
    };
    if path.is_file() && is_video(path) {
        return each_frame(path, &mut |frame, _| take(frame)).map_err(IntoPython::into_python);
    }
    let list = sources(&[path.to_path_buf()], Purpose::Reconstruct, &Silent)
        .map_err(IntoPython::into_python)?;
    for source in list.iter().take(stop).skip(start).map(Source::frame) {
        if give.send(source.map_err(IntoPython::into_python)).is_err() {
            break;
        }
    }
    Ok(())
}

/// Iterate over the frames of a video or of a folder of images, uint8 (h, w, 3), RGB.
///
/// Parameters
/// ----------
/// video : path
///     mp4 (H.264), whatever an installed ffmpeg reads, or a folder of images in name order.
/// start, stop : int
///     First frame, and the one after the last; default all.
///
/// Raises
/// ------
/// FileError
///     While iterating: the video is missing or cannot be decoded.
#[pyclass(module = "dsfms", frozen, name = "Frames")]
pub struct Frames {
    frames: Mutex<Receiver<PyResult<Frame>>>,
}

#[pymethods]
impl Frames {
    #[new]
    #[pyo3(signature = (video, start=0, stop=None))]
    fn new(video: PathBuf, start: usize, stop: Option<usize>) -> PyResult<Self> {
        let stop = stop.unwrap_or(usize::MAX);
        if stop < start {
            return Err(wrong("stop", format!("at least start ({start})"), stop.to_string()));
        }
        Ok(Self { frames: Mutex::new(decoded(video, start, stop)) })
    }

    fn __iter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        let Some(frame) = receive(py, &self.frames)? else { return Ok(None) };
        let frame = frame?;
        let [w, h] = frame.size;
        array1(py, frame.rgb.into_flattened()).reshape([h, w, 3]).map(Some)
    }
}

/// Number of frames of a video or of a folder of images; a video is decoded to count them.
///
/// Raises
/// ------
/// FileError
///     Missing, or cannot be decoded.
#[pyfunction]
pub fn frame_count(py: Python<'_>, video: PathBuf) -> PyResult<usize> {
    crate::work::run(py, None, move |told| {
        if video.is_file() && is_video(&video) {
            let mut count = 0;
            each_frame(&video, &mut |_, total| {
                count += 1;
                dsfms::pipeline::Progress::step(told, "video", count, total.unwrap_or(count));
            })
            .map_err(IntoPython::into_python)?;
            return Ok(count);
        }
        let list = sources(&[video], Purpose::Reconstruct, &Silent);
        list.map(|l| l.len()).map_err(IntoPython::into_python)
    })?
}
