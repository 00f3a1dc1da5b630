//! What the frames say of a point of the grid.

use super::depth_map::DepthMap;
use crate::camera::{Camera, PosedFrame};
use crate::geometry::Point3;
use crate::image::{Plane, distance::distance_to, within_centres};

/// Weight of free space against that of the surface itself.
const FREE_SPACE: f64 = 0.2;
/// One in this many pictures that hold a point, rounded down, must see the space there as free:
/// wrong depths on bare tissue agree in a few frames, and dig pits. From one in five to two in
/// three a faintly textured scene is much the same (`docs/results/template.md`); of fewer than
/// twice as many pictures one is enough.
const FREE_ONE_IN: usize = 4;
/// Least trust in what four pixels say together: a lone pixel among such that no other frame
/// confirms (trust of 0.15 at most) is one of them. From 0.16 to 0.3 two scenes are the same.
const LEAST_TRUST: f64 = 0.2;
/// A pixel says nothing about points farther behind it than this many truncation distances, however
/// grazing its plane.
const MAX_BEHIND: f64 = 4.0;
/// Distances that differ by no more, in truncation distances, are of one surface.
const SAME_LAYER: f64 = 0.5;
/// An outline is believed to this many px.
const OUTLINE_PX: f64 = 1.0;
/// Distance, in truncation distances, from which on a point lies in free space.
const FREE: f64 = 0.99;
/// Trust in an outline, where trust of a frame in a surface it faces is at most 1.
const OUTLINE_TRUST: f64 = 1.0;

/// A signed distance (in truncation distances) and the trust in it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DistanceEvidence {
    pub distance: f32,
    pub weight: f32,
    /// The distance is known to be at least this.
    pub bound: bool,
}

/// A depth map, and the outline that bounds the organ.
pub(super) struct ObservedView<'a> {
    map: &'a DepthMap,
    posed: &'a PosedFrame<'a>,
    /// Distance of every pixel from the organ, px.
    organ: Option<Plane>,
}

impl<'a> ObservedView<'a> {
    pub(super) fn new(posed: &'a PosedFrame<'a>, map: &'a DepthMap) -> Self {
        Self { map, posed, organ: posed.organ.map(distance_to) }
    }

    /// Distance of a point from the cone of the organ's outline; `None` within, or where no usable
    /// pixel shows it.
    fn outside(&self, point: &Point3) -> Option<f64> {
        let organ = self.organ.as_ref()?;
        let p = self.posed.pose * point;
        let pixel = self.posed.camera.project(&p)?.pixel;
        let inside = within_centres(&pixel, self.posed.camera.size);
        if !inside || self.posed.valid.is_some_and(|m| !m.at_pixel(&pixel)) {
            return None;
        }
        let away = organ.at(pixel.x.round() as usize, pixel.y.round() as usize);
        let away = f64::from(away) - OUTLINE_PX;
        (away > 0.0).then(|| away * p.z / self.posed.camera.focal[0])
    }

    /// Where a point (camera axes) lies on the map; `None` beside it.
    fn on_map(&self, p: &Point3) -> Option<[f64; 2]> {
        let camera = &self.map.camera;
        let [w, h] = camera.size;
        let u = camera.focal[0] * p.x / p.z + camera.centre[0];
        let v = camera.focal[1] * p.y / p.z + camera.centre[1];
        let inside = u >= -0.5 && v >= -0.5 && u < w as f64 - 0.5 && v < h as f64 - 0.5;
        (p.z > 0.0 && inside).then_some([u, v])
    }

    /// What the frame says of a point; `None` where it sees no depth or something in front of it.
    fn observe(&self, point: &Point3, truncation: f64) -> Option<PlaneDistance> {
        let m = self.map;
        let p = m.pose * point;
        let [u, v] = self.on_map(&p)?;
        let [w, h] = m.camera.size;
        let mut sum = PlaneDistance::default();
        let mut share = 0.0;
        for (i, j) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (x, y) = (u.floor() + i, v.floor() + j);
            if x < 0.0 || y < 0.0 || x >= w as f64 || y >= h as f64 {
                continue;
            }
            let bilinear = (1.0 - (u - x).abs()) * (1.0 - (v - y).abs());
            let pixel = y as usize * w + x as usize;
            if m.depth[pixel] > 0.0 {
                sum.add(bilinear, tangent_plane(m, pixel, [x, y], &p));
                share += bilinear;
            }
        }
        (share >= 0.25).then(|| sum.truncated(share, truncation)).flatten()
    }
}

