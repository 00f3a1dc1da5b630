//! Which pixels of the exploration may be used.

use super::exploration::Exploration;
use crate::image::{Mask, viewport};
use crate::sfm::{SfmError, SfmOptions, check_sizes};

/// The given valid masks inside the viewport, which holds for every stage: its rim moves with the
/// camera and what lies beyond it is black, neither of which is tissue.
///
/// # Errors
/// A frame or a mask of another size than the camera.
pub(super) fn valid_masks(
    exploration: &Exploration,
    options: &SfmOptions,
) -> Result<Vec<Option<Mask>>, SfmError> {
    for masks in [exploration.valid, exploration.organ] {
        check_sizes(exploration.frames, masks, exploration.camera)?;
    }
    let lit = if options.find_viewport { viewport(exploration.frames) } else { None };
    let one = |i: usize| match (exploration.valid.get(i).and_then(Option::as_ref), &lit) {
        (Some(own), Some(lit)) => Some(own.and(lit)),
        (own, lit) => own.or(lit.as_ref()).cloned(),
    };
    Ok((0..exploration.frames.len()).map(one).collect())
}

/// Where a frame is both valid and organ.
pub(super) fn usable_masks(exploration: &Exploration) -> Vec<Option<Mask>> {
    let of = |masks: &[Option<Mask>], i: usize| masks.get(i).cloned().flatten();
    (0..exploration.frames.len())
        .map(|i| match (of(exploration.valid, i), of(exploration.organ, i)) {
            (Some(valid), Some(organ)) => Some(valid.and(&organ)),
            (valid, organ) => valid.or(organ),
        })
        .collect()
}
