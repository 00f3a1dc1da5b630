//! What else may be meant by the organ, where its outline is a guess: the same energy under other priors.

use super::labels::{Labelling, Parting, Prior};
use crate::image::Mask;

/// Priors, the likeliest meaning first: more than what is looked at, less, and what depth and folds alone enclose.
const OTHERS: [Prior; 3] = [
    Prior { middle: 0.9, favour: 0.75, looks: 1.0, gaze: 0.0 },
    Prior { middle: 0.3, favour: -0.75, looks: 1.0, gaze: 0.0 },
    Prior { middle: 0.7, favour: 0.0, looks: 0.0, gaze: 1.0 },
];
/// Labellings that overlap by more are the same to a user.
const SAME: f64 = 0.9;
/// Shares of what the frames show below and above which a labelling tells nothing.
const SHOWN: [f64; 2] = [0.02, 0.95];

impl Parting<'_> {
    /// Labellings that differ clearly from `own`, from each other and from everything, at most `most`, those first
    /// whose border is marked best.
    pub fn others(&self, own: &Labelling, most: usize) -> Vec<Labelling> {
        let mut found: Vec<Labelling> = Vec::new();
        for prior in &OTHERS {
            let other = self.under(prior);
            let mut known = std::iter::once(own).chain(&found);
            if telling(&other.masks)
                && known.all(|known| overlap(&known.masks, &other.masks) < SAME)
            {
                found.push(other);
            }
        }
        found.sort_by(|a, b| b.marked.total_cmp(&a.marked));
        found.truncate(most);
        found
    }
}

/// Whether the masks hold neither everything nor nothing.
fn telling(masks: &[Mask]) -> bool {
    let own: usize = masks.iter().map(|m| m.data.iter().filter(|&&on| on).count()).sum();
    let all: usize = masks.iter().map(|m| m.data.len()).sum();
    let share = own as f64 / all.max(1) as f64;
    SHOWN[0] < share && share < SHOWN[1]
}

/// Intersection over union of two lists of masks of the same sizes; 1 where both are empty.
pub fn overlap(a: &[Mask], b: &[Mask]) -> f64 {
    let (mut both, mut either) = (0, 0);
    for (p, q) in a.iter().zip(b).flat_map(|(a, b)| a.data.iter().zip(&b.data)) {
        both += usize::from(*p && *q);
        either += usize::from(*p || *q);
    }
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}
