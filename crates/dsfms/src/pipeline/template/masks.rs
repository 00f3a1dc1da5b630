//! Which pixels of the exploration may be used.

use super::Exploration;
use crate::image::{Mask, viewport};
use crate::sfm::SfmOptions;

/// The given valid masks inside the viewport, which holds for every stage: its rim moves with the
/// camera and what lies beyond it is black, neither of which is tissue.
pub(super) fn valid_masks(exploration: &Exploration, options: &SfmOptions) -> Vec<Option<Mask>> {
    let lit = if options.find_viewport { viewport(exploration.frames) } else { None };
    let one = |i: usize| match (exploration.valid.get(i).and_then(Option::as_ref), &lit) {
        // A mask of another size is for the stages to refuse, by name.
        (Some(own), Some(lit)) if own.size == lit.size => Some(own.and(lit)),
        (Some(own), _) => Some(own.clone()),
        (None, lit) => lit.clone(),
    };
    (0..exploration.frames.len()).map(one).collect()
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
