//! `dsfms.Tracker`. The tracker borrows its template and its camera, so it lives on a thread that
//! owns both.

use crate::convert;
use crate::errors::{self, IntoPython, TrackingError};
use crate::reconstruct::{Sight, image, method_of};
use crate::surface::Surface;
use crate::template::Template;
use crate::video::{Shown, decoded};
use crate::work::receive;
use dsfms::image::{Frame, Mask};
use dsfms::pipeline::Method;
use dsfms::track::{TrackOptions, Tracked, Tracker as Inner};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};

/// A frame, its instrument mask, and where the answer goes.
type Push = (Frame, Option<Mask>, Sender<PyResult<Tracked>>);

/// Follows the organ through a video: one surface a frame, lost and found again.
///
/// Parameters
/// ----------
/// template : Template
///     With albedo and descriptors, that is, built from frames.
/// camera : Camera or path, optional
///     Camera of the video; default the template's own.
/// method : {"dsfm", "joint"}
///     Motion (eq. 3), or motion and shading in one problem.
/// realtime : bool
///     Coarser and about twice as fast.
/// options : str, optional
///     Weights and thresholds as TOML text, as the command line's ``--options``.
/// seed : int, optional
///     Seed of every random draw; default that of `options`, or 0.
///
/// Raises
/// ------
/// ValueError
///     An argument of the wrong kind or value.
/// TrackingError
///     A template without albedo or descriptors, or a method that does not track.
#[pyclass(module = "dsfms", frozen, name = "Tracker")]
pub struct Tracker {
    /// The template that is followed.
    #[pyo3(get)]
    template: Py<Template>,
    /// Camera of the video.
    #[pyo3(get)]
    camera: Py<crate::camera::Camera>,
    size: [usize; 2],
    frames: Mutex<(Sender<Push>, usize)>,
}

#[pymethods]
impl Tracker {
    #[new]
    #[pyo3(signature = (template, camera=None, *, method="joint", realtime=false, options=None, seed=None))]
    fn new(
        py: Python<'_>,
        template: &Bound<'_, Template>,
        camera: Option<&Bound<'_, PyAny>>,
        method: &str,
        realtime: bool,
        options: Option<&str>,
        seed: Option<u64>,
    ) -> PyResult<Self> {
        let method = method_of(method)?;
        let sight = Sight::new(py, template.get(), camera)?;
        let base = if realtime { TrackOptions::realtime() } else { TrackOptions::default() };
        let mut options = match options {
            Some(text) => errors::options(base.with_toml(text))?,
            None => base,
        };
        options.reconstruct.seed = seed.unwrap_or(options.reconstruct.seed);
        let (size, shown) = (sight.camera.file.camera.size, sight.shown.clone_ref(py));
        let (push, frames) = channel::<Push>();
        let (ready, made) = sync_channel(1);
        std::thread::Builder::new()
            .stack_size(8 << 20)
            .spawn(move || serve(&sight, method, options, &frames, &ready))?;
        receive(py, &Mutex::new(made))?
            .ok_or_else(|| PyRuntimeError::new_err("the tracker ended with an internal error"))??;
        let template = template.clone().unbind();
        Ok(Self { template, camera: shown, size, frames: Mutex::new((push, 0)) })
    }

    /// The next frame.
    ///
    /// Parameters
    /// ----------
    /// frame : array (h, w, 3) or path
    ///     uint8, uint16 or floats in [0, 1], RGB, of the camera's size.
    /// instrument_mask : array (h, w), optional
    ///     True (above 127) where an instrument covers the organ.
    ///
    /// Returns
    /// -------
    /// Surface
    ///     Its status is ok, degraded or lost.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     A frame or mask of the wrong kind, shape or size.
    #[pyo3(signature = (frame, instrument_mask=None))]
    fn push(
        &self,
        py: Python<'_>,
        frame: &Bound<'_, PyAny>,
        instrument_mask: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Surface> {
        let frame = image(frame, "frame", &format!("frame_{:03}", self.count()), self.size)?;
        let mask = instrument_mask
            .map(|value| convert::mask(value, "instrument_mask", self.size))
            .transpose()?;
        self.solve(py, frame, mask, None)
    }

    /// Iterate over a video (or a folder or list of images): one `Surface` a frame, solved as asked
    /// for while the next frames are decoded.
    ///
    /// Parameters
    /// ----------
    /// video : path, or iterable of arrays (h, w, 3)
    ///
    /// Raises
    /// ------
    /// FileError
    ///     While iterating: the video cannot be decoded.
    fn track(slf: Bound<'_, Self>, video: &Bound<'_, PyAny>) -> PyResult<Tracking> {
        if let Ok(path) = video.extract::<PathBuf>() {
            let frames = decoded(path, 0, usize::MAX);
            return Ok(Tracking { tracker: slf.unbind(), from: Origin::Video(Mutex::new(frames)) });
        }
        let from = Origin::Python(video.try_iter()?.unbind().into_any());
        Ok(Tracking { tracker: slf.unbind(), from })
    }
}

impl Tracker {
    fn count(&self) -> usize {
        self.frames.lock().map_or(0, |f| f.1)
    }

