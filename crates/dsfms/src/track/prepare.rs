//! What a frame needs before any surface is known: done ahead of the solve, on another thread where
//! there is one.

use super::TrackError;
use super::look::{LEVELS, Seen, Working};
use super::reduce::{Reduced, Tables, any, halve_mask, halved, stretch};
use crate::camera::CameraModel;
use crate::geometry::Vector2;
use crate::image::flow::Pyramid;
use crate::image::viewport::INSTRUMENT_MARGIN;
use crate::image::{Frame, Mask, Picture, ToneCurve, diagonal, viewport};
use crate::sfm::{Features2d, SfmOptions, detect};
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Margin about highlights within which nothing is compared, of the image diagonal.
const HALO: f64 = 0.003;

/// Frames for which the outline of the endoscope's viewport is kept.
const VIEWPORT_FRAMES: usize = 25;

/// The viewport is looked for in a frame of at most so many columns.
const VIEWPORT_COLUMNS: usize = 400;

/// What the mask of the viewport loses at its rim at that size is given back, px of that size; the
/// rest of the margin is about what it would be at full size.
const VIEWPORT_GIVEN_BACK: f64 = 4.0;

/// Brightest value of a frame that counts as black.
const BLACK: u8 = 16;

/// Prepares the frames of one video, in order; remembers the outline of the endoscope's viewport.
///
/// It borrows nothing, so that it can run on a thread of its own:
///
/// ```no_run
/// # fn follow(tracker: &mut dsfms::Tracker, frame: dsfms::Frame) -> Result<(), Box<dyn std::error::Error>> {
/// let (sender, receiver) = std::sync::mpsc::sync_channel(2);
/// let mut preparation = tracker.preparation();
/// // on the reader's thread:
/// sender.send(preparation.prepare(frame, None)?)?;
/// // on the tracker's:
/// let tracked = tracker.solve(&receiver.recv()?);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Preparation {
    size: [usize; 2],
    tables: Tables,
    working: Working,
    /// On a thread of the pool.
    pooled: bool,
    /// When the viewport was looked for, and what was found.
    viewport: Option<(usize, Option<Mask>)>,
    /// Frames given.
    count: usize,
}

/// What is known beforehand of where the organ may be seen; every mask has the frame's size.
#[derive(Clone, Copy, Debug, Default)]
pub struct Regions<'a> {
    /// `true` where an instrument covers the organ.
    pub instrument: Option<&'a Mask>,
    /// `true` where the organ is.
    pub organ: Option<&'a Mask>,
    /// `true` where the picture is valid; without it the endoscope's viewport is looked for.
    pub valid: Option<&'a Mask>,
}

impl<'a> From<Option<&'a Mask>> for Regions<'a> {
    fn from(instrument: Option<&'a Mask>) -> Self {
        Self { instrument, ..Self::default() }
    }
}

/// A frame and what of it may be used.
pub struct Prepared {
    /// The frame itself.
    pub frame: Frame,
    /// Wall time that the preparation took, seconds.
    pub seconds: f64,
    /// Its brightest value.
    pub(super) brightest: u8,
    /// `None` where the frame is black.
    pub(super) view: Option<View>,
}

/// What a frame offers to every attempt.
#[derive(Clone)]
pub(super) struct View {
    pub(super) seen: Seen,
    /// With what lies around the organ in place of it, where a mask tells them apart; `None`: the
    /// same.
    around: Option<Seen>,
    /// What shading is read from.
    pub(super) photo: Shot,
    /// What the surface is compared with; `None`: the same.
    compared: Option<Shot>,
}

/// A frame at one size.
#[derive(Clone)]
pub(super) struct Shot {
    /// Linear light.
    pub(super) picture: Picture,
    /// `true` where the organ may be seen.
    pub(super) usable: Mask,
}

impl View {
    /// What the surface is compared with.
    pub(super) fn compared(&self) -> &Shot {
        self.compared.as_ref().unwrap_or(&self.photo)
    }

