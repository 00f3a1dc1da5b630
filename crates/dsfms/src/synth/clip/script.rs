//! What happens in a clip, and when: everything scales with its length.

use super::path::{RATE, Wave, smooth};
use crate::geometry::Point3;
use crate::synth::random::{Random, uniform};
use serde::Serialize;

/// Exposure gain of the exploration.
pub(super) const GAIN: f64 = 0.7;

/// Frames for which the lens is covered, in a clip of at least a hundred frames.
const COVERED: usize = 10;

/// What happens in a clip.
#[derive(Clone, Debug)]
pub struct Script {
    pub(super) manipulations: Vec<ClipPlan>,
    pub(super) passes: Vec<Pass>,
    /// Frames with the lens covered: first and the one after the last.
    pub occlusion: [usize; 2],
    /// First frame after the cut.
    pub cut: usize,
    exposure: Wave,
    /// First frame and factor of the jumps of the exposure, which the camera corrects in a second.
    jumps: [(usize, f64); 2],
}

/// The course of one push or pull.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClipPlan {
    /// Towards the outside of the organ.
    pub pull: bool,
    /// Rise from and fall to zero, frames; a fall of no length is a cut.
    rise: [f64; 2],
    fall: [f64; 2],
    /// An instrument does it.
    tool: bool,
}

impl ClipPlan {
    /// Share of the full deformation at frame `k`.
    pub(super) fn amount(&self, k: usize) -> f64 {
        let at = |[from, to]: [f64; 2]| match to > from {
            true => smooth((k as f64 - from) / (to - from)),
            false => f64::from(u8::from(k as f64 >= from)),
        };
        at(self.rise) * (1.0 - at(self.fall))
    }

    /// 0 at its beginning, 1 at its end.
    pub(super) fn progress(&self, k: usize) -> f64 {
        let [first, last] = [self.rise[0], self.fall[1]];
        ((k as f64 - first) / (last - first).max(1.0)).clamp(0.0, 1.0)
    }

    /// How near the instrument has come, 1 where it touches; `None` where it is away.
    pub(super) fn tool(&self, k: usize) -> Option<f64> {
        // It comes within the first part of the rise and leaves once it has let go.
        let rise = self.rise[1] - self.rise[0];
        let come = smooth((k as f64 - self.rise[0] + 0.5 * rise) / (0.5 * rise).max(1.0));
        let fall = self.fall[1] - self.fall[0];
        let gone = smooth((k as f64 - self.fall[1]) / (0.5 * fall).max(1.0));
        let near = come * (1.0 - gone);
        (self.tool && near > 0.0).then_some(near)
    }
}

/// An instrument that moves across the view without touching.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pass {
    frames: [f64; 2],
    /// Where its tip comes from and goes to, template frame, mm.
    pub ends: [Point3; 2],
    pub trocar: Point3,
}

impl Pass {
    /// `[0, 1]` while it lasts.
    pub(super) fn progress(&self, k: usize) -> Option<f64> {
        let share = (k as f64 - self.frames[0]) / (self.frames[1] - self.frames[0]);
        (0.0..=1.0).contains(&share).then_some(share)
    }
}

/// Where an instrument enters, template frame, mm; left or right by a number.
pub(super) fn trocar(number: usize) -> Point3 {
    let side = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
    Point3::new(85.0 * side, 45.0, -55.0)
}

/// What an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// Tissue is pulled outwards.
    Pull,
    /// Tissue is pushed inwards.
    Push,
    /// An instrument that pulls or pushes is in the scene.
    Tool,
    /// An instrument crosses the view.
    Pass,
    /// The lens is covered.
    Occlusion,
    /// View and shape change at once.
    Cut,
    /// The exposure jumps and is corrected.
    Exposure,
}

/// Something that happens, first and last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Event {
    /// What.
    pub event: EventKind,
    /// First frame.
    pub first: usize,
    /// Last frame.
    pub last: usize,
}