    fn solve(
        &self,
        py: Python<'_>,
        frame: Frame,
        mask: Option<Mask>,
        reservation: Option<String>,
    ) -> PyResult<Surface> {
        let name = frame.name.clone();
        let (answer, answered) = channel();
        {
            let gone = |_| PyRuntimeError::new_err("the tracker ended with an internal error");
            let mut frames = self.frames.lock().map_err(|_| PyRuntimeError::new_err("poisoned"))?;
            frames.0.send((frame, mask, answer)).map_err(gone)?;
            frames.1 += 1;
        }
        let mut tracked = receive(py, &Mutex::new(answered))?
            .ok_or_else(|| PyRuntimeError::new_err("the tracker ended with an internal error"))??;
        reservation.into_iter().for_each(|why| tracked.reserve(why));
        let (template, camera) = (self.template.clone_ref(py), self.camera.clone_ref(py));
        Ok(Surface::tracked(template, camera, name, tracked))
    }
}

/// The thread that owns template, camera and tracker.
fn serve(
    sight: &Sight,
    method: Method,
    options: TrackOptions,
    frames: &Receiver<Push>,
    ready: &SyncSender<PyResult<()>>,
) {
    let made = Inner::of_camera(&sight.template, &sight.camera, method, options);
    let mut tracker = match made {
        Ok(tracker) => tracker,
        Err(error) => {
            let _ = ready.send(Err(error.into_python()));
            return;
        }
    };
    let mut preparation = tracker.preparation();
    let _ = ready.send(Ok(()));
    while let Ok((frame, mask, answer)) = frames.recv() {
        // Nobody waits after Ctrl-C; the tracker has seen the frame all the same.
        let _ = match preparation.prepare(frame, mask.as_ref()) {
            Ok(prepared) => answer.send(Ok(tracker.solve(&prepared))),
            Err(error) => answer.send(Err(error.into_python())),
        };
    }
}

enum Origin {
    Video(Mutex<Receiver<PyResult<Shown>>>),
    Python(Py<PyAny>),
}

/// Iterator of `Tracker.track`.
#[pyclass(module = "dsfms", frozen, name = "Tracking")]
pub struct Tracking {
    tracker: Py<Tracker>,
    from: Origin,
}

#[pymethods]
impl Tracking {
    fn __iter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Surface>> {
        let tracker = self.tracker.get();
        match &self.from {
            Origin::Video(frames) => {
                let Some(shown) = receive(py, frames)? else { return Ok(None) };
                tracker.shown(py, shown?).map(Some)
            }
            Origin::Python(items) => match items.bind(py).try_iter()?.next() {
                Some(item) => tracker.push(py, &item?, None).map(Some),
                None => Ok(None),
            },
        }
    }
}

impl Tracker {
    /// A frame of a video; what cannot be decoded or has another size is lost, as on the command
    /// line.
    fn shown(&self, py: Python<'_>, shown: Shown) -> PyResult<Surface> {
        let Shown { name, content, .. } = shown;
        let (frame, reservation) = match content {
            Ok(content) => content,
            Err(reason) => return Ok(self.lost(py, name, reason)),
        };
        match self.solve(py, frame, None, reservation) {
            Err(error) if error.is_instance_of::<TrackingError>(py) => {
                Ok(self.lost(py, name, error.value(py).to_string()))
            }
            solved => solved,
        }
    }

    fn lost(&self, py: Python<'_>, name: String, reason: String) -> Surface {
        let (template, camera) = (self.template.clone_ref(py), self.camera.clone_ref(py));
        Surface::tracked(template, camera, name, Tracked::unread(reason))
    }
}
