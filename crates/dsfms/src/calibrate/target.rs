//! What is photographed.

use crate::geometry::Point3;
use serde::{Deserialize, Serialize};

/// A chessboard: corners where four squares meet, counted along both sides, and the length of a
/// square's side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Inner corners along the two sides, each at least 3.
    pub corners: [usize; 2],
    /// Side of a square, mm.
    pub square: f64,
}

impl Board {
    /// Every corner, mm: x along the first side, y along the second, z 0.
    pub fn points(&self) -> Vec<Point3> {
        let [columns, rows] = self.corners;
        let at = |k: usize| [k % columns, k / columns].map(|n| n as f64 * self.square);
        (0..columns * rows).map(at).map(|[x, y]| Point3::new(x, y, 0.0)).collect()
    }
}
