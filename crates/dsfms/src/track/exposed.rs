//! What a video shows of its exposure: what the exploration says, as frames at rest correct it,
//! until one shows another.

use super::recent::RecentMedian;
use crate::refine::AtMatches;
use crate::template::Exposure;

/// Frames at rest that are remembered: a third of a second.
const REMEMBERED: usize = 9;

/// Fewer tell less than the exploration does.
const ENOUGH: usize = 4;

/// Log gains of frames at rest that differ by more are of an exposure that varies: tissue at rest
/// tells it to 0.02.
const VARIES: f64 = 0.03;

/// What a frame shows of its exposure.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shown {
    /// At the matches; `None` where too few of them are seen.
    pub(super) at_matches: Option<AtMatches>,
    /// It is another than expected.
    pub(super) changed: bool,
}

/// The exposure of the frames of one video.
#[derive(Clone, Debug)]
pub(super) struct Exposed {
    /// Log gains of the last frames at rest.
    at_rest: RecentMedian<REMEMBERED, ENOUGH>,
    /// Least and largest of all of them.
    range: [f64; 2],
    /// A frame has shown another exposure than the one expected.
    changed: bool,
}

impl Default for Exposed {
    fn default() -> Self {
        let range = [f64::INFINITY, f64::NEG_INFINITY];
        Self { at_rest: RecentMedian::default(), range, changed: false }
    }
}

impl Exposed {
    /// What is expected of the next frame after an exploration of `told`; `None` where nothing is,
    /// or where the exposure was seen to change.
    pub(super) fn expected(&self, told: Option<Exposure>) -> Option<Exposure> {
        let varies = self.range[1] - self.range[0] > VARIES;
        let told = told.filter(|_| !self.changed && !varies)?;
        Some(Exposure { log_gain: self.at_rest.median().unwrap_or(told.log_gain), ..told })
    }

    /// Remember a frame that was not lost.
    pub(super) fn add(&mut self, shown: &Shown) {
        self.changed |= shown.changed;
        let Some(at) = shown.at_matches.filter(AtMatches::calm) else { return };
        let [least, most] = self.range;
        self.range = [least.min(at.log_gain), most.max(at.log_gain)];
        self.at_rest.add(at.log_gain);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLD: Option<Exposure> = Some(Exposure { log_gain: 0.0, spread: 0.003 });

    fn shown(log_gain: f64, moved: f64, changed: bool) -> Shown {
        Shown { at_matches: Some(AtMatches { log_gain, moved, count: 100 }), changed }
    }

    fn expected(exposed: &Exposed) -> Option<f64> {
        exposed.expected(TOLD).map(|e| e.log_gain)
    }

    #[test]
    fn frames_at_rest_correct_the_exploration() {
        let mut exposed = Exposed::default();
        (1..ENOUGH).for_each(|_| exposed.add(&shown(0.02, 0.0, false)));
        exposed.add(&shown(0.3, 0.02, false));
        exposed.add(&Shown::default());
        assert_eq!(expected(&exposed), Some(0.0));
        exposed.add(&shown(0.02, 0.0, false));
        assert_eq!(expected(&exposed), Some(0.02));
        (0..REMEMBERED).for_each(|_| exposed.add(&shown(0.01, 0.0, false)));
        assert_eq!(expected(&exposed), Some(0.01));
        assert_eq!(exposed.expected(None), None);
    }

    #[test]
    fn an_exposure_that_changes_is_unknown_from_then_on() {
        let mut changed = Exposed::default();
        changed.add(&shown(0.2, 0.02, true));
        assert_eq!(expected(&changed), None);
        let mut varies = Exposed::default();
        [0.0, 0.02, 0.01].iter().for_each(|&g| varies.add(&shown(g, 0.0, false)));
        assert_eq!(expected(&varies), Some(0.0));
        varies.add(&shown(0.04, 0.0, false));
        assert_eq!(expected(&varies), None);
    }
}
