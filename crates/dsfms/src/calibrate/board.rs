//! The board in one image: coarse to fine until the whole grid is there, then sub-pixel corners.

use super::grid::{Lattice, largest_grid, plus, predict};
use super::saddle::{Saddle, saddles};
use super::subpixel::Gradients;
use super::target::Board;
use crate::geometry::{Point2, Vector2};
use crate::image::Plane;
use crate::image::filter::halve;
use std::fmt;

/// One inner corner of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardCorner {
    /// Column and row on the board, from 0. Columns run along the first side of
    /// [`Board::corners`]; which end counts as the first cannot be told from the picture.
    pub grid: [usize; 2],
    /// Position, px, pixel centres at integers.
    pub pixel: Point2,
}

/// The place of a corner on the board, mm.
pub(super) fn on_board(corner: &BoardCorner, board: &Board) -> Point2 {
    Point2::new(corner.grid[0] as f64 * board.square, corner.grid[1] as f64 * board.square)
}

/// Why an image has no board.
#[derive(Clone, Debug, PartialEq)]
pub enum Rejection {
    /// No grid at all.
    NoGrid {
        /// Corners that alternate bright and dark, grid or not.
        corners: usize,
    },
    /// A grid, but not of this board.
    OtherGrid {
        /// Its columns and rows, the longer side first.
        found: [usize; 2],
        /// The board's.
        asked: [usize; 2],
    },
    /// A part of the board.
    Incomplete {
        /// Columns and rows of the part, the longer side first.
        found: [usize; 2],
        /// Corners in it.
        corners: usize,
        /// The board's columns and rows.
        asked: [usize; 2],
    },
}

impl Rejection {
    /// The grid that was found instead.
    pub(super) fn grid(&self) -> Option<[usize; 2]> {
        match *self {
            Self::NoGrid { .. } => None,
            Self::OtherGrid { found, .. } => Some(found),
            Self::Incomplete { found, corners, .. } => {
                (corners == found[0] * found[1]).then_some(found)
            }
        }
    }
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoGrid { corners } => write!(
                f,
                "no chessboard ({corners} loose corners); is it in focus, lit evenly and without glare?"
            ),
            Self::OtherGrid { found: [c, r], asked: [w, h] } => {
                write!(f, "a grid of {c}x{r} inner corners, not {w}x{h}")
            }
            Self::Incomplete { found: [c, r], corners, asked: [w, h] } => write!(
                f,
                "only {corners} corners of a {c}x{r} part of the {w}x{h} board; the rest is hidden, in glare or outside the image"
            ),
        }
    }
}

/// Levels of the image pyramid at most.
const LEVELS: usize = 4;
/// A level must keep this many px along its shorter side.
const MIN_SIDE: usize = 100;
/// A whole board may lack this share of its corners (glare).
const MAX_MISSING: f64 = 0.1;
/// Smallest part of a board that is of use.
const MIN_PART: usize = 4;

/// Find the board in an image (encoded grey). With `partial`, a part of it is enough.
///
/// # Errors
/// What of the board was found, or why none.
pub fn find_board(
    image: &Plane,
    board: &Board,
    partial: bool,
) -> Result<Vec<BoardCorner>, Rejection> {
    let mut levels = vec![image.clone()];
    while levels.len() < LEVELS {
        let next = halve(&levels[levels.len() - 1]);
        if next.size[0].min(next.size[1]) < MIN_SIDE {
            break;
        }
        levels.push(next);
    }
    let gradients = Gradients::new(image);
    let (mut best, mut why) = (Vec::new(), Rejection::NoGrid { corners: 0 });
    for (level, plane) in levels.iter().enumerate().rev() {
        let corners = saddles(plane);
        let grid = trimmed(largest_grid(&corners));
        let corners = on_full_image(&corners, level);
        let found = match judge(&grid, corners.len(), board) {
            Ok(()) => refined(&gradients, &corners, &grid, board),
            Err(reason) => {
                let part = reason.is_part() && partial;
                if reason.extent() >= why.extent() {
                    why = reason;
                }
                if part { refined(&gradients, &corners, &grid, board) } else { Vec::new() }
            }
        };
        let needed = (1.0 - MAX_MISSING) * (board.corners[0] * board.corners[1]) as f64;
        if found.len() as f64 >= needed {
            return Ok(found);
        }
        if found.len() > best.len() {
            best = found;
        }
    }
    if partial && best.len() >= MIN_PART * MIN_PART { Ok(best) } else { Err(why) }
}

