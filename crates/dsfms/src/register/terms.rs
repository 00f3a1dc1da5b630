//! The terms of eqs. 3 and 4 and of the joint problem that are made of one scene.

use super::correspondence::Match;
use super::{Prior, Scene};
use crate::camera::CameraModel;
use crate::energy::{AnchorPrior, Arap, Boundary, Motion};
use crate::geometry::Point3;

/// Expected distance of what is not seen from its reference, of the visible radius: as
/// `depth_hold`, the tolerance of what is held to the rigid pose.
const HIDDEN_SPREAD: f64 = 0.04;

impl<'a> Scene<'a> {
    /// Matched surface points project where they were seen, within `sigma_px`.
    pub fn motion(&self, matches: &[Match], sigma_px: f64) -> Motion<'a, CameraModel> {
        Motion {
            camera: self.camera,
            faces: matches.iter().map(|m| self.face(m)).collect(),
            barycentrics: matches.iter().map(|m| m.barycentric).collect(),
            pixels: matches.iter().map(|m| m.pixel).collect(),
            sigma_px,
        }
    }

    /// The depth of the matches is that on `shape`, each within its own tolerance (length units).
    pub fn depth_of(&self, matches: &[Match], shape: &[Point3], sigmas: Vec<f64>) -> Boundary {
        Boundary {
            faces: matches.iter().map(|m| self.face(m)).collect(),
            barycentrics: matches.iter().map(|m| m.barycentric).collect(),
            depths: matches.iter().map(|m| self.point(m, shape).z).collect(),
            sigmas,
        }
    }

    /// Vertices that are not `visible` stay near `shape`, each by its share of the visible area.
    pub fn hidden(&self, visible: &[bool], shape: &[Point3]) -> AnchorPrior {
        let hidden: Vec<usize> = (0..shape.len()).filter(|&v| !visible[v]).collect();
        AnchorPrior {
            vertices: hidden.iter().map(|&v| [v as u32]).collect(),
            reference: hidden.iter().map(|&v| shape[v]).collect(),
            weights: hidden.iter().map(|&v| self.laplacian.mass[v] / self.visible_area).collect(),
            sigma: HIDDEN_SPREAD * self.radius(),
        }
    }

    /// Every ring turns as one, where that is the prior.
    pub fn arap(&self, prior: Prior) -> Option<Arap> {
        let arap = || Arap::new(&self.laplacian, &self.posed, self.visible_area);
        (prior == Prior::Arap).then(arap)
    }
}