impl Script {
    /// The script of a clip.
    pub fn new(frames: usize, seed: u64) -> Self {
        let mut random = Random::new(seed, 0x5C21);
        let n = frames as f64;
        // No two clips keep the same time.
        let mut at = |share: f64| (n * (share + 0.02 * (uniform(&mut random) - 0.5))).round();
        let cut = at(0.70);
        let plan = |pull, rise, fall, tool| ClipPlan { pull, rise, fall, tool };
        let manipulations = vec![
            plan(true, [at(0.08), at(0.14)], [at(0.24), at(0.30)], true),
            plan(false, [at(0.27), at(0.34)], [at(0.44), at(0.52)], false),
            plan(true, [at(0.51), at(0.60)], [cut, cut], false),
            plan(false, [cut, cut], [at(0.80), at(0.87)], false),
            plan(true, [at(0.84), at(0.90)], [at(0.95), n], true),
        ];
        let mut pass = |share: [f64; 2], side: f64, height: f64| Pass {
            frames: share.map(&mut at),
            ends: [
                Point3::new(70.0 * side, 30.0, -height),
                Point3::new(-25.0 * side, -18.0, -height),
            ],
            trocar: Point3::new(95.0 * side, 60.0, -50.0),
        };
        let passes = vec![
            pass([0.37, 0.43], -1.0, 14.0),
            pass([0.62, 0.68], 1.0, 10.0),
            pass([0.75, 0.82], 1.0, 12.0),
        ];
        let covered = COVERED.min(frames / 10) as f64;
        let start = at(0.56);
        let jumps = [(at(0.18) as usize, 1.35), (at(0.79) as usize, 0.7)];
        Self {
            manipulations,
            passes,
            occlusion: [start as usize, (start + covered) as usize],
            cut: cut as usize,
            jumps,
            exposure: Wave::new(&mut random),
        }
    }

    /// Exposure gain of frame `k`.
    pub fn gain(&self, k: usize) -> f64 {
        let slow = (0.12 * self.exposure.at(k as f64 / RATE)).exp();
        let jump = |&(first, factor): &(usize, f64)| match k.checked_sub(first) {
            Some(since) => 1.0 + (factor - 1.0) * (1.0 - smooth(since as f64 / RATE)),
            None => 1.0,
        };
        let after = if k >= self.cut { 1.12 } else { 1.0 };
        GAIN * slow * after * self.jumps.iter().map(jump).product::<f64>()
    }

    /// Whether the lens is covered at frame `k`.
    pub fn covered(&self, k: usize) -> bool {
        (self.occlusion[0]..self.occlusion[1]).contains(&k)
    }

    /// Everything that happens in the first `frames` frames, in order.
    pub fn events(&self, frames: usize) -> Vec<Event> {
        let spans = |event: EventKind, here: &dyn Fn(usize) -> bool| -> Vec<Event> {
            let mut list: Vec<Event> = Vec::new();
            for k in (0..frames).filter(|&k| here(k)) {
                match list.last_mut() {
                    Some(open) if open.last + 1 == k => open.last = k,
                    _ => list.push(Event { event, first: k, last: k }),
                }
            }
            list
        };
        let mut events = Vec::new();
        for plan in &self.manipulations {
            let kind = if plan.pull { EventKind::Pull } else { EventKind::Push };
            events.extend(spans(kind, &|k| plan.amount(k) > 0.0));
            events.extend(spans(EventKind::Tool, &|k| plan.tool(k).is_some()));
        }
        for pass in &self.passes {
            events.extend(spans(EventKind::Pass, &|k| pass.progress(k).is_some()));
        }
        events.extend(spans(EventKind::Occlusion, &|k| self.covered(k)));
        events.extend(spans(EventKind::Cut, &|k| k == self.cut));
        for (first, _) in self.jumps {
            let second = RATE as usize;
            events.extend(spans(EventKind::Exposure, &|k| (first..first + second).contains(&k)));
        }
        events.sort_by_key(|e| (e.first, e.last));
        events
    }
}