/// Signed distance from the plane of a pixel, its weight in the mean, and trust that a surface is
/// there.
#[derive(Clone, Copy, Default)]
pub(super) struct PlaneDistance {
    distance: f64,
    weight: f64,
    support: f64,
    /// How far the point lies behind the pixel's surface along the optical axis.
    behind: f64,
}

impl PlaneDistance {
    fn add(&mut self, share: f64, other: Self) {
        self.distance += share * other.distance;
        self.weight += share * other.weight;
        self.support += share * other.support;
        self.behind += share * other.behind;
    }

    /// The point lies before the surface by a truncation distance or more.
    fn is_free(&self) -> bool {
        self.distance >= 1.0
    }

    /// Divide by the share of pixels that had depth; `None` for points hidden by the surface. What
    /// is not trusted enough has no weight.
    fn truncated(self, share: f64, truncation: f64) -> Option<Self> {
        let [distance, weight, support, behind] =
            [self.distance, self.weight, self.support, self.behind].map(|v| v / share);
        let distance = distance / truncation;
        if distance < -1.0 || behind > MAX_BEHIND * truncation {
            return None;
        }
        let weight = if support < LEAST_TRUST { 0.0 } else { weight };
        if distance > 1.0 {
            return Some(Self { distance: 1.0, weight: FREE_SPACE * weight, support: 0.0, behind });
        }
        Some(Self { distance, weight, support, behind })
    }
}

/// A point (camera axes) against the plane of pixel `i`: what is seen at a grazing angle weighs
/// less.
fn tangent_plane(m: &DepthMap, i: usize, [x, y]: [f64; 2], p: &Point3) -> PlaneDistance {
    let z = m.depth[i] as f64;
    let on = [
        (x - m.camera.centre[0]) / m.camera.focal[0] * z,
        (y - m.camera.centre[1]) / m.camera.focal[1] * z,
        z,
    ];
    let n = m.normal[i].map(|c| c as f64);
    let distance = n[0] * (p.x - on[0]) + n[1] * (p.y - on[1]) + n[2] * (p.z - on[2]);
    let length = (on[0] * on[0] + on[1] * on[1] + on[2] * on[2]).sqrt();
    let facing = -(n[0] * on[0] + n[1] * on[1] + n[2] * on[2]) / length;
    let support = m.confidence[i] as f64;
    PlaneDistance { distance, weight: support * facing * facing, support, behind: p.z - z }
}

/// What the frames say of a point, and their support. `seen` is room for it.
pub(super) fn average(
    views: &[ObservedView],
    point: &Point3,
    truncation: f64,
    seen: &mut Vec<PlaneDistance>,
) -> (DistanceEvidence, f32) {
    seen.clear();
    seen.extend(views.iter().filter_map(|v| v.observe(point, truncation)));
    forget_doubtful_space(views, point, seen);
    let support: f64 = seen.iter().map(|s| s.support).sum();
    let outside = outside(views, point) / truncation;
    let found = robust_distance(seen);
    let (distance, weight) = found.unwrap_or((1.0, 0.0));
    if outside > 0.0 && (found.is_none() || distance < outside) {
        // Stereo that contradicts an outline weakly is wrong; else the outline may be.
        let sum = weight + OUTLINE_TRUST;
        let blend = (weight * distance + OUTLINE_TRUST * outside.min(1.0)) / sum;
        let bound = weight < OUTLINE_TRUST;
        return (DistanceEvidence { distance: blend as f32, weight: sum as f32, bound }, 0.0);
    }
    let bound = distance > FREE;
    (DistanceEvidence { distance: distance as f32, weight: weight as f32, bound }, support as f32)
}

/// Leave out that space is free where too few of the pictures that hold the point see it so.
fn forget_doubtful_space(views: &[ObservedView], point: &Point3, seen: &mut Vec<PlaneDistance>) {
    let free = seen.iter().filter(|s| s.weight > 0.0 && s.is_free()).count();
    // Most space is seen as free by enough of all pictures, and which ones hold it does not matter.
    if free == 0 || free >= views.len() / FREE_ONE_IN {
        return;
    }
    let pictures = views.iter().filter(|v| v.on_map(&(v.map.pose * point)).is_some()).count();
    if free < pictures / FREE_ONE_IN {
        seen.retain(|s| !s.is_free());
    }
}

