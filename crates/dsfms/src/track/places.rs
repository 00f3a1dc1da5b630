//! Places of the template that descriptors found in a frame, with what the frame showed there: they
//! are followed from it where the rendered template does not look like the frame. Nothing drifts:
//! every later match compares with that one frame, and the place is sought again before it is old.

use crate::camera::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, Vector2, normal, point_at};
use crate::image::Plane;
use crate::image::flow::{Pyramid, RADIUS, correlation, follow, settle};
use crate::mesh::Mesh;
use crate::register::Match;
use nalgebra::{Matrix2, Matrix3x2};
use std::sync::Arc;

/// Side of what is kept of a frame about a place, px of the working image: room for two sizes.
const SIDE: usize = 48;

/// Sizes of it that are followed through.
const LEVELS: usize = 2;

/// Frames for which a place is followed from where it was found.
pub(super) const OLD: usize = 60;

/// Frames for which a place that is not found is kept in mind: as long as an instrument passes.
const MISSED: usize = 12;

/// A patch that a motion changes by less than this is compared as it is, per px.
const TURNED: f64 = 0.03;

/// Motion that tells what stays in the image from what moves with the tissue, px of the working
/// image.
const TELLS: f64 = 2.0;

/// A place of the template and the frame that it was found in.
#[derive(Clone)]
pub(super) struct FollowedPlace {
    /// Where it is on the template, and the pixel at which the frame showed it.
    pub(super) found: Match,
    /// The frame's number.
    pub(super) frame: usize,
    /// The last frame in which the surface explained it.
    pub(super) held: usize,
    kept: Arc<KeptPatch>,
}

/// What a frame showed about a place.
struct KeptPatch {
    pyramid: Pyramid,
    /// The place in it.
    at: Point2,
    /// Its first pixel in the working image.
    corner: Vector2,
    /// `camera_from_template` of the frame.
    pose: Isometry,
}

impl FollowedPlace {
    /// A match at `pixel` of the working image; `None` too close to its border.
    pub(super) fn new(
        found: Match,
        pixel: Point2,
        working: &Plane,
        pose: Isometry,
        frame: usize,
    ) -> Option<Self> {
        let corner = |c: f64, n: usize| -> Option<usize> {
            let room = n.checked_sub(SIDE)?;
            Some(((c.round() as isize) - (SIDE / 2) as isize).clamp(0, room as isize) as usize)
        };
        let [w, h] = working.size;
        let (left, top) = (corner(pixel.x, w)?, corner(pixel.y, h)?);
        let at = Point2::new(pixel.x - left as f64, pixel.y - top as f64);
        let margin = f64::from(RADIUS) + 2.0;
        let inside = |c: f64| c >= margin && c < SIDE as f64 - 1.0 - margin;
        if !(inside(at.x) && inside(at.y)) {
            return None;
        }
        let row = |y: usize| &working.data[(top + y) * w + left..][..SIDE];
        let data = (0..SIDE).flat_map(|y| row(y).iter().copied()).collect();
        let pyramid = Pyramid::new(Plane { size: [SIDE; 2], data }, LEVELS);
        let kept = KeptPatch { pyramid, at, corner: Vector2::new(left as f64, top as f64), pose };
        Some(Self { found, frame, held: frame, kept: Arc::new(kept) })
    }

    /// The same place, which the surface of a frame explains.
    pub(super) fn held_at(self, frame: usize) -> Self {
        Self { held: frame, ..self }
    }

