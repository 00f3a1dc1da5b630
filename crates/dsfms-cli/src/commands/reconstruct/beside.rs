//! Frames are decoded beside the work on them.

use crate::inputs::{Source, each_source};
use crate::interrupt;
use rayon::prelude::*;
use std::sync::mpsc::sync_channel;
use std::thread;

/// Decoded frames that wait. The work on one takes many times as long as decoding it.
const WAITING: usize = 2;

/// The results of `work` on the sources, by their place, in order; those that were not begun when
/// the user asked for an end are left out.
pub fn each_beside<T: Send>(
    sources: &[Source],
    work: impl Fn(usize, &Source) -> T + Sync,
) -> Vec<(usize, T)> {
    let (give, waiting) = sync_channel(WAITING);
    let mut done: Vec<(usize, T)> = thread::scope(|scope| {
        scope.spawn(move || {
            each_source(sources, &mut |i, source| {
                !interrupt::asked() && give.send((i, source)).is_ok()
            });
        });
        let begun = waiting.into_iter().par_bridge().filter(|_| !interrupt::asked());
        begun.map(|(i, source)| (i, work(i, &source))).collect()
    });
    done.sort_by_key(|&(i, _)| i);
    done
}
