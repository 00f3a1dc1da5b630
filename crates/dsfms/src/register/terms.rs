//! The terms that eq. 3 shares with the solves that use shading.

use super::{Match, Prior, Scene};
use crate::camera::CameraModel;
use crate::energy::{
    Anisotropy, Arap, Boundary, Isometric, Motion, Objective, Shearing, Stay, Stretch,
};
use crate::geometry::Point3;
use crate::solver::Loss;

/// What the surface keeps of its rest shape, with the loss of its strains; the second weight is that
/// of stretch and counts for the conformal prior alone.
pub fn keep<'a>(
    objective: Objective<'a>,
    scene: &'a Scene,
    prior: Prior,
    loss: Loss,
    [weight, stretch]: [f64; 2],
) -> Objective<'a> {
    let rest = &scene.faces;
    match prior {
        Prior::Conformal => objective
            .plus(weight, loss, Shearing { rest })
            .plus(weight, loss, Anisotropy { rest })
            .plus(stretch, loss, Stretch { rest }),
        Prior::Isometric => objective.plus(weight, loss, Isometric { rest }),
        Prior::Arap => {
            let arap = Arap::new(&scene.laplacian, &scene.posed, scene.visible_area);
            objective.plus(weight, loss, arap)
        }
    }
}

/// The motion term of a scene.
pub fn motion<'a>(scene: &Scene<'a>, matches: &[Match], sigma_px: f64) -> Motion<'a, CameraModel> {
    Motion {
        camera: scene.camera,
        faces: matches.iter().map(|m| scene.face(m)).collect(),
        barycentrics: matches.iter().map(|m| m.barycentric).collect(),
        pixels: matches.iter().map(|m| m.pixel).collect(),
        sigma_px,
    }
}

/// The depth of the matches held to that of a shape, each within its own tolerance (length units).
pub fn hold_depth(
    scene: &Scene,
    matches: &[Match],
    shape: &[Point3],
    sigmas: Vec<f64>,
) -> Boundary {
    Boundary {
        faces: matches.iter().map(|m| scene.face(m)).collect(),
        barycentrics: matches.iter().map(|m| m.barycentric).collect(),
        depths: matches.iter().map(|m| scene.point(m, shape).z).collect(),
        sigmas,
    }
}

/// Hidden vertices held to the rigid pose, each by its share of the visible area, within a
/// twenty-fifth of the visible radius.
pub fn stay(scene: &Scene) -> Stay {
    let hidden: Vec<usize> = (0..scene.posed.len()).filter(|&v| !scene.visible[v]).collect();
    Stay {
        vertices: hidden.iter().map(|&v| [v as u32]).collect(),
        reference: hidden.iter().map(|&v| scene.posed[v]).collect(),
        weights: hidden.iter().map(|&v| scene.laplacian.mass[v] / scene.visible_area).collect(),
        sigma: 0.04 * scene.radius(),
    }
}