    /// The frame as what lies around the organ is looked for in it.
    pub(super) fn around(&self) -> &Seen {
        self.around.as_ref().unwrap_or(&self.seen)
    }
}

impl Seen {
    /// Features of the frame at the size of the working image, by pixels of the frame.
    pub(super) fn features(&self, frame: &Frame, working: &Working, most: usize) -> Features2d {
        let size = self.open.size;
        self.features_in(frame, working, WorkingWindow { corner: [0; 2], size }, most)
    }

    /// The same of a part of the working image; with some margin, since none lie at its border.
    pub(super) fn features_in(
        &self,
        frame: &Frame,
        working: &Working,
        window: WorkingWindow,
        most: usize,
    ) -> Features2d {
        let [w, h] = self.open.size;
        let small = smaller(frame, working.halvings, window);
        let open = window.of(&self.open);
        let usual = SfmOptions::of_frames();
        // Tiles of about the same size as in the whole.
        let share = (small.size[0] * small.size[1]) as f64 / (w * h).max(1) as f64;
        let tiles = (usual.clahe_tiles as f64 * share.sqrt()).round().max(1.0) as usize;
        let options = SfmOptions { max_features: most, clahe_tiles: tiles, ..usual };
        let mut found = detect(&small, Some(&open), &options);
        let corner = Vector2::from(window.corner.map(|c| c as f64));
        found.points.iter_mut().for_each(|p| *p = working.to_frame(*p + corner));
        found
    }
}

/// A rectangle of the working image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct WorkingWindow {
    /// Its first column and row.
    pub(super) corner: [usize; 2],
    /// Columns and rows, all of them in the image.
    pub(super) size: [usize; 2],
}

impl WorkingWindow {
    /// That part of a mask.
    fn of(&self, mask: &Mask) -> Mask {
        let ([left, top], [width, height]) = (self.corner, self.size);
        let row = |y: usize| &mask.data[y * mask.size[0] + left..][..width];
        Mask { size: self.size, data: (top..top + height).flat_map(row).copied().collect() }
    }
}

/// A part of a frame halved so many times, in encoded values.
fn smaller(frame: &Frame, halvings: u32, window: WorkingWindow) -> Frame {
    let side = 1usize << halvings;
    let WorkingWindow { corner, size } = window;
    let (width, half) = (frame.size[0], (side * side / 2) as u32);
    let pixel = |i: usize| {
        let (x, y) = ((corner[0] + i % size[0]) * side, (corner[1] + i / size[0]) * side);
        let mut sum = [half; 3];
        for row in y..y + side {
            for p in &frame.rgb[row * width + x..][..side] {
                (0..3).for_each(|c| sum[c] += u32::from(p[c]));
            }
        }
        sum.map(|v| (v / (side * side) as u32) as u8)
    };
    let rgb = (0..size[0] * size[1]).into_par_iter().map(pixel).collect();
    Frame { name: frame.name.clone(), size, rgb }
}

impl Preparation {
    /// For frames of a camera.
    pub(super) fn new(
        camera: &CameraModel,
        tone: &ToneCurve,
        working: &Working,
        pooled: bool,
    ) -> Self {
        let (size, tables, working) = (camera.size, Tables::of(tone), working.clone());
        Self { size, tables, working, pooled, viewport: None, count: 0 }
    }

