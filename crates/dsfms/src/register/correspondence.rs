//! What is known to lie where in the frame.

use crate::geometry::Point2;

/// A correspondence between a template point and a pixel of the deformed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// 0-based face of the template.
    pub face: u32,
    /// Barycentrics on that face.
    pub barycentric: [f64; 3],
    /// Position in the frame, px.
    pub pixel: Point2,
}
