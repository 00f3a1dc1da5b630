//! A second thread that does not fall asleep while a frame is solved.

use rayon::Yield;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Looks for work this often before the next look at whether all is done.
const LOOKS: usize = 16;

/// A helper that finds nothing to do for so long lets go. It may have been called while it waits in
/// a part of the very work: that part ends only after it, and the work only after that part. What
/// one thread alone works on longest, the pose, takes 0.8 ms in the median and 2 at 99 %
/// (`docs/performance.md`).
const PATIENCE: Duration = Duration::from_millis(2);

/// Run on the pool with one more thread of it kept looking for parts of the work.
///
/// A frame is hundreds of parallel loops of a tenth of a millisecond to a few; a thread that sleeps
/// between them wakes (most of all on a virtual machine) when they are over.
pub(super) fn busy_wait<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let done = AtomicBool::new(false);
    // On a thread of the pool its many small parallel loops cost no hand-over.
    rayon::scope(|scope| {
        let own = rayon::current_thread_index().unwrap_or(0);
        let helper = (own + 1) % rayon::current_num_threads();
        if helper != own {
            let done = &done;
            scope.spawn_broadcast(move |_, context| {
                if context.index() == helper {
                    help_until(done);
                }
            });
        }
        let _end = Ends(&done);
        work()
    })
}

/// Also where the work panics.
struct Ends<'a>(&'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

fn help_until(done: &AtomicBool) {
    let mut worked = Instant::now();
    while !done.load(Ordering::Acquire) && worked.elapsed() < PATIENCE {
        for _ in 0..LOOKS {
            if rayon::yield_now() == Some(Yield::Executed) {
                worked = Instant::now();
            } else {
                std::hint::spin_loop();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn a_helper_within_the_work_lets_go_of_it() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        // The work ends after the helper, which would end after the work.
        pool.install(|| {
            let done = AtomicBool::new(false);
            rayon::join(|| (), || help_until(&done));
            done.store(true, Ordering::Release);
        });
    }

    #[test]
    fn work_ends_with_its_value_on_any_number_of_threads_and_with_its_panic() {
        for threads in 1..4 {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let sum = || (0..1000).into_par_iter().map(|i| i * i).sum::<u64>();
            // From outside of the pool, and from within it.
            let outside = pool.install(|| busy_wait(|| (sum(), rayon::join(sum, sum))));
            assert_eq!(outside, (332_833_500, (332_833_500, 332_833_500)));
            let fails = || pool.install(|| busy_wait(|| -> u64 { panic!("as it should") }));
            assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(fails)).is_err());
        }
    }
}
