//! Blocks of the normal matrix, found once and kept from solve to solve.

use crate::solver::Pattern;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Blocks found before in one pattern: most stencils come again from solve to solve.
#[derive(Default)]
pub(super) struct KnownSlots {
    /// Of all stencils of the term at a place in the objective, where there was one.
    terms: Mutex<HashMap<usize, LocatedTerm>>,
    /// Of single wide stencils: a dozen vertices have 78 blocks to find.
    wide: Mutex<HashMap<Box<[u32]>, Slots>>,
}

/// Block indices of every pair (a ≥ b) of one or more stencils, in order.
pub(super) type Slots = Arc<[u32]>;

struct LocatedTerm {
    /// Vertices of the stencils, one after the other.
    vertices: Vec<u32>,
    /// How many there are in each.
    sizes: Vec<u32>,
    slots: Slots,
}

impl LocatedTerm {
    fn is_of<'t>(&self, stencils: impl ExactSizeIterator<Item = &'t [u32]>) -> bool {
        let mut rest = &self.vertices[..];
        let mut next = |(stencil, &size): (&[u32], &u32)| {
            let Some((own, after)) = rest.split_at_checked(size as usize) else { return false };
            rest = after;
            own == stencil
        };
        stencils.len() == self.sizes.len() && stencils.zip(&self.sizes).all(&mut next)
    }
}

impl KnownSlots {
    const NARROW: usize = 4;

    /// The blocks of the term at a place in the objective; `None` where a pair has none.
    pub(super) fn locate<'t, I>(
        &self,
        pattern: &Pattern,
        place: usize,
        stencils: I,
    ) -> Option<Slots>
    where
        I: ExactSizeIterator<Item = &'t [u32]> + Clone,
    {
        let of_term = |known: &Self| {
            let terms = known.terms.lock().unwrap_or_else(PoisonError::into_inner);
            let found = terms.get(&place).filter(|found| found.is_of(stencils.clone()));
            found.map(|found| Arc::clone(&found.slots))
        };
        if let Some(slots) = of_term(self) {
            return Some(slots);
        }
        let mut slots = Vec::new();
        for stencil in stencils.clone() {
            self.append(pattern, stencil, &mut slots)?;
        }
        let slots: Slots = slots.into();
        let found = LocatedTerm {
            vertices: stencils.clone().flatten().copied().collect(),
            sizes: stencils.map(|s| s.len() as u32).collect(),
            slots: Arc::clone(&slots),
        };
        self.terms.lock().unwrap_or_else(PoisonError::into_inner).insert(place, found);
        Some(slots)
    }

    fn append(&self, pattern: &Pattern, stencil: &[u32], slots: &mut Vec<u32>) -> Option<()> {
        if stencil.len() <= Self::NARROW {
            return find_blocks(pattern, stencil, slots);
        }
        let mut wide = self.wide.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = wide.get(stencil) {
            slots.extend_from_slice(found);
            return Some(());
        }
        let start = slots.len();
        find_blocks(pattern, stencil, slots)?;
        wide.insert(stencil.into(), slots[start..].into());
        Some(())
    }
}

/// Append the block of every pair (a ≥ b) of a stencil, in order; `None` where one has none.
fn find_blocks(pattern: &Pattern, stencil: &[u32], slots: &mut Vec<u32>) -> Option<()> {
    for (k, &a) in stencil.iter().enumerate() {
        for &b in &stencil[..=k] {
            slots.push(pattern.find(a, b)? as u32);
        }
    }
    Some(())
}
