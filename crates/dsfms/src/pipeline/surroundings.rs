//! The camera by what lies around the organ and does not deform.

use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3, median};
use crate::mesh::Mesh;
use crate::register::find::NEEDED;
use crate::register::pose::rest_point;
use crate::register::{Match, RegisterOptions, pose_near};
use crate::verdict::observability::pose_uncertainty;

/// How far the pose may leave the organ's place open, of its distance: tissue that stretches by 3 %
/// is read as a distance that is 3 % shorter, and this must be known better.
const OPEN: f64 = 0.01;

/// Points of the organ by which that is told, at most.
const ASKED: usize = 50;

/// The camera in one frame as what lies around the organ shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSight {
    /// `camera_from_template`, wherever the organ is.
    pub pose: Isometry,
    /// Matches on the surroundings that agree with it.
    pub matches: usize,
    /// Their median distance, px.
    pub residual_px: f64,
    /// How uncertain it leaves the place of an organ at rest, length units (standard deviation).
    pub uncertainty: f64,
}

/// A pose is another than what the surroundings show if it moves the organ by more than so many
/// standard deviations.
const APART: f64 = 3.0;

impl CameraSight {
    /// Whether a pose of the organ is not that of the camera: the organ has moved or stretched as a
    /// whole, or its matches are wrong. Where both agree, that of the organ has more matches and is
    /// the better one.
    pub(crate) fn contradicts(&self, pose: &Isometry, organ: &Mesh) -> bool {
        let points: Vec<Point3> = some_of(organ).collect();
        let moved: f64 = points.iter().map(|p| (pose * p - self.pose * p).norm()).sum();
        moved > APART * self.uncertainty * points.len() as f64
    }
}

/// Points of the organ that tell where it is.
fn some_of(organ: &Mesh) -> impl Iterator<Item = Point3> {
    let step = organ.positions.len().div_ceil(ASKED).max(1);
    organ.positions.iter().step_by(step).copied()
}

/// The camera near a pose by matches on the surroundings, and which of them agree; `None` where
/// they leave the place of the organ (`organ`: its rest shape) open.
pub(crate) fn sighted(
    camera: &CameraModel,
    [organ, around]: [&Mesh; 2],
    matches: &[Match],
    start: Isometry,
    options: &RegisterOptions,
) -> Option<(CameraSight, Vec<bool>)> {
    let points: Vec<Point3> = matches.iter().map(|m| rest_point(around, m)).collect();
    let pixels: Vec<Point2> = matches.iter().map(|m| m.pixel).collect();
    let posed = pose_near(camera, &points, &pixels, options, start).ok()?;
    let agree: Vec<bool> = posed.residuals_px.iter().map(|&r| r <= options.robust_px[1]).collect();
    let agreeing = (0..matches.len()).filter(|&i| agree[i]);
    let (kept, mut left): (Vec<Match>, Vec<f64>) =
        agreeing.map(|i| (matches[i], posed.residuals_px[i])).unzip();
    if kept.len() < NEEDED {
        return None;
    }
    let residual_px = median(&mut left)?;
    let pose = posed.pose;
    let shape: Vec<Point3> = around.positions.iter().map(|p| pose * p).collect();
    let asked: Vec<Point3> = some_of(organ).map(|p| pose * p).collect();
    let away = asked.iter().map(|p| p.coords.norm()).sum::<f64>() / asked.len().max(1) as f64;
    let open = pose_uncertainty(camera, &around.topology, &shape, &kept, residual_px, &asked);
    let sight = CameraSight { pose, matches: kept.len(), residual_px, uncertainty: open.length };
    (open.length <= OPEN * away).then_some((sight, agree))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector3;
    use crate::synth::{Draw, Random, correspond, patch};

    fn camera() -> CameraModel {
        CameraModel::pinhole([640, 480], [600.0; 2], [319.5, 239.5])
    }

    /// A wall three times as large as the organ before it, and matches on the part of it that
    /// `which` names (wall's axes).
    fn seen(which: impl Fn(&Point3) -> bool) -> ([Mesh; 2], Isometry, Vec<Match>) {
        let organ = patch(1500, 3).mesh;
        let wall = organ.positions.iter().map(|p| Point3::new(3.0 * p.x, 3.0 * p.y, p.z + 15.0));
        let wall = organ.with_positions(wall.collect());
        let pose = Isometry::new(Vector3::new(2.0, -1.0, 80.0), Vector3::new(0.15, -0.2, 0.05));
        let shape: Vec<Point3> = wall.positions.iter().map(|p| pose * p).collect();
        let named: Vec<bool> = wall.positions.iter().map(which).collect();
        let draw = Draw { count: 60, sigma_px: 0.5 };
        let matches = correspond(&camera(), &wall, &shape, &named, draw, &mut Random::new(1, 2));
        ([organ, wall], pose, matches)
    }

    #[test]
    fn the_wall_tells_where_the_camera_is_and_how_well() {
        let ([organ, wall], pose, mut matches) = seen(|_| true);
        // Wrong ones.
        matches.iter_mut().step_by(10).for_each(|m| m.pixel.x += 25.0);
        let start = Isometry::translation(0.5, -0.4, 1.0) * pose;
        let (sight, agree) =
            sighted(&camera(), [&organ, &wall], &matches, start, &RegisterOptions::default())
                .unwrap();
        assert!((0..matches.len()).all(|i| agree[i] == (i % 10 != 0)));
        assert_eq!(sight.matches, 54);
        let off = |pose: &Isometry| {
            let all = organ.positions.iter().map(|p| (pose * p - sight.pose * p).norm());
            all.sum::<f64>() / organ.positions.len() as f64
        };
        assert!(off(&pose) < 2.0 * sight.uncertainty && sight.uncertainty < 0.3, "{sight:?}");
        assert!(!sight.contradicts(&pose, &organ) && sight.contradicts(&start, &organ));
    }

    #[test]
    fn a_small_patch_of_the_wall_leaves_the_camera_open() {
        let ([organ, wall], pose, matches) = seen(|p| p.x.hypot(p.y) < 5.0);
        assert!(matches.len() >= NEEDED);
        let options = RegisterOptions::default();
        assert!(sighted(&camera(), [&organ, &wall], &matches, pose, &options).is_none());
        let few = &matches[..NEEDED - 1];
        assert!(sighted(&camera(), [&organ, &wall], few, pose, &options).is_none());
    }
}
