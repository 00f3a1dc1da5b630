//! A part of the frames that may be the organ, as outlines.

use super::click::OrganClick;
use crate::camera::PosedFrame;
use crate::dense::{Border, DepthMap, Labelling, outlines};
use crate::image::Mask;

/// A part of the frames that may be the organ.
#[derive(Clone, Debug)]
pub struct OrganGuess {
    /// Name of every frame that shows it, and where: `true` = organ.
    pub masks: Vec<(String, Mask)>,
    /// Its outline in these frames, and how clearly it is marked.
    pub borders: Vec<Vec<Border>>,
    /// Share of its outline along which depth steps: where it is small all is one surface.
    pub stepping: f64,
    /// Share along which depth steps or the image changes: where it is small the outline is a
    /// guess.
    pub marked: f64,
    /// A click that gives this part; `None` where none was found.
    pub click: Option<OrganClick>,
}

/// A labelling as outlines in the frames that show some of it.
pub(super) fn guess_of(
    part: &Labelling,
    views: &[PosedFrame],
    maps: &[DepthMap],
    click: Option<OrganClick>,
) -> OrganGuess {
    let outlines = outlines(&part.masks, views, maps);
    let shown = views.iter().zip(outlines).zip(&part.borders);
    let shown = shown.filter(|((_, mask), _)| mask.data.contains(&true));
    let (masks, borders) = shown
        .map(|((view, mask), border)| ((view.frame.name.clone(), mask), border.clone()))
        .unzip();
    OrganGuess { masks, borders, stepping: part.stepping, marked: part.marked, click }
}
