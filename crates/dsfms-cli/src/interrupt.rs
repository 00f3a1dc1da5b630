//! Ctrl-C and SIGTERM: what is being written is finished, the user is told what is kept and how to
//! go on. A second signal ends the program at once.

use crate::progress::Teller;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Mutex, PoisonError};

/// What is told where nothing else was said.
const USUAL: &str = "files that were finished are whole; the same command begins anew";

static ADVICE: Mutex<Option<String>> = Mutex::new(None);
/// Whether the command looks at [`asked`] itself.
static SOFT: AtomicBool = AtomicBool::new(false);
static SIGNAL: AtomicI32 = AtomicI32::new(0);

/// What is kept if the program is stopped from here on, and how to go on.
pub fn advise(text: impl Into<String>) {
    *ADVICE.lock().unwrap_or_else(PoisonError::into_inner) = Some(text.into());
}

/// From here on the command ends by itself, soon after [`asked`] is true.
pub fn end_softly() {
    SOFT.store(true, Ordering::SeqCst);
}

/// Whether the user wants the command to end.
pub fn asked() -> bool {
    SIGNAL.load(Ordering::SeqCst) != 0
}

/// The exit code of a program that was stopped by a signal.
pub fn code() -> Option<ExitCode> {
    let signal = SIGNAL.load(Ordering::SeqCst);
    (signal != 0).then(|| ExitCode::from(number(signal) as u8))
}

fn number(signal: i32) -> i32 {
    128 + signal
}

#[cfg(unix)]
fn advice() -> String {
    let advice = ADVICE.lock().unwrap_or_else(PoisonError::into_inner);
    format!("stopped; {}", advice.as_deref().unwrap_or(USUAL))
}

/// Watch for signals, on a thread of its own.
#[cfg(unix)]
pub fn watch(teller: Teller) {
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::{flag, iterator::Signals};
    use std::sync::Arc;
    let again = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first signal finds the flag unset, the second set.
        let _ = flag::register_conditional_shutdown(signal, number(signal), again.clone());
        let _ = flag::register(signal, again.clone());
    }
    let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) else { return };
    // Without the thread the second signal still ends the program.
    let _ = std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in &mut signals {
            SIGNAL.store(signal, Ordering::SeqCst);
            if SOFT.load(Ordering::SeqCst) {
                teller.tell("stopping after the frame in work; Ctrl-C once more stops at once");
            } else {
                end(&teller, signal);
            }
        }
    });
}

/// A command that can be stopped anywhere is.
#[cfg(unix)]
fn end(teller: &Teller, signal: i32) -> ! {
    /// A file that takes longer is left as what it is, under a name that says so.
    const LIMIT: std::time::Duration = std::time::Duration::from_secs(10);
    dsfms::io::atomic::finish_writing(LIMIT);
    teller.tell(&advice());
    std::process::exit(number(signal))
}

/// Elsewhere the system ends the program.
#[cfg(not(unix))]
pub fn watch(_teller: Teller) {}