    /// Whether both are of one place in one frame.
    pub(super) fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.kept, &other.kept)
    }

    /// Whether it is worth following after frame `now`.
    pub(super) fn lasts(&self, now: usize) -> bool {
        now < self.frame + OLD && now <= self.held + MISSED
    }

    /// Where a frame shows it, and the correlation there; `None` where it does not settle. `start`
    /// is where it is expected and `turn` how the frame's patch comes of the kept one.
    pub(super) fn follow(
        &self,
        frame: &Pyramid,
        start: Point2,
        turn: Option<Matrix2<f64>>,
    ) -> Option<(Point2, f64)> {
        let KeptPatch { pyramid, at, .. } = &*self.kept;
        let turned = turn.filter(|t| (t - Matrix2::identity()).norm() > TURNED);
        let turned = turned.and_then(|turn| self.turned(&turn));
        let patch = turned.as_ref().unwrap_or(pyramid);
        let alike = |place: Point2| {
            Some((place, correlation(&patch.levels[0], *at, &frame.levels[0], place)?))
        };
        let near = settle(patch, frame, *at, start).and_then(alike);
        near.or_else(|| follow(patch, frame, *at, start).and_then(alike))
    }

    /// What was kept as another view shows it.
    fn turned(&self, turn: &Matrix2<f64>) -> Option<Pyramid> {
        let KeptPatch { pyramid, at, .. } = &*self.kept;
        let (back, most) = (turn.try_inverse()?, SIDE as f64 - 1.0);
        let value = |i: usize| {
            let to = Point2::new((i % SIDE) as f64, (i / SIDE) as f64);
            let from = at + back * (to - at);
            let from = Point2::new(from.x.clamp(0.0, most), from.y.clamp(0.0, most));
            pyramid.levels[0].sample(&from).map_or(0.0, |v| v.0 as f32)
        };
        let data = (0..SIDE * SIDE).map(value).collect();
        Some(Pyramid::new(Plane { size: [SIDE; 2], data }, LEVELS))
    }

    /// How the surroundings of the place in the image change from its frame to one of pose `now`:
    /// the linear part of the motion of its tangent plane. `None` where either looks along it.
    pub(super) fn turn(
        &self,
        camera: &CameraModel,
        rest: &Mesh,
        now: &Isometry,
    ) -> Option<Matrix2<f64>> {
        let corners @ [a, b, c] = rest.corners(self.found.face as usize);
        let point = point_at(corners, self.found.barycentric);
        let along = b - a;
        let plane = Matrix3x2::from_columns(&[along, normal(a, b, c)?.cross(&along)]);
        let of = |pose: &Isometry| -> Option<Matrix2<f64>> {
            let seen = camera.project(&(pose * point))?;
            Some(seen.jacobian * pose.rotation.to_rotation_matrix().matrix() * plane)
        };
        let turn = of(now)? * of(&self.kept.pose)?.try_inverse()?;
        let size = turn.determinant();
        (0.25..4.0).contains(&size).then_some(turn).filter(|t| t.norm() < 4.0)
    }

    /// Whether what a frame shows at a place is what the place's own frame showed there in the
    /// image, not what it showed of the tissue: a highlight. `false` too where they have not moved
    /// apart.
    pub(super) fn stays(&self, frame: &Plane, now: Point2) -> bool {
        let KeptPatch { pyramid, at, corner, .. } = &*self.kept;
        let was = Point2::from(at.coords + corner);
        stays(&pyramid.levels[0], *corner, was, frame, now)
    }
}

/// An earlier frame and its surface, by which highlights are told from what is pale.
pub(super) struct Earlier {
    pub(super) frame: usize,
    pub(super) pyramid: Arc<Pyramid>,
    pub(super) vertices: Vec<Point3>,
}

