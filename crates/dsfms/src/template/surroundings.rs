//! What lies around the organ.

use super::Features;
use crate::mesh::Mesh;

/// What lies around the organ and does not move with it: the wall of the cavity.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// A coarse surface in the template frame.
    pub mesh: Mesh,
    /// Descriptors on it, by which a video finds its camera while the organ deforms; none in older
    /// templates.
    pub features: Features,
}
