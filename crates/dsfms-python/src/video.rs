//! `dsfms.Frames`: frames of a video or a folder as arrays, decoded on a thread of their own.

use crate::convert::array1;
use crate::errors::{IntoPython, wrong};
use crate::work::{receive, warn};
use dsfms::image::Frame;
use dsfms::pipeline::Silent;
use dsfms::pipeline::sources::{Purpose, predicted_from, rest_lost, sources};
use dsfms::video::{VideoFrame, each_frame, frame_name, is_video};
use numpy::{PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, sync_channel};

/// Frames that wait to be taken.
const WAITING: usize = 2;

/// A frame at its place, or its loss.
pub struct Shown {
    pub number: usize,
    pub name: String,
    /// The picture and a reservation about it, or why it is lost.
    pub content: Result<(Frame, Option<String>), String>,
}

/// Decode on another thread, which ends with the receiver.
pub fn decoded(path: PathBuf, start: usize, stop: usize) -> Receiver<PyResult<Shown>> {
    let (give, frames) = sync_channel(WAITING);
    std::thread::spawn(move || {
        let read = read(&path, start, stop, &mut |shown| give.send(Ok(shown)).is_ok());
        if let Err(error) = read {
            let _ = give.send(Err(error));
        }
    });
    frames
}

/// What cannot be decoded is lost under its own number, as on the command line.
fn read(
    path: &Path,
    start: usize,
    stop: usize,
    give: &mut dyn FnMut(Shown) -> bool,
) -> PyResult<()> {
    if path.is_file() && is_video(path) {
        return read_video(path, start, stop, give);
    }
    let list = sources(&[path.to_path_buf()], Purpose::Reconstruct, &Silent)
        .map_err(IntoPython::into_python)?;
    for (number, source) in list.iter().enumerate().take(stop).skip(start) {
        let content = match source.frame() {
            Ok(frame) => Ok((frame, source.reservation().map(str::to_owned))),
            Err(error) if path.is_file() => return Err(error.into_python()),
            Err(error) => Err(error.to_string()),
        };
        if !give(Shown { number, name: source.name(), content }) {
            break;
        }
    }
    Ok(())
}

fn read_video(
    path: &Path,
    start: usize,
    stop: usize,
    give: &mut dyn FnMut(Shown) -> bool,
) -> PyResult<()> {
    let mut next = 0;
    let read = each_frame(path, &mut |VideoFrame { number, content, rests_on, .. }| {
        if number >= stop {
            return false;
        }
        next = number + 1;
        let content = content.map(|frame| (frame, rests_on.map(predicted_from)));
        number < start || give(Shown { number, name: frame_name(number), content })
    });
    match read {
        Err(error) if next > 0 => {
            let number = next.max(start);
            let content = Err(rest_lost(&error));
            give(Shown { number, name: frame_name(number), content });
            Ok(())
        }
        read => read.map_err(IntoPython::into_python),
    }
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
///
/// A frame that cannot be decoded is left out with a `DsfmsWarning`; `number` counts it all the
/// same.
#[pyclass(module = "dsfms", frozen, name = "Frames")]
pub struct Frames {
    frames: Mutex<Receiver<PyResult<Shown>>>,
    number: Mutex<Option<usize>>,
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
        let frames = Mutex::new(decoded(video, start, stop));
        Ok(Self { frames, number: Mutex::new(None) })
    }

    /// Place in the video of the frame that was given last, from 0; None before the first.
    #[getter]
    fn number(&self) -> Option<usize> {
        self.number.lock().map_or(None, |number| *number)
    }

    fn __iter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray3<u8>>>> {
        while let Some(shown) = receive(py, &self.frames)? {
            let Shown { number, name, content } = shown?;
            match content {
                Ok((frame, reservation)) => {
                    if let Some(reason) = reservation {
                        warn(py, &format!("{name}: {reason}"))?;
                    }
                    if let Ok(mut last) = self.number.lock() {
                        *last = Some(number);
                    }
                    let [w, h] = frame.size;
                    return array1(py, frame.rgb.into_flattened()).reshape([h, w, 3]).map(Some);
                }
                Err(reason) => warn(py, &format!("{name} is lost: {reason}"))?,
            }
        }
        Ok(None)
    }
}

/// Number of frames of a video or of a folder of images, lost ones too; everything is decoded to
/// count them.
///
/// Raises
/// ------
/// FileError
///     Missing, or cannot be decoded.
#[pyfunction]
pub fn frame_count(py: Python<'_>, video: PathBuf) -> PyResult<usize> {
    crate::work::run(py, None, move |told| {
        let mut count = 0;
        read(&video, 0, usize::MAX, &mut |_| {
            count += 1;
            dsfms::pipeline::Progress::step(told, "video", count, count);
            true
        })?;
        Ok(count)
    })?
}