impl Rejection {
    fn is_part(&self) -> bool {
        matches!(self, Self::Incomplete { found, .. } if found[1] >= MIN_PART)
    }

    /// Corners seen, to tell the most telling of several reasons.
    fn extent(&self) -> usize {
        match self {
            Self::NoGrid { corners } => (*corners).min(4),
            Self::OtherGrid { found: [c, r], .. } => c * r,
            Self::Incomplete { corners, .. } => *corners,
        }
    }
}

/// Whether the grid is the whole board.
fn judge(grid: &Lattice, loose: usize, board: &Board) -> Result<(), Rejection> {
    let Some((low, high)) = extent(grid) else {
        return Err(Rejection::NoGrid { corners: loose });
    };
    let sorted = |mut pair: [usize; 2]| {
        pair.sort_unstable_by(|a, b| b.cmp(a));
        pair
    };
    let found = sorted([0, 1].map(|k| (high[k] - low[k] + 1) as usize));
    let wanted = sorted(board.corners);
    let asked = board.corners;
    let missing = (wanted[0] * wanted[1]) as f64 * MAX_MISSING;
    if found[0] > wanted[0] || found[1] > wanted[1] {
        Err(Rejection::OtherGrid { found, asked })
    } else if found != wanted || (wanted[0] * wanted[1] - grid.len()) as f64 > missing {
        Err(Rejection::Incomplete { found, corners: grid.len(), asked })
    } else {
        Ok(())
    }
}

fn extent(grid: &Lattice) -> Option<([i32; 2], [i32; 2])> {
    let mut places = grid.keys();
    let first = *places.next()?;
    Some(places.fold((first, first), |(low, high), p| {
        ([0, 1].map(|k| low[k].min(p[k])), [0, 1].map(|k| high[k].max(p[k])))
    }))
}

/// The grid without border rows and columns of which less than half is there: chance corners
/// beside the board.
fn trimmed(mut grid: Lattice) -> Lattice {
    while let Some((low, high)) = extent(&grid) {
        let thin =
            (0..2).flat_map(|axis| [(axis, low[axis]), (axis, high[axis])]).find(|&(axis, at)| {
                let there = grid.keys().filter(|p| p[axis] == at).count() as i32;
                2 * there < high[1 - axis] - low[1 - axis] + 1
            });
        let Some((axis, at)) = thin else { break };
        grid.retain(|p, _| p[axis] != at);
    }
    grid
}

/// Corners of a pyramid level as corners of the full image.
fn on_full_image(corners: &[Saddle], level: usize) -> Vec<Saddle> {
    let scale = (1 << level) as f64;
    let lift = |c: &Saddle| Saddle {
        at: Point2::from(c.at.coords * scale + Vector2::repeat(0.5 * (scale - 1.0))),
        ..*c
    };
    corners.iter().map(lift).collect()
}

/// Sub-pixel corners with their place on the board; corners where that fails are left out.
fn refined(
    gradients: &Gradients,
    corners: &[Saddle],
    grid: &Lattice,
    board: &Board,
) -> Vec<BoardCorner> {
    let at = |p: [i32; 2]| grid.get(&p).map(|&i| corners[i].at);
    let place = Placement::new(grid, &at, board);
    let mut found: Vec<BoardCorner> = grid
        .iter()
        .filter_map(|(&p, &i)| {
            let step = shortest_step(&at, p)?;
            // The window must not reach the next corner's edges.
            let radius = (0.45 * step).clamp(2.5, 20.0);
            let pixel = gradients.corner(corners[i].at, radius)?;
            Some(BoardCorner { grid: place.of(p), pixel })
        })
        .collect();
    found.sort_by_key(|c| [c.grid[1], c.grid[0]]);
    found
}

