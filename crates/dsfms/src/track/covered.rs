//! Where matches leave something open.

use crate::geometry::Point2;

/// Within this distance of a followed place of the rendered template one that descriptors found
/// tells nothing more, px of the working image.
const COVERED_PX: f64 = 12.0;

/// Which parts of the working image have a match near.
pub(super) struct CoveredCells {
    across: usize,
    cells: Vec<bool>,
}

/// Side of a part, px.
const CELL: f64 = 4.0;

impl CoveredCells {
    /// Of an image of a size that has matches at some places.
    pub(super) fn of(size: [usize; 2], places: impl Iterator<Item = Point2>) -> Self {
        let [across, down] = size.map(|n| n.div_ceil(CELL as usize) + 1);
        let mut cells = vec![false; across * down];
        let reach = (COVERED_PX / CELL) as isize;
        for place in places {
            let [x, y] = [place.x, place.y].map(|c| (c / CELL).round() as isize);
            for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)))
            {
                let (x, y) = (x + dx, y + dy);
                let near = dx * dx + dy * dy <= reach * reach;
                if near && (0..across as isize).contains(&x) && (0..down as isize).contains(&y) {
                    cells[y as usize * across + x as usize] = true;
                }
            }
        }
        Self { across, cells }
    }

    /// Whether a match is near; outside the image none.
    pub(super) fn at(&self, place: Point2) -> bool {
        let [x, y] = [place.x, place.y].map(|c| (c / CELL).round());
        let inside = x >= 0.0 && y >= 0.0 && x < self.across as f64;
        inside && self.cells.get(y as usize * self.across + x as usize).copied().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_cover_their_surroundings() {
        let covered = CoveredCells::of([100, 80], [Point2::new(40.0, 40.0)].into_iter());
        assert!(covered.at(Point2::new(40.0, 40.0)) && covered.at(Point2::new(48.0, 44.0)));
        assert!(!covered.at(Point2::new(56.0, 40.0)) && !covered.at(Point2::new(-3.0, 500.0)));
    }
}
