//! When a surface that is followed, but degraded, is searched by descriptors too.

use crate::verdict::Reason;

/// Searches that found nothing better make the next one this much rarer at most.
const RAREST: usize = 16;

/// Frames for which a surface that is covered, and nothing else, is not searched: at 25 a second an
/// instrument passes in less. A search takes a core from ten to twenty frames
/// (`docs/performance.md`).
const PASSES: usize = 25;

/// What is known of the searches beside degraded surfaces.
pub(super) struct SearchTimes {
    /// Frame of the last one.
    last: Option<usize>,
    /// How much rarer they have become, since they found nothing better.
    rarer: usize,
    /// First of the last frames in a row whose surface is covered, and nothing else.
    covered: Option<usize>,
}

impl Default for SearchTimes {
    fn default() -> Self {
        Self { last: None, rarer: 1, covered: None }
    }
}

/// What covers a part, or veils all: no matter of where the template is.
fn veils(reason: &Reason) -> bool {
    matches!(reason, Reason::RegionContradicted(_) | Reason::Faint { .. })
}

fn covers(reason: &Reason) -> bool {
    matches!(reason, Reason::Covered { .. })
}

/// Whether nothing but what lies before a surface speaks against it.
pub(super) fn merely_hidden(reasons: &[Reason]) -> bool {
    reasons.iter().all(|r| covers(r) || veils(r))
}

impl SearchTimes {
    /// Remember what is wrong with the surface that was followed into frame `now`, if one was.
    pub(super) fn followed(&mut self, now: usize, reasons: Option<&[Reason]>) {
        let covered =
            reasons.is_some_and(|reasons| reasons.iter().any(covers) && merely_hidden(reasons));
        self.covered = covered.then(|| self.covered.unwrap_or(now));
    }

    /// Whether a surface degraded for these reasons is to be searched in frame `now`, where the
    /// last search lies so many frames back or more.
    pub(super) fn due(&self, now: usize, every: usize, reasons: &[Reason]) -> bool {
        let passing = self.covered.is_some_and(|since| now < since + PASSES);
        let due = self.last.is_none_or(|last| now >= last + self.rarer * every);
        due && !passing && !reasons.iter().all(veils)
    }

    /// Frame `now` is searched beside a degraded surface.
    pub(super) fn asked(&mut self, now: usize) {
        self.last = Some(now);
    }

    /// What a search found is better than what was followed, or what was followed is good.
    pub(super) fn worthwhile(&mut self, yes: bool) {
        self.rarer = if yes { 1 } else { (2 * self.rarer).min(RAREST) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_covered_in_passing_is_not_searched() {
        let mut times = SearchTimes::default();
        let covered = [Reason::Covered { shown: 0.7 }, Reason::Faint { contrast: 0.1, usual: 0.2 }];
        let mut due = |now: usize, reasons: &[Reason]| {
            times.followed(now, Some(reasons));
            times.due(now, 10, reasons)
        };
        assert!((1..26).all(|now| !due(now, &covered)));
        assert!(due(26, &covered));
        // Once it was not covered the second begins anew.
        assert!(!due(27, &[]) && !due(28, &covered));
        // Anything else is searched at once; what veils all never is.
        assert!(due(29, &[covered[0].clone(), Reason::Unlike { share: 0.1 }]));
        assert!((30..99).all(|now| !due(now, &covered[1..])));
    }

    #[test]
    fn searches_that_find_nothing_better_become_rarer() {
        let mut times = SearchTimes::default();
        let reasons = [Reason::Unlike { share: 0.1 }];
        let mut searched = Vec::new();
        for now in 1..400 {
            if times.due(now, 10, &reasons) {
                times.asked(now);
                times.worthwhile(false);
                searched.push(now);
            }
        }
        assert_eq!(searched, [1, 21, 61, 141, 301]);
        times.worthwhile(true);
        assert!(times.due(400, 10, &reasons));
    }
}