fn shortest_step(at: &dyn Fn([i32; 2]) -> Option<Point2>, place: [i32; 2]) -> Option<f64> {
    let sides = [[1, 0], [0, 1], [-1, 0], [0, -1]];
    let step = |side: &[i32; 2]| Some((at(plus(place, *side, 1))? - at(place)?).norm());
    let near = sides.iter().filter_map(step).min_by(f64::total_cmp);
    near.or_else(|| sides.iter().find_map(|side| Some(predict(at, place, *side)?.1)))
}

/// From grid places, whose axes are arbitrary, to columns and rows of the board.
struct Placement {
    low: [i32; 2],
    high: [i32; 2],
    swap: bool,
    flip: [bool; 2],
}

impl Placement {
    /// Columns along the board's first side, rows to the right of them in the image, both as much
    /// towards right and down as that allows.
    fn new(grid: &Lattice, at: &dyn Fn([i32; 2]) -> Option<Point2>, board: &Board) -> Self {
        let (low, high) = extent(grid).unwrap_or_default();
        let mean = |side: [i32; 2]| -> Vector2 {
            let steps = grid.keys().filter_map(|&p| Some(at(plus(p, side, 1))? - at(p)?));
            steps.sum()
        };
        let axes = [mean([1, 0]), mean([0, 1])];
        let size = [0, 1].map(|k| (high[k] - low[k] + 1) as usize);
        let [w, h] = board.corners;
        let swap = if w == h {
            axes[1].x.abs() > axes[0].x.abs()
        } else {
            size[0] > w || size[1] > h || (size[1] > size[0]) != (h > w)
        };
        let [column, row] = if swap { [axes[1], axes[0]] } else { axes };
        let backwards = if column.x.abs() > column.y.abs() { column.x } else { column.y } < 0.0;
        let clockwise = column.x * row.y - column.y * row.x > 0.0;
        Self { low, high, swap, flip: [backwards, clockwise == backwards] }
    }

    fn of(&self, place: [i32; 2]) -> [usize; 2] {
        let order = if self.swap { [1, 0] } else { [0, 1] };
        [0, 1].map(|k| {
            let axis = order[k];
            let from = if self.flip[k] {
                self.high[axis] - place[axis]
            } else {
                place[axis] - self.low[axis]
            };
            from as usize
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{board, camera, picture, poses};
    use super::*;
    use crate::camera::Camera;
    use crate::geometry::Point3;

    #[test]
    fn every_corner_of_a_rendered_board() {
        for pose in poses() {
            let found = find_board(&picture(&pose), &board(), false).unwrap();
            assert_eq!(found.len(), 35);
            // The board may be read from either end.
            let error = |turn: bool| {
                let off = found.iter().map(|c| {
                    let [u, v] = if turn { [6 - c.grid[0], 4 - c.grid[1]] } else { c.grid };
                    let p = Point3::new(3.0 * u as f64, 3.0 * v as f64, 0.0);
                    (camera().project(&(pose * p)).unwrap().pixel - c.pixel).norm()
                });
                off.fold(0.0, f64::max)
            };
            assert!(error(false).min(error(true)) < 0.2, "{} {}", error(false), error(true));
        }
    }

    #[test]
    fn another_board_is_named() {
        let image = picture(&poses()[0]);
        let asked = |corners| find_board(&image, &Board { corners, square: 3.0 }, false);
        let why = asked([6, 4]).unwrap_err();
        assert_eq!(why, Rejection::OtherGrid { found: [7, 5], asked: [6, 4] });
        let why = asked([9, 6]).unwrap_err();
        assert_eq!(why, Rejection::Incomplete { found: [7, 5], corners: 35, asked: [9, 6] });
        assert_eq!(asked([5, 7]).unwrap().len(), 35);
        let part = find_board(&image, &Board { corners: [9, 6], square: 3.0 }, true).unwrap();
        assert_eq!(part.len(), 35);
    }

    #[test]
    fn nothing_in_an_empty_image() {
        let blank = Plane::filled([160, 120], 0.4);
        let why = find_board(&blank, &board(), true).unwrap_err();
        assert_eq!(why, Rejection::NoGrid { corners: 0 });
    }
}
