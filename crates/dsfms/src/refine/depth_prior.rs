//! What holds depth in the joint solve: the pose that the matches give.
//!
//! Motion and conformality leave the distance of a surface to its stretch, and a near light tells
//! it only as well as albedo, exposure and fall-off are known. Tissue that the rigid pose explains
//! is where the pose puts it.

use super::joint_options::JointOptions;
use crate::camera::Camera;
use crate::energy::Boundary;
use crate::geometry::{Neighbours, Point3, Vector2};
use crate::light::LightModel;
use crate::register::pose::rest_point;
use crate::register::{Match, Scene};
use rayon::prelude::*;

/// Neighbours that a match shares its motion with: few, for a tool moves a small place
/// (`docs/results/choices.md`, what fixes the distance).
const NEIGHBOURS: usize = 4;

/// The depth of the matches held to the rest shape where they pose it (camera axes); `depth_sigma`
/// is eq. 3's tolerance. `slack`: how much looser than where nothing is known of the exposure,
/// since brightness tells the distance from a near light as well as the exposure is known.
pub(super) fn depth_prior(
    scene: &Scene,
    matches: &[Match],
    posed: &[Point3],
    depth_sigma: f64,
    light: &LightModel,
    options: &JointOptions,
    slack: f64,
) -> Boundary {
    let sigmas = if light.tells_distance() {
        let calm = slack * options.near_depth_hold * scene.radius();
        let motions = shared_motions(scene, matches, posed).into_iter();
        motions.map(|m| calm.hypot(options.near_depth_motion * m)).collect()
    } else {
        vec![depth_sigma; matches.len()]
    };
    scene.depth_of(matches, posed, sigmas)
}

/// Motion of every match that its neighbours share and the pose does not explain, length units:
/// root mean product of their offsets. Noise and wrong matches share nothing with their neighbours.
pub(super) fn shared_motions(scene: &Scene, matches: &[Match], posed: &[Point3]) -> Vec<f64> {
    let [fx, fy] = scene.camera.focal;
    let offset = |m: &Match| {
        let point = scene.point(m, posed);
        let seen = scene.camera.project(&point)?.pixel;
        Some((m.pixel - seen) * (point.z / (0.5 * (fx + fy))))
    };
    let offsets: Vec<Vector2> = matches.iter().map(|m| offset(m).unwrap_or_default()).collect();
    let places = matches.iter().map(|m| rest_point(scene.rest, m).coords.into()).collect();
    let places = Neighbours::of(places);
    (0..offsets.len()).into_par_iter().map(|i| shared_motion(i, &offsets, &places)).collect()
}

fn shared_motion(i: usize, offsets: &[Vector2], places: &Neighbours<3>) -> f64 {
    let near = places.nearest(i, NEIGHBOURS);
    let products: f64 = near.iter().map(|&j| offsets[j].dot(&offsets[i])).sum();
    (products / near.len().max(1) as f64).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_match_moves_with_its_neighbours_or_alone() {
        // A grid of which the left half moved by (3, 4), and one wrong match on the right.
        let place = |i: usize| {
            let (x, y) = ((i % 10) as f64, (i / 10) as f64);
            let left = if x < 5.0 { Vector2::new(3.0, 4.0) } else { Vector2::zeros() };
            ([x, y, 0.0], if i == 57 { Vector2::new(50.0, 0.0) } else { left })
        };
        let (places, offsets): (Vec<[f64; 3]>, Vec<Vector2>) = (0..100).map(place).unzip();
        let alone = shared_motion(0, &offsets[..1], &Neighbours::of(places[..1].to_vec()));
        let places = Neighbours::of(places);
        let at = |i: usize| shared_motion(i, &offsets, &places);
        assert!((at(52) - 5.0).abs() < 1e-12);
        assert_eq!((at(57), at(58)), (0.0, 0.0));
        assert_eq!(alone, 0.0);
        // On the seam: one of four neighbours stayed.
        assert!((at(54) - 75_f64.sqrt() / 2.0).abs() < 1e-12);
    }
}