/// How far the point lies outside the organ's outline: the second largest distance from the cones
/// of the outlines, as one outline may be wrong; of few frames each counts.
fn outside(views: &[ObservedView], point: &Point3) -> f64 {
    let mut largest = [0.0f64; 2];
    for distance in views.iter().filter_map(|v| v.outside(point)) {
        if distance > largest[0] {
            largest = [distance, largest[0]];
        } else if distance > largest[1] {
            largest[1] = distance;
        }
    }
    largest[usize::from(views.len() > 4)]
}

/// Weighted mean of the distances within [`SAME_LAYER`] of their weighted median, and their weight:
/// a depth map that is wrong here must not shift the others. Sorts the observations.
fn robust_distance(seen: &mut Vec<PlaneDistance>) -> Option<(f64, f64)> {
    seen.retain(|s| s.weight > 0.0);
    seen.sort_unstable_by(|a, b| {
        a.distance.total_cmp(&b.distance).then(a.weight.total_cmp(&b.weight))
    });
    let half = 0.5 * seen.iter().map(|s| s.weight).sum::<f64>();
    let mut passed = 0.0;
    let median = seen.iter().find(|s| {
        passed += s.weight;
        passed >= half
    })?;
    let median = median.distance;
    let near = seen.iter().filter(|s| (s.distance - median).abs() <= SAME_LAYER);
    let (sum, weight) =
        near.fold((0.0, 0.0), |(sum, weight), s| (sum + s.weight * s.distance, weight + s.weight));
    (weight > 0.0).then(|| (sum / weight, weight))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::geometry::Isometry;
    use crate::image::{Frame, Mask};

    const SIZE: [usize; 2] = [40, 30];
    /// Truncation distance.
    const T: f64 = 2.0;

    fn camera() -> CameraModel {
        CameraModel::pinhole(SIZE, [50.0; 2], [19.5, 14.5])
    }

    fn frame() -> Frame {
        Frame { name: "f".into(), size: SIZE, rgb: vec![[90; 3]; SIZE[0] * SIZE[1]] }
    }

    /// A wall across the view at this depth, trusted by half.
    fn wall(depth: f32) -> DepthMap {
        let n = SIZE[0] * SIZE[1];
        DepthMap {
            camera: camera(),
            pose: Isometry::identity(),
            depth: vec![depth; n],
            normal: vec![[0.0, 0.0, -1.0]; n],
            sigma: vec![0.1; n],
            confidence: vec![0.5; n],
        }
    }

    /// What walls at these depths say of a point, inside an outline if there is one.
    fn said(depths: &[f32], organ: Option<&Mask>, point: Point3) -> (DistanceEvidence, f32) {
        let (frame, camera) = (frame(), camera());
        let posed = PosedFrame {
            frame: &frame,
            camera: &camera,
            pose: Isometry::identity(),
            valid: None,
            organ,
        };
        let maps: Vec<DepthMap> = depths.iter().map(|&d| wall(d)).collect();
        let views: Vec<ObservedView> =
            maps.iter().map(|map| ObservedView::new(&posed, map)).collect();
        average(&views, &point, T, &mut Vec::new())
    }

    #[test]
    fn a_wall_is_measured_before_and_behind() {
        for (z, distance) in [(49.0, 0.5), (50.0, 0.0), (51.5, -0.75)] {
            let (found, support) = said(&[50.0], None, Point3::new(3.0, -2.0, z));
            assert!((f64::from(found.distance) - distance).abs() < 1e-5, "{found:?}");
            assert!(!found.bound && (support - 0.5).abs() < 1e-6);
        }
        let (free, support) = said(&[50.0], None, Point3::new(0.0, 0.0, 30.0));
        assert!(free.bound && free.distance == 1.0 && free.weight > 0.0 && support == 0.0);
        // Hidden, beside the picture, behind the camera: nothing is said.
        for point in [[0.0, 0.0, 53.0], [60.0, 0.0, 50.0], [0.0, 0.0, -50.0]] {
            let (nothing, _) = said(&[50.0], None, Point3::from(point));
            assert_eq!((nothing.distance, nothing.weight), (1.0, 0.0), "{point:?}");
        }
    }

    #[test]
    fn a_depth_map_that_is_wrong_does_not_shift_the_others() {
        let (found, _) = said(&[50.0, 50.2, 51.9], None, Point3::new(0.0, 0.0, 50.0));
        // (0 + 0.1) / 2: the third lies nearly a truncation distance off.
        assert!((found.distance - 0.05).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn free_space_is_believed_where_enough_pictures_see_it() {
        // The walls at 0 are maps without depth: their pictures hold the point all the same.
        let at = Point3::new(0.0, 0.0, 30.0);
        let of_eight = |seeing: &[f32]| {
            let mut depths = [0.0; 8];
            depths[..seeing.len()].copy_from_slice(seeing);
            said(&depths, None, at).0
        };
        let one = of_eight(&[50.0]);
        assert_eq!((one.distance, one.weight), (1.0, 0.0));
        let two = of_eight(&[50.0, 50.0]);
        assert!(two.bound && two.weight > 0.0, "{two:?}");
        let (of_few, _) = said(&[50.0, 0.0, 0.0], None, at);
        assert!(of_few.bound && of_few.weight > 0.0, "{of_few:?}");
        // The surface itself is no matter of shares.
        let found = of_eight(&[30.0]);
        assert!(found.weight > 0.0 && found.distance == 0.0, "{found:?}");
    }

    #[test]
    fn what_no_other_frame_confirms_says_nothing() {
        let (frame, camera) = (frame(), camera());
        let (organ, valid, pose) = (None, None, Isometry::identity());
        let posed = PosedFrame { frame: &frame, camera: &camera, pose, valid, organ };
        let n = SIZE[0] * SIZE[1];
        let alone = DepthMap { confidence: vec![0.15; n], ..wall(51.0) };
        let at = Point3::new(0.0, 0.0, 50.0);
        let of = |maps: &[DepthMap]| {
            let views: Vec<_> = maps.iter().map(|map| ObservedView::new(&posed, map)).collect();
            average(&views, &at, T, &mut Vec::new()).0
        };
        assert_eq!(of(std::slice::from_ref(&alone)).weight, 0.0);
        let (sure, both) = (of(&[wall(50.0)]), of(&[wall(50.0), alone]));
        assert_eq!((sure.distance, sure.weight), (both.distance, both.weight));
    }

    #[test]
    fn an_outline_bounds_what_lies_outside() {
        let mut organ = Mask::filled(SIZE, false);
        for y in 0..SIZE[1] {
            (0..20).for_each(|x| organ.data[y * SIZE[0] + x] = true);
        }
        // Column 27 is 8 px from the organ's last, less one px of doubt, at 30 units: 4.2 units.
        let off = Point3::new(7.5 / 50.0 * 30.0, 0.0, 30.0);
        let (found, support) = said(&[], Some(&organ), off);
        assert_eq!((found.weight, support), (0.0, 0.0), "no view, no outline");
        let (found, support) = said(&[0.0], Some(&organ), off);
        assert!(found.bound && found.distance == 1.0 && support == 0.0, "{found:?}");
        let near = Point3::new(2.5 / 50.0 * 30.0, 0.0, 30.0);
        let (found, _) = said(&[0.0], Some(&organ), near);
        // Column 22: 3 px less one, 1.2 units.
        assert!(found.bound && (found.distance - 0.6).abs() < 1e-4, "{found:?}");
        let (inside, _) = said(&[0.0], Some(&organ), Point3::new(-5.0, 0.0, 30.0));
        assert_eq!(inside.weight, 0.0);
        // Of five outlines one may be wrong.
        let frame = frame();
        let camera = camera();
        let whole = Mask::filled(SIZE, true);
        let posed = |organ| PosedFrame {
            frame: &frame,
            camera: &camera,
            pose: Isometry::identity(),
            valid: None,
            organ: Some(organ),
        };
        let (one, map) = ([posed(&organ), posed(&whole)], wall(0.0));
        let views: Vec<ObservedView> =
            (0..5).map(|i| ObservedView::new(&one[usize::from(i > 0)], &map)).collect();
        assert_eq!(outside(&views, &near), 0.0);
        assert!((outside(&views[..4], &near) - 1.2).abs() < 1e-4);
    }
}
