//! The sharpest frame of every window, then those that moved.

use super::motion::{Thumbnail, displacement};
use super::options::SelectOptions;
use crate::image::Frame;
use crate::image::filter::{halve, laplacian_variance};

/// The sharpest frame so far of each window.
pub(super) struct Candidates {
    /// Length of a window in frames, at least 1.
    window: f64,
    limit: usize,
    /// Window number, sharpness, frame.
    best: Vec<(usize, f64, Frame)>,
}

impl Candidates {
    /// Windows for a video of `total` frames; of unknown length, windows start at one frame and
    /// double whenever there are twice as many as wanted.
    pub(super) fn new(options: &SelectOptions, total: Option<usize>) -> Self {
        let auto = total.map_or(1.0, |total| total as f64 / options.max_frames as f64);
        let window = options.stride.map_or(auto, |stride| stride as f64).max(1.0);
        let limit = if options.stride.is_some() { usize::MAX } else { 2 * options.max_frames };
        Self { window, limit, best: Vec::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.best.is_empty()
    }

    /// Look at one frame and its number.
    pub(super) fn offer(&mut self, number: usize, frame: Frame) {
        let window = (number as f64 / self.window) as usize;
        let sharpness = laplacian_variance(&halve(&frame.luma()), None);
        match self.best.last_mut() {
            Some(best) if best.0 == window => {
                if sharpness > best.1 {
                    *best = (window, sharpness, frame);
                }
            }
            _ => self.best.push((window, sharpness, frame)),
        }
        if self.best.len() > self.limit {
            self.double();
        }
    }

    /// Windows of twice the length: of each pair the sharper frame stays.
    fn double(&mut self) {
        self.window *= 2.0;
        let mut merged: Vec<(usize, f64, Frame)> = Vec::with_capacity(self.limit);
        for (window, sharpness, frame) in self.best.drain(..) {
            let window = window / 2;
            match merged.last_mut() {
                Some(last) if last.0 == window => {
                    if sharpness > last.1 {
                        *last = (window, sharpness, frame);
                    }
                }
                _ => merged.push((window, sharpness, frame)),
            }
        }
        self.best = merged;
    }

    /// The candidates that moved against the one chosen before, at most `max_frames`.
    pub(super) fn choose(mut self, options: &SelectOptions) -> Vec<Frame> {
        while self.best.len() > options.max_frames && self.best.len() > 1 {
            self.double();
        }
        let mut chosen: Vec<Frame> = Vec::new();
        let mut last: Option<Thumbnail> = None;
        for (_, _, frame) in self.best {
            let small = Thumbnail::new(&frame);
            let still = last.as_ref().is_some_and(|l| displacement(l, &small) < options.min_motion);
            if !still {
                last = Some(small);
                chosen.push(frame);
            }
        }
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::frame_name;
    use super::*;

    /// A moving texture; every frame but each `sharp`th is blurred to a low contrast.
    fn picture(index: usize, shift: usize, contrast: usize) -> Frame {
        let size = [240, 120];
        let grey = |i: usize| {
            let (x, y) = ((i % 240 + shift) / 4, (i / 240) / 4);
            (100 + contrast * ((x * 7919 + y * 104_729) % 19) / 2) as u8
        };
        Frame { name: frame_name(index), size, rgb: (0..240 * 120).map(|i| [grey(i); 3]).collect() }
    }

    fn names(frames: &[Frame]) -> Vec<&str> {
        frames.iter().map(|frame| frame.name.as_str()).collect()
    }

    #[test]
    fn the_sharpest_of_each_window() {
        let options = SelectOptions { max_frames: 4, ..Default::default() };
        let mut candidates = Candidates::new(&options, Some(20));
        for i in 0..20 {
            candidates.offer(i, picture(i, 2 * i, if i % 5 == 3 { 10 } else { 6 }));
        }
        let frames = candidates.choose(&options);
        assert_eq!(names(&frames), ["frame_003", "frame_008", "frame_013", "frame_018"]);
    }

    #[test]
    fn windows_need_not_be_of_whole_frames() {
        let options = SelectOptions { max_frames: 8, ..Default::default() };
        let mut candidates = Candidates::new(&options, Some(20));
        (0..20).for_each(|i| candidates.offer(i, picture(i, 3 * i, 6)));
        assert_eq!(candidates.choose(&options).len(), 8);
    }

    #[test]
    fn a_resting_camera_gives_one_frame() {
        let options = SelectOptions { max_frames: 4, ..Default::default() };
        let mut candidates = Candidates::new(&options, Some(20));
        (0..20).for_each(|i| candidates.offer(i, picture(i, 7, 6)));
        assert_eq!(names(&candidates.choose(&options)), ["frame_000"]);
    }

    #[test]
    fn unknown_length_keeps_memory_and_number_bounded() {
        let options = SelectOptions { max_frames: 3, ..Default::default() };
        let mut candidates = Candidates::new(&options, None);
        for i in 0..50 {
            candidates.offer(i, picture(i, 3 * i, 6));
            assert!(candidates.best.len() <= 7);
        }
        let frames = candidates.choose(&options);
        assert!((2..=3).contains(&frames.len()), "{:?}", names(&frames));
        let every = SelectOptions { stride: Some(5), max_frames: 100, min_motion: 0.0 };
        let mut candidates = Candidates::new(&every, None);
        (0..20).for_each(|i| candidates.offer(i, picture(i, 0, 6)));
        assert_eq!(candidates.choose(&every).len(), 4);
    }
}
