//! Why there is no calibration.

use super::board::Rejection;
use super::target::Board;
use crate::image::Frame;

/// Images needed: three planes fix five intrinsics with one to spare.
pub const MIN_VIEWS: usize = 3;

/// Why the camera could not be calibrated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// A board without a grid.
    #[error(
        "a board of {}x{} inner corners is too small; expected at least 3x3 corners where four squares meet",
        corners[0], corners[1]
    )]
    Board {
        /// The corners asked for.
        corners: [usize; 2],
    },
    /// A square without a size.
    #[error("the side of a square is {0} mm; it must be a positive number")]
    Square(f64),
    /// Frames of different sizes.
    #[error(
        "frame {other:?} is {}x{} px but {first:?} is {}x{} px; calibrate one resolution at a time",
        other_size[0], other_size[1], first_size[0], first_size[1]
    )]
    Sizes {
        /// The first frame.
        first: String,
        /// Its size.
        first_size: [usize; 2],
        /// The frame that differs.
        other: String,
        /// Its size.
        other_size: [usize; 2],
    },
    /// The images show another board.
    #[error(
        "{images} image(s) show a board of {}x{} inner corners, but {}x{} was asked for; the board size counts the corners where four squares meet, not the squares",
        found[0], found[1], asked[0], asked[1]
    )]
    OtherBoard {
        /// Images that show it.
        images: usize,
        /// The grid that was found.
        found: [usize; 2],
        /// The grid that was asked for.
        asked: [usize; 2],
    },
    /// Not enough images with a board.
    #[error(
        "the board was found in {found} of {frames} images, at least {MIN_VIEWS} are needed (10 or more are advised){}",
        behind_colon(reasons)
    )]
    TooFewViews {
        /// Images with the board.
        found: usize,
        /// All images.
        frames: usize,
        /// Names of some of the others with their reasons; empty where the board is in all of them.
        reasons: String,
    },
    /// The board positions do not fix the intrinsics.
    #[error(
        "the images do not determine the focal length: the board has the same tilt in all of them; tilt it by 20 to 45 degrees in different directions"
    )]
    Degenerate,
}

fn behind_colon(reasons: &str) -> String {
    if reasons.is_empty() { String::new() } else { format!(": {reasons}") }
}

/// Images whose reasons are said; the others look much the same.
const SAID: usize = 4;

impl CalibrateError {
    /// Too few boards; another board in the images is said instead of a list of reasons.
    pub(super) fn too_few(
        found: usize,
        frames: &[Frame],
        rejected: &[(usize, Rejection)],
        board: &Board,
    ) -> Self {
        let mut others: Vec<[usize; 2]> = rejected.iter().filter_map(|(_, r)| r.grid()).collect();
        others.sort_unstable();
        let common = others.chunk_by(|a, b| a == b).max_by_key(|run| run.len());
        if let Some(run) = common.filter(|run| 2 * run.len() > frames.len()) {
            return Self::OtherBoard { images: run.len(), found: run[0], asked: board.corners };
        }
        let reason = |(i, why): &(usize, Rejection)| format!("{}: {why}", frames[*i].name);
        let mut reasons: Vec<String> = rejected.iter().take(SAID).map(reason).collect();
        if rejected.len() > SAID {
            reasons.push(format!("and {} more", rejected.len() - SAID));
        }
        rejected.iter().for_each(|r| tracing::info!(why = %reason(r), "image left out"));
        Self::TooFewViews { found, frames: frames.len(), reasons: reasons.join("; ") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_images_without_a_board_are_told_in_one_short_line() {
        let frame = |i: usize| Frame { name: format!("image_{i:03}"), size: [8, 8], rgb: vec![] };
        let frames: Vec<Frame> = (0..40).map(frame).collect();
        let rejected: Vec<_> = (0..40).map(|i| (i, Rejection::NoGrid { corners: 3 })).collect();
        let board = Board { corners: [7, 5], square: 3.0 };
        let text = CalibrateError::too_few(0, &frames, &rejected, &board).to_string();
        assert!(text.contains("0 of 40 images") && text.ends_with("and 36 more"), "{text}");
        assert!(text.len() < 700, "{}", text.len());
        // The board is in all of too few images.
        let text = CalibrateError::too_few(2, &frames[..2], &[], &board).to_string();
        assert!(text.ends_with("advised)"), "{text}");
    }
}
