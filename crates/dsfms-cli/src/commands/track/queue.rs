//! What lies between the thread that reads frames and the one that solves them.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often who waits for an item looks whether to stop.
const LOOK: Duration = Duration::from_millis(200);

/// What happens to a new item where there is no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Full {
    /// The giver waits.
    Wait,
    /// The oldest item gives way.
    DropOldest,
}

/// A queue of few items between two threads.
pub struct Queue<T> {
    state: Mutex<QueueState<T>>,
    changed: Condvar,
    room: usize,
    full: Full,
}

struct QueueState<T> {
    items: VecDeque<T>,
    /// Items that gave way since the last one was taken.
    dropped: usize,
    ended: bool,
}

impl<T> Queue<T> {
    pub fn new(room: usize, full: Full) -> Arc<Self> {
        let state = QueueState { items: VecDeque::with_capacity(room), dropped: 0, ended: false };
        Arc::new(Self { state: Mutex::new(state), changed: Condvar::new(), room, full })
    }

    /// A poisoned lock only means that the other thread panicked; the queue is whole.
    fn lock(&self) -> MutexGuard<'_, QueueState<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, QueueState<T>>) -> MutexGuard<'a, QueueState<T>> {
        self.changed.wait(state).unwrap_or_else(PoisonError::into_inner)
    }

    /// Give an item; `false` where nobody wants more.
    pub fn push(&self, item: T) -> bool {
        let mut state = self.lock();
        while self.full == Full::Wait && state.items.len() >= self.room && !state.ended {
            state = self.wait(state);
        }
        if state.ended {
            return false;
        }
        while state.items.len() >= self.room {
            state.items.pop_front();
            state.dropped += 1;
        }
        state.items.push_back(item);
        self.changed.notify_all();
        true
    }

    /// Give a last item, which waits behind the others however little room there is.
    pub fn push_last(&self, item: T) {
        self.lock().items.push_back(item);
        self.changed.notify_all();
    }

    /// The next item and how many gave way before it; `None` at the end.
    pub fn pop(&self) -> Option<(T, usize)> {
        self.pop_unless(|| false)
    }

    /// As [`Queue::pop`], but `None` soon after `stop` is true, too, though nothing comes.
    pub fn pop_unless(&self, stop: impl Fn() -> bool) -> Option<(T, usize)> {
        let mut state = self.lock();
        loop {
            if let Some(item) = state.items.pop_front() {
                let dropped = std::mem::take(&mut state.dropped);
                self.changed.notify_all();
                return Some((item, dropped));
            }
            if state.ended || stop() {
                return None;
            }
            let wait = self.changed.wait_timeout(state, LOOK);
            state = wait.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Whether nothing waits.
    #[cfg(test)]
    pub fn is_empty(&self) -> bool {
        self.lock().items.is_empty()
    }

    /// Nothing more will be given, or nothing more is wanted; what is in the queue can be taken
    /// still.
    pub fn end(&self) {
        self.lock().ended = true;
        self.changed.notify_all();
    }
}

/// Ends the queue when its thread is gone, however it went.
pub struct EndOnDrop<T>(pub Arc<Queue<T>>);

impl<T> Drop for EndOnDrop<T> {
    fn drop(&mut self) {
        self.0.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_waits_for_what_does_not_come_can_be_stopped() {
        let queue = Queue::<u8>::new(1, Full::Wait);
        assert_eq!(queue.pop_unless(|| true), None);
        queue.push(7);
        // What is there is not lost.
        assert_eq!(queue.pop_unless(|| true), Some((7, 0)));
    }

    #[test]
    fn the_newest_stays_where_there_is_no_room() {
        let queue = Queue::new(1, Full::DropOldest);
        assert!((0..4).all(|i| queue.push(i)));
        assert_eq!(queue.pop(), Some((3, 3)));
        queue.push(4);
        queue.end();
        assert!(!queue.push(5), "ended");
        assert_eq!((queue.pop(), queue.pop()), (Some((4, 0)), None));
    }

    #[test]
    fn a_giver_that_waits_loses_nothing() {
        let queue = Queue::new(2, Full::Wait);
        let giver = queue.clone();
        let thread = std::thread::spawn(move || {
            let _end = EndOnDrop(giver.clone());
            (0..100).all(|i| giver.push(i))
        });
        let taken: Vec<(i32, usize)> = std::iter::from_fn(|| queue.pop()).collect();
        assert!(thread.join().unwrap());
        assert_eq!(taken, (0..100).map(|i| (i, 0)).collect::<Vec<_>>());
    }
}
