//! What is said of single places of the surface.

use crate::geometry::Point3;

/// Places known to show the organ, or something else: points of the surface, world axes. What lies
/// nearer to the middle of the frame than to any of the others is organ to begin with, or, where
/// the organ is named, what lies nearer to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seeds {
    /// Of the organ.
    pub organ: Vec<Point3>,
    /// Of something else.
    pub other: Vec<Point3>,
}
