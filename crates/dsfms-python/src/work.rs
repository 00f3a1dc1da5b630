//! Long calls: on a thread of their own, without the GIL, stopped by Ctrl-C.

use crate::errors::DsfmsWarning;
use dsfms::pipeline::Progress;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Signals are looked at this often.
const LOOK: Duration = Duration::from_millis(50);
/// As the main thread of a program has.
const STACK: usize = 8 << 20;

/// What unwinds a stage that is not wanted any more. No message is printed for it.
struct Stopped;

enum Event<T> {
    Step(String, usize, usize),
    Warning(String),
    /// `None`: the work panicked.
    Done(Option<T>),
}

/// Tells the waiting thread how far the work is, and unwinds the work once nobody waits.
pub struct Told<T> {
    events: Sender<Event<T>>,
    stop: Arc<AtomicBool>,
}

impl<T: Send> Progress for Told<T> {
    fn step(&self, stage: &str, done: usize, total: usize) {
        if self.stop.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Stopped));
        }
        // Nobody listens any more: the next step unwinds.
        let _ = self.events.send(Event::Step(stage.to_owned(), done, total));
    }

    fn warn(&self, message: &str) {
        let _ = self.events.send(Event::Warning(message.to_owned()));
    }
}

/// Do `work` on another thread while Python goes on; `progress(stage, done, total)` is called on
/// the calling thread. Where the callback or a signal raises, the work is abandoned: it unwinds at
/// its next step.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Told<T>) -> T + Send + 'static,
) -> PyResult<T> {
    let (events, received) = channel();
    let stop = Arc::new(AtomicBool::new(false));
    let told = Told { events, stop: stop.clone() };
    let body = move || {
        let result = catch_unwind(AssertUnwindSafe(|| work(&told))).ok();
        let _ = told.events.send(Event::Done(result));
    };
    std::thread::Builder::new().stack_size(STACK).spawn(body)?;
    let result = wait(py, progress, &Mutex::new(received));
    stop.store(true, Ordering::Relaxed);
    result
}

fn wait<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    events: &Mutex<Receiver<Event<T>>>,
) -> PyResult<T> {
    loop {
        let next = py.detach(|| match events.lock() {
            Ok(events) => events.recv_timeout(LOOK),
            Err(_) => Err(RecvTimeoutError::Disconnected),
        });
        match next {
            Ok(Event::Done(Some(value))) => return Ok(value),
            Ok(Event::Done(None)) | Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("dsfms: internal error (see standard error)"));
            }
            Ok(Event::Step(stage, done, total)) => {
                if let Some(callback) = progress {
                    callback.call1((stage, done, total))?;
                }
            }
            Ok(Event::Warning(message)) => warn(py, &message)?,
            Err(RecvTimeoutError::Timeout) => {}
        }
        py.check_signals()?;
    }
}

/// The next value, with the GIL released and signals looked at; `None` at the end.
pub fn receive<T: Send>(py: Python<'_>, values: &Mutex<Receiver<T>>) -> PyResult<Option<T>> {
    loop {
        let next = py.detach(|| match values.lock() {
            Ok(values) => values.recv_timeout(LOOK),
            Err(_) => Err(RecvTimeoutError::Disconnected),
        });
        py.check_signals()?;
        match next {
            Ok(value) => return Ok(Some(value)),
            Err(RecvTimeoutError::Disconnected) => return Ok(None),
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

/// A Python warning.
pub fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    let category = py.get_type::<DsfmsWarning>();
    py.import("warnings")?.call_method1("warn", (message, category, 2))?;
    Ok(())
}
