//! What a frame needs before any surface is known: done ahead of the solve, on another thread where
//! there is one.

use super::TrackError;
use super::look::{Seen, Working};
use crate::camera::CameraModel;
use crate::image::{Frame, Mask, Picture, ToneCurve, saturation, usable, viewport};
use crate::pipeline::Method;
use std::time::Instant;

/// Margin about highlights within which nothing is compared, of the image diagonal.
const HALO: f64 = 0.003;

/// Frames for which the outline of the endoscope's viewport is kept.
const VIEWPORT_FRAMES: usize = 25;

/// Brightest value of a frame that counts as black.
const BLACK: u8 = 16;

/// Prepares the frames of one video, in order; remembers the outline of the endoscope's viewport.
///
/// It borrows nothing, so that it can run on a thread of its own:
///
/// ```ignore
/// let mut preparation = tracker.preparation();
/// // on the reader's thread:
/// sender.send(preparation.prepare(frame, None)?);
/// // on the tracker's:
/// let tracked = tracker.solve(&receiver.recv()?);
/// ```
#[derive(Clone, Debug)]
pub struct Preparation {
    size: [usize; 2],
    tone: ToneCurve,
    working: Working,
    method: Method,
    /// When the viewport was looked for, and what was found.
    viewport: Option<(usize, Option<Mask>)>,
    /// Frames given.
    count: usize,
}

/// A frame and what of it may be used.
pub struct Prepared {
    /// The frame itself.
    pub frame: Frame,
    pub(super) usable: Mask,
    /// `None` where the frame is black; then the brightest value says how much.
    pub(super) seen: Option<Seen>,
    pub(super) brightest: u8,
    /// What shading is read from, for the joint method.
    pub(super) picture: Option<Picture>,
    /// Wall time that the preparation took, seconds.
    pub seconds: f64,
}

impl Preparation {
    /// For frames of a camera that the method is to track.
    pub(super) fn new(
        camera: &CameraModel,
        tone: &ToneCurve,
        working: &Working,
        method: Method,
    ) -> Self {
        let (size, tone, working) = (camera.size, tone.clone(), working.clone());
        Self { size, tone, working, method, viewport: None, count: 0 }
    }

    /// The next frame; `instrument`: `true` where an instrument covers the organ.
    ///
    /// # Errors
    /// A frame or mask of another size than the camera's.
    pub fn prepare(
        &mut self,
        frame: Frame,
        instrument: Option<&Mask>,
    ) -> Result<Prepared, TrackError> {
        for found in [Some(frame.size), instrument.map(|m| m.size)].into_iter().flatten() {
            if found != self.size {
                let (name, expected) = (frame.name, self.size);
                return Err(TrackError::SizeMismatch { name, found, expected });
            }
        }
        let start = Instant::now();
        self.count += 1;
        let brightest = frame.rgb.iter().flatten().copied().max().unwrap_or(0);
        let black = brightest < BLACK;
        let usable =
            if black { Mask::filled([0, 0], false) } else { self.usable(&frame, instrument) };
        let seen = (!black).then(|| self.seen(&frame, &usable));
        let joint = !black && self.method == Method::Joint;
        let picture = joint.then(|| Picture::of(&frame, &self.tone));
        let seconds = start.elapsed().as_secs_f64();
        Ok(Prepared { frame, usable, seen, brightest, picture, seconds })
    }

    fn usable(&mut self, frame: &Frame, instrument: Option<&Mask>) -> Mask {
        let old = |&(at, _): &(usize, _)| self.count >= at + VIEWPORT_FRAMES;
        if self.viewport.as_ref().is_none_or(old) {
            self.viewport = Some((self.count, viewport(std::slice::from_ref(frame))));
        }
        let lit = self.viewport.as_ref().and_then(|v| v.1.clone());
        usable(frame.size, lit, instrument, None)
    }

    fn seen(&self, frame: &Frame, usable: &Mask) -> Seen {
        let [w, h] = frame.size;
        let halo = HALO * (w as f64).hypot(h as f64);
        let clear = usable.minus(&saturation(frame).dilate(halo));
        Seen::new(frame, &self.tone, &clear, &self.working)
    }
}
