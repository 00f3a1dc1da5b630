//! What goes between the thread that follows frames and the one that searches some of them.

use super::TrackStatus;
use super::candidate::{Candidate, Last};
use super::exposed::Exposed;
use super::prepare::View;
use super::recent::UsualResidual;
use crate::image::Frame;
use crate::verdict::NoSurface;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::mpsc::{Receiver, Sender, TryRecvError};
use std::sync::{Arc, Mutex, PoisonError};

/// A frame to search, and what is known before it.
pub(super) struct Question {
    pub(super) frame: Frame,
    pub(super) view: View,
    pub(super) known: KnownBefore,
    /// Nothing is followed meanwhile.
    pub(super) alone: bool,
    /// How far the search goes.
    pub(super) effort: Effort,
}

/// How far a search goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// All features and starts, the better surface.
    Full,
    /// The strongest features, the first surface that is good.
    Hasty,
}

/// What a search builds on.
pub(super) struct KnownBefore {
    /// The frame's number.
    pub(super) count: usize,
    pub(super) last: Option<Last>,
    pub(super) usual: UsualResidual,
    pub(super) exposed: Exposed,
}

/// What following a frame leaves to a search.
pub(super) struct Need {
    /// The frame is to be searched.
    pub(super) search: bool,
    /// The followed surface stays, whatever is found.
    pub(super) held: bool,
    /// What is to be said of it; lost where there is none.
    pub(super) level: TrackStatus,
}

/// What a search found in its frame.
pub(super) struct Answer {
    pub(super) outcome: Result<(Candidate, Last), NoSurface>,
    pub(super) other_camera: Option<(f64, [f64; 2])>,
}

/// The tracker's end.
pub(super) struct Beside {
    ask: Sender<Question>,
    /// Locked by nobody: threads that follow places share the tracker.
    answers: Mutex<Receiver<Answer>>,
    /// A question is out.
    pub(super) pending: bool,
    /// Nothing is followed until its answer is there.
    alone: bool,
    /// Of the question that is out.
    effort: Effort,
    /// The last search alone was hasty, and found nothing.
    in_vain: bool,
    /// The threads that the search leaves for the frames.
    pool: Option<Arc<ThreadPool>>,
    /// Whether the answer is taken in this frame, as in an earlier run; `None`: when it is there.
    pub(super) as_before: Option<bool>,
}

/// Nobody searches any more.
pub(super) struct Gone;

/// Threads apart from those of the whole program.
pub(super) fn pool(threads: usize) -> Option<ThreadPool> {
    ThreadPoolBuilder::new().num_threads(threads).build().ok()
}

impl Beside {
    pub(super) fn new(ask: Sender<Question>, answers: Receiver<Answer>) -> Self {
        let left = rayon::current_num_threads().saturating_sub(1).max(1);
        Self {
            ask,
            answers: Mutex::new(answers),
            pending: false,
            alone: false,
            effort: Effort::Full,
            in_vain: false,
            pool: pool(left).map(Arc::new),
            as_before: None,
        }
    }

    /// All threads search: a frame would only delay the answer.
    pub(super) fn all_search(&self) -> bool {
        self.pending && self.alone
    }

    /// Where frames are solved while another is searched.
    pub(super) fn pool(&self) -> Option<Arc<ThreadPool>> {
        self.pool.clone().filter(|_| self.pending && !self.alone)
    }

    fn answers(&mut self) -> &mut Receiver<Answer> {
        self.answers.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait(&mut self) -> Result<Answer, Gone> {
        self.answers().recv().map_err(|_| Gone)
    }

    /// Ask about a frame.
    pub(super) fn ask(&mut self, question: Question) -> Result<(), Gone> {
        let (alone, effort) = (question.alone, question.effort);
        self.ask.send(question).map_err(|_| Gone)?;
        (self.pending, self.alone, self.effort) = (true, alone, effort);
        Ok(())
    }

    /// How far the next search is to go. Where nothing is followed the soonest surface is the best
    /// one, as the frames after it improve it; what a hasty search does not find a full one may.
    pub(super) fn next_effort(&self, alone: bool) -> Effort {
        if alone && !self.in_vain { Effort::Hasty } else { Effort::Full }
    }

    /// The answer is there, and may hold a surface of its frame; whether that can be followed into
    /// the frame at hand is another matter, and the sooner the next answer comes, the better.
    fn answered(&mut self, surface: bool) {
        self.pending = false;
        if self.alone {
            self.in_vain = self.effort == Effort::Hasty && !surface;
        }
    }

    /// The answer, where it is there.
    pub(super) fn answer(&mut self) -> Result<Option<Answer>, Gone> {
        if !self.pending || self.as_before == Some(false) {
            return Ok(None);
        }
        let answer = match self.as_before {
            Some(_) => self.wait()?,
            None => match self.answers().try_recv() {
                Ok(answer) => answer,
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => return Err(Gone),
            },
        };
        let surface = |(c, _): &(Candidate, Last)| c.verdict.level < TrackStatus::Lost;
        self.answered(answer.outcome.as_ref().is_ok_and(surface));
        Ok(Some(answer))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn after_a_hasty_search_in_vain_comes_a_full_one() {
        let ((ask, _questions), (_answers, answered)) = (channel(), channel());
        let mut beside = Beside::new(ask, answered);
        let efforts = |beside: &Beside| [true, false].map(|alone| beside.next_effort(alone));
        assert_eq!(efforts(&beside), [Effort::Hasty, Effort::Full]);
        (beside.alone, beside.effort) = (true, Effort::Hasty);
        beside.answered(false);
        assert_eq!(efforts(&beside), [Effort::Full, Effort::Full]);
        // A search beside a followed surface tells nothing of a hasty one.
        beside.alone = false;
        beside.answered(true);
        assert_eq!(efforts(&beside), [Effort::Full, Effort::Full]);
        for found in [false, true] {
            (beside.alone, beside.effort) = (true, Effort::Full);
            beside.answered(found);
            assert_eq!(efforts(&beside), [Effort::Hasty, Effort::Full]);
        }
    }
}
