//! A program at the other end of a pipe, ended where it neither gives nor takes anything for too
//! long.

use std::io::{Read, Result, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long `ffmpeg` may be silent on a file: a disk wakes in ten seconds, the largest picture
/// takes a few.
pub const SILENCE: Duration = Duration::from_secs(60);

/// A running program. Its clones are of the same one; with the last of them, and of its pipes, it
/// ends.
#[derive(Clone, Debug)]
pub struct Watched(Arc<Watch>);

#[derive(Debug)]
struct Watch {
    child: Mutex<Child>,
    silence: Duration,
    /// Since when its pipe has been waited for; work between two reads is not its silence.
    waiting: Mutex<Option<Instant>>,
    silent: AtomicBool,
}

/// An end of a pipe of the program.
#[derive(Debug)]
pub struct WatchedPipe<P> {
    pipe: P,
    watch: Arc<Watch>,
}

impl Watched {
    /// Start a program that is ended where a read or a write waits longer than `silence`.
    ///
    /// # Errors
    /// A program that cannot be started.
    pub fn spawn(command: &mut Command, silence: Duration) -> Result<Self> {
        let watch = Arc::new(Watch {
            child: Mutex::new(command.spawn()?),
            silence,
            waiting: Mutex::new(None),
            silent: AtomicBool::new(false),
        });
        let (seen, pause) = (Arc::downgrade(&watch), (silence / 20).min(Duration::from_secs(1)));
        std::thread::spawn(move || {
            while let Some(watch) = seen.upgrade() {
                if watch.waits_too_long() {
                    return watch.end_silent();
                }
                drop(watch);
                std::thread::sleep(pause);
            }
        });
        Ok(Self(watch))
    }

    /// Its standard output, once, where that is a pipe.
    pub fn output(&self) -> Option<WatchedPipe<ChildStdout>> {
        let pipe = lock(&self.0.child).stdout.take()?;
        Some(WatchedPipe { pipe, watch: self.0.clone() })
    }

    /// Its standard input, once, where that is a pipe.
    pub fn input(&self) -> Option<WatchedPipe<ChildStdin>> {
        let pipe = lock(&self.0.child).stdin.take()?;
        Some(WatchedPipe { pipe, watch: self.0.clone() })
    }

    /// End it.
    pub fn stop(&self) {
        self.0.kill();
    }

    /// Wait for its end, at most as long as it may be silent; `None` where it was ended for its
    /// silence.
    ///
    /// # Errors
    /// Those of the system.
    pub fn finish(&self) -> Result<Option<ExitStatus>> {
        let start = Instant::now();
        loop {
            let ended = lock(&self.0.child).try_wait()?;
            if let Some(status) = ended {
                return Ok((!self.0.silent.load(Ordering::Relaxed)).then_some(status));
            }
            if start.elapsed() > self.0.silence {
                self.0.end_silent();
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Watch {
    fn waits_too_long(&self) -> bool {
        lock(&self.waiting).is_some_and(|since| since.elapsed() > self.silence)
    }

    fn end_silent(&self) {
        self.silent.store(true, Ordering::Relaxed);
        self.kill();
    }

    fn kill(&self) {
        // It may have ended.
        let _ = lock(&self.child).kill();
    }

    /// Do what may wait for the program.
    fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        *lock(&self.waiting) = Some(Instant::now());
        let done = work();
        *lock(&self.waiting) = None;
        done
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.kill();
        // Else it stays in the system's table.
        let _ = lock(&self.child).wait();
    }
}

impl<P: Read> Read for WatchedPipe<P> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        self.watch.during(|| self.pipe.read(buffer))
    }
}

impl<P: Write> Write for WatchedPipe<P> {
    fn write(&mut self, buffer: &[u8]) -> Result<usize> {
        self.watch.during(|| self.pipe.write(buffer))
    }

    fn flush(&mut self) -> Result<()> {
        self.watch.during(|| self.pipe.flush())
    }
}

/// A poisoned lock only means that another thread panicked.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::process::Stdio;

    const SHORT: Duration = Duration::from_millis(400);

    fn started(script: &str) -> Watched {
        let mut shell = Command::new("sh");
        shell.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped());
        Watched::spawn(&mut shell, SHORT).unwrap()
    }

    fn read(program: &Watched) -> String {
        let mut text = String::new();
        program.output().unwrap().read_to_string(&mut text).unwrap();
        text
    }

    #[test]
    fn what_gives_and_takes_nothing_is_ended() {
        let start = Instant::now();
        let program = started("echo one; exec sleep 100");
        assert_eq!((read(&program).as_str(), program.finish().unwrap()), ("one\n", None));
        // It closes its output and stays.
        let program = started("exec >&-; exec sleep 100");
        assert_eq!((read(&program).as_str(), program.finish().unwrap()), ("", None));
        // It does not read.
        let program = started("exec sleep 100");
        let mut input = program.input().unwrap();
        assert!(input.write_all(&vec![0; 1 << 20]).is_err());
        assert_eq!(program.finish().unwrap(), None);
        assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    }

    #[test]
    fn who_is_slow_to_read_is_no_silence() {
        let program = started("echo one; echo two; exit 3");
        let mut output = program.output().unwrap();
        let mut first = [0; 4];
        output.read_exact(&mut first).unwrap();
        std::thread::sleep(2 * SHORT);
        let mut rest = String::new();
        output.read_to_string(&mut rest).unwrap();
        assert_eq!((&first, rest.as_str()), (b"one\n", "two\n"));
        assert_eq!(program.finish().unwrap().unwrap().code(), Some(3));
    }
}
