//! The search by descriptors on a thread of its own: the video goes on, and the late answer is
//! followed from the frame that was searched into the one at hand.

use super::beside::{Answer, Beside, Effort, Gone, KnownBefore, Need, Question, pool};
use super::candidate::Candidate;
use super::clock::Clock;
use super::prepare::View;
use super::tracker::Tracker;
use super::{Origin, TrackStatus};
use crate::image::Frame;
use crate::verdict::NoSurface;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Searches for a [`Tracker`], on another thread until the tracker is gone.
///
/// ```no_run
/// # fn follow(mut tracker: dsfms::Tracker, frames: Vec<dsfms::Frame>) -> Result<(), Box<dyn std::error::Error>> {
/// // Of a tracker with the options of `TrackOptions::realtime()`.
/// let searcher = tracker.searcher().ok_or("the options ask for no search beside the video")?;
/// std::thread::scope(|scope| {
///     scope.spawn(move || searcher.run());
///     // Taken along, so that it is gone at the end and the search ends with it.
///     let mut tracker = tracker;
///     frames.iter().try_for_each(|frame| tracker.next(frame, None).map(drop))
/// })?;
/// # Ok(())
/// # }
/// ```
pub struct Searcher<'a> {
    tracker: Tracker<'a>,
    asked: Receiver<Question>,
    answers: Sender<Answer>,
}

impl Searcher<'_> {
    /// Search until the tracker is gone.
    pub fn run(mut self) {
        // Threads apart from those that follow, which must not wait behind parts of a search: one
        // beside them, all where there is nothing to follow.
        let pools = [pool(1), pool(rayon::current_num_threads())];
        while let Ok(question) = self.asked.recv() {
            let mut search = || self.answer(&question);
            let answer = match &pools[usize::from(question.alone)] {
                Some(pool) => pool.install(search),
                None => search(),
            };
            if self.answers.send(answer).is_err() {
                break;
            }
        }
    }

    fn answer(&mut self, question: &Question) -> Answer {
        let Question { frame, view, known, .. } = question;
        let tracker = &mut self.tracker;
        (tracker.count, tracker.last) = (known.count, known.last.clone());
        (tracker.usual, tracker.exposed) = (known.usual.clone(), known.exposed.clone());
        let found = tracker.sought(frame, view, question.effort, &mut Clock::default());
        let outcome = found.map(|found| {
            let last = tracker.as_last(view, &found);
            (found, last)
        });
        Answer { outcome, other_camera: tracker.other_camera }
    }
}

impl<'a> Tracker<'a> {
    /// Who searches for this tracker from here on; [`run`](Searcher::run) it on another thread. No
    /// frame waits for it: until the first answer all are lost. Dropped, it leaves the searches to
    /// this tracker. `None` where the options do not ask for it
    /// ([`TrackOptions::search_beside`](super::TrackOptions::search_beside)).
    pub fn searcher(&mut self) -> Option<Searcher<'a>> {
        if !self.options.search_beside {
            return None;
        }
        let (ask, asked) = channel();
        let (answered, answers) = channel();
        self.beside = Some(Beside::new(ask, answers));
        Some(Searcher { tracker: self.twin(), asked, answers: answered })
    }

    /// What the search beside says in this frame, `None` where it says nothing; where nobody
    /// searches any more, the search is made here.
    pub(super) fn sought_beside(
        &mut self,
        mut beside: Beside,
        need: &Need,
        frame: &Frame,
        view: &View,
        clock: &mut Clock,
    ) -> Option<Result<Candidate, NoSurface>> {
        let found = self.asked_beside(&mut beside, need, frame, view, clock);
        match found {
            Ok(found) => {
                self.beside = Some(beside);
                found
            }
            Err(Gone) => need.search.then(|| self.sought(frame, view, Effort::Full, clock)),
        }
    }

    /// Take the answer that is there, and ask about this frame where that is needed still.
    fn asked_beside(
        &mut self,
        beside: &mut Beside,
        need: &Need,
        frame: &Frame,
        view: &View,
        clock: &mut Clock,
    ) -> Result<Option<Result<Candidate, NoSurface>>, Gone> {
        let answer = beside.answer()?;
        self.answered = answer.is_some();
        let found = answer.filter(|_| !need.held).map(|answer| self.caught_up(view, answer, clock));
        let settled = matches!(&found, Some(Ok(c)) if c.verdict.level < TrackStatus::Lost);
        if !need.search || settled || beside.pending {
            return Ok(found);
        }
        let known = KnownBefore {
            count: self.count,
            last: self.last.clone(),
            usual: self.usual.clone(),
            exposed: self.exposed.clone(),
        };
        let alone = need.level == TrackStatus::Lost;
        let effort = beside.next_effort(alone);
        let question = Question { frame: frame.clone(), view: view.clone(), known, alone, effort };
        beside.ask(question)?;
        Ok(found)
    }

    /// What was found in an earlier frame, followed into this one.
    fn caught_up(
        &mut self,
        view: &View,
        answer: Answer,
        clock: &mut Clock,
    ) -> Result<Candidate, NoSurface> {
        self.other_camera = answer.other_camera;
        let (found, last) = answer.outcome?;
        if found.verdict.level == TrackStatus::Lost {
            return Ok(found);
        }
        self.followed_from(view, last, found.places, Origin::Found, clock)
    }
}