    /// The next frame; of the masks that of the instruments (`Some(&mask).into()`), or more.
    ///
    /// # Errors
    /// A frame or mask of another size than the camera's.
    pub fn prepare<'m>(
        &mut self,
        frame: Frame,
        regions: impl Into<Regions<'m>>,
    ) -> Result<Prepared, TrackError> {
        let regions = regions.into();
        let masks = [regions.instrument, regions.organ, regions.valid];
        let sizes = masks.into_iter().flatten().map(|mask| mask.size);
        for found in std::iter::once(frame.size).chain(sizes) {
            if found != self.size {
                let (name, expected) = (frame.name, self.size);
                return Err(TrackError::SizeMismatch { name, found, expected });
            }
        }
        self.count += 1;
        let (start, pooled) = (Instant::now(), self.pooled);
        let mut look = || {
            let brightest = frame.rgb.iter().flatten().copied().max().unwrap_or(0);
            (brightest, (brightest >= BLACK).then(|| self.view(&frame, regions)))
        };
        let (brightest, view) = if pooled { rayon::scope(|_| look()) } else { look() };
        Ok(Prepared { seconds: start.elapsed().as_secs_f64(), frame, brightest, view })
    }

    /// Where the working image is valid and shows no instrument.
    fn open(&mut self, frame: &Frame, regions: Regions) -> Mask {
        let Working { halvings, ref camera, .. } = self.working;
        let mut open = match regions.valid {
            Some(valid) => within(valid, halvings),
            None => {
                let old = |&(at, _): &(usize, _)| self.count >= at + VIEWPORT_FRAMES;
                if self.viewport.as_ref().is_none_or(old) {
                    let lit = lit(frame).map(|mask| stretch(&mask, camera.size));
                    self.viewport = Some((self.count, lit));
                }
                let lit = self.viewport.as_ref().and_then(|v| v.1.clone());
                lit.unwrap_or_else(|| Mask::filled(camera.size, true))
            }
        };
        if let Some(instrument) = regions.instrument {
            let scale = f64::from(1u32 << halvings);
            let covered = any(instrument, halvings).dilate(INSTRUMENT_MARGIN / scale);
            open = open.minus(&covered);
        }
        open
    }

    fn view(&mut self, frame: &Frame, regions: Regions) -> View {
        let open = self.open(frame, regions);
        let Working { halvings, photo_halvings, compared_halvings, .. } = self.working;
        let (usable, around) = match regions.organ {
            Some(organ) => {
                (open.and(&within(organ, halvings)), Some(open.minus(&any(organ, halvings))))
            }
            None => (open, None),
        };
        let base = halvings.min(photo_halvings);
        let reduced = Reduced::of(frame, &self.tables, base);
        let scale = f64::from(1u32 << halvings);
        let halo = HALO * diagonal(frame.size) / scale;
        let white = any(&reduced.saturated(), halvings - base).dilate(halo);
        let bright = halved(&reduced.bright, halvings - base);
        let pyramid = Arc::new(Pyramid::new(bright, LEVELS));
        let seen = |open: Mask| Seen { pyramid: pyramid.clone(), usable: open.minus(&white), open };
        let shot = |times: u32, size: [usize; 2]| Shot {
            picture: reduced.picture(times - base),
            usable: match times.checked_sub(halvings) {
                Some(more) => (0..more).fold(usable.clone(), |mask, _| halve_mask(&mask)),
                None => stretch(&usable, size),
            },
        };
        let photo = shot(photo_halvings, self.working.photo.size);
        let smaller = compared_halvings > photo_halvings;
        let compared = smaller.then(|| shot(compared_halvings, self.working.compared.size));
        View { seen: seen(usable), around: around.map(seen), photo, compared }
    }
}

/// Pixels of a halved image all of which lie in a mask.
fn within(mask: &Mask, halvings: u32) -> Mask {
    any(&mask.complement(), halvings).complement()
}

/// The endoscope's viewport at a reduced size; `None` where the frame has no dark surround.
fn lit(frame: &Frame) -> Option<Mask> {
    let step = frame.size[0].div_ceil(VIEWPORT_COLUMNS).max(1);
    let rows = frame.rgb.chunks_exact(frame.size[0]).step_by(step);
    let rgb = rows.flat_map(|row| row.iter().step_by(step).copied()).collect();
    let size = frame.size.map(|n| n.div_ceil(step));
    let small = Frame { name: frame.name.clone(), size, rgb };
    let mask = viewport(std::slice::from_ref(&small))?;
    Some(if step == 1 { mask } else { mask.dilate(VIEWPORT_GIVEN_BACK) })
}