/// Whether a patch of a frame is more like an earlier frame (whose first pixel is at `corner`) at
/// the same place of the image than like it where the tissue was: what stays while the tissue moves
/// is a highlight. `false` where the tissue has moved too little to tell.
pub(super) fn stays(
    earlier: &Plane,
    corner: Vector2,
    was: Point2,
    frame: &Plane,
    now: Point2,
) -> bool {
    if (now - was).norm() < TELLS {
        return false;
    }
    let alike = |place: Point2| correlation(earlier, place - corner, frame, now).unwrap_or(-1.0);
    alike(now) > alike(was)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector3;
    use crate::synth::patch;

    const SIZE: [usize; 2] = [160, 120];

    /// Texture without period that moves and turns about the middle, and a bright spot that stays.
    fn picture(shift: Vector2, turn: f64, spot: Option<Point2>) -> Plane {
        let value = |i: usize| {
            let p = Point2::new((i % SIZE[0]) as f64, (i / SIZE[0]) as f64);
            let q = p - shift - Vector2::new(80.0, 60.0);
            let (s, c) = turn.sin_cos();
            let (x, y) = (c * q.x + s * q.y, c * q.y - s * q.x);
            let tissue = 0.5
                + 0.1
                    * ((0.41 * x).sin() * (0.37 * y + 0.05 * x).cos()
                        + (0.021 * x * y / 3.0).sin());
            let spot = spot.map_or(0.0, |s| 0.5 * (-(p - s).norm_squared() / 8.0).exp());
            (tissue + spot) as f32
        };
        Plane { size: SIZE, data: (0..SIZE[0] * SIZE[1]).map(value).collect() }
    }

    fn place(plane: &Plane, at: Point2) -> FollowedPlace {
        let found = Match { face: 0, barycentric: [1.0, 0.0, 0.0], pixel: at };
        FollowedPlace::new(found, at, plane, Isometry::translation(0.0, 0.0, 75.0), 1).unwrap()
    }

    #[test]
    fn a_place_is_followed_moved_and_turned() {
        let at = Point2::new(84.0, 57.0);
        let kept = place(&picture(Vector2::zeros(), 0.0, None), at);
        let angle = 0.5f64;
        let next = Pyramid::new(picture(Vector2::new(5.0, -3.0), angle, None), 2);
        let (s, c) = angle.sin_cos();
        let rotation = Matrix2::new(c, -s, s, c);
        let to =
            Point2::new(80.0, 60.0) + rotation * Vector2::new(4.0, -3.0) + Vector2::new(5.0, -3.0);
        let start = to + Vector2::new(2.0, 2.5);
        let (found, alike) = kept.follow(&next, start, Some(rotation)).unwrap();
        assert!((found - to).norm() < 0.15 && alike > 0.98, "{found} {to} {alike}");
        let plain = kept.follow(&next, start, None);
        assert!(plain.is_none_or(|(_, alike)| alike < 0.9), "{plain:?}");
    }

    #[test]
    fn a_highlight_stays_and_pale_texture_does_not() {
        let spot = Point2::new(80.0, 60.0);
        let shift = Vector2::new(4.0, 1.0);
        // Lit: the spot stays in the image. Pale: it moves with the texture.
        let before = picture(Vector2::zeros(), 0.0, Some(spot));
        let (lit, pale) =
            (picture(shift, 0.0, Some(spot)), picture(shift, 0.0, Some(spot + shift)));
        let kept = place(&before, spot);
        assert!(kept.stays(&lit, spot + shift * 0.6) && !kept.stays(&pale, spot + shift));
        assert!(!kept.stays(&lit, spot + Vector2::new(0.5, 0.5)), "too little to tell");
    }

    #[test]
    fn the_turn_of_a_motion_and_how_long_a_place_lasts() {
        let plane = picture(Vector2::zeros(), 0.0, None);
        let kept = place(&plane, Point2::new(80.0, 60.0));
        let mesh = patch(100, 1).mesh;
        let lens = crate::camera::Lens::Pinhole;
        let camera = CameraModel { size: SIZE, focal: [150.0; 2], centre: [79.5, 59.5], lens };
        let now =
            |turn: f64, z| Isometry::new(Vector3::new(0.0, 0.0, z), Vector3::new(0.0, 0.0, turn));
        let same = kept.turn(&camera, &mesh, &now(0.0, 75.0)).unwrap();
        assert!((same - Matrix2::identity()).norm() < 1e-9, "{same}");
        // Areas in the image go with the inverse square of depth.
        let z = point_at(mesh.corners(kept.found.face as usize), kept.found.barycentric).z;
        let nearer = kept.turn(&camera, &mesh, &now(0.0, 37.5)).unwrap();
        let expected = ((z + 75.0) / (z + 37.5)).powi(2);
        assert!((nearer.determinant() / expected - 1.0).abs() < 0.3, "{nearer} {expected} {z}");
        assert!(kept.lasts(5) && !kept.lasts(1 + MISSED + 1));
        assert!(!FollowedPlace { held: OLD, ..kept }.lasts(1 + OLD));
        assert!(
            FollowedPlace::new(
                Match { face: 0, barycentric: [1.0, 0.0, 0.0], pixel: Point2::origin() },
                Point2::new(4.0, 60.0),
                &plane,
                Isometry::identity(),
                1
            )
            .is_none()
        );
    }
}
