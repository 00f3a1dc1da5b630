//! From features of registered frames to features of the surface.
//!
//! A keypoint of a frame lies on the face that the frame's z-buffer shows at its pixel. The same
//! spot, seen in several frames, gives several features; those that lie within a pixel of each
//! other and look alike are merged, and of the rest the best spread ones are kept.

use super::Features;
use crate::camera::{Camera, CameraModel, PosedFrame};
use crate::geometry::{Point2, Point3, Vector3, area_normal, point_at};
use crate::mesh::Mesh;
use crate::options::{OptionError, check, from_zero};
use crate::raster::{Raster, rasterize};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Keypoints of one registered frame.
#[derive(Clone, Copy, Debug)]
pub struct FeatureView<'a> {
    /// The frame, `camera_from_template`; keypoints outside its masks are left out.
    pub posed: PosedFrame<'a>,
    /// Positions, px.
    pub points: &'a [Point2],
    /// One per position.
    pub descriptors: &'a [[u8; 128]],
}

/// Options of [`anchor_features`]. Other values are not measured but for `least_views` of the
/// surroundings (`docs/results/track.md`, the camera by what lies around the organ).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AnchorOptions {
    /// Largest number of features kept.
    pub max_features: usize,
    /// Features closer than this many pixels of the nearest view on the surface may be the same.
    pub merge_px: f64,
    /// Largest angle in degrees between descriptors of the same feature.
    pub merge_deg: f64,
    /// Views that show a feature in one place of the surface, at least: a highlight moves over it.
    pub least_views: usize,
    /// Distance from predicted contours, px.
    pub contour_px: f64,
    /// Smallest cosine between normal and sightline.
    pub grazing_cos: f64,
}

impl Default for AnchorOptions {
    fn default() -> Self {
        Self {
            max_features: 20_000,
            merge_px: 1.5,
            merge_deg: 25.0,
            least_views: 1,
            contour_px: 3.0,
            grazing_cos: 0.2,
        }
    }
}

impl AnchorOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[(
            "anchor.merge_px, merge_deg, contour_px, grazing_cos",
            from_zero(&[self.merge_px, self.merge_deg, self.contour_px, self.grazing_cos]),
            "0 or more",
        )])
    }
}

/// A keypoint on the surface.
struct FeatureAnchor {
    face: u32,
    barycentric: [f64; 3],
    point: Point3,
    descriptor: [u8; 128],
    /// Length of a pixel there.
    footprint: f64,
    /// How squarely it was seen.
    cosine: f64,
    /// The views that show it.
    views: BTreeSet<usize>,
}

/// Attach keypoints to the surface; features follow in order of how squarely they were seen within
/// each cell of an even spread. Keypoints off the surface, near its contours or seen at a grazing
/// angle are left out; `points` and `descriptors` are read up to the shorter.
pub fn anchor_features(mesh: &Mesh, views: &[FeatureView], options: &AnchorOptions) -> Features {
    let of = |(number, view)| anchors_of(mesh, number, view, options);
    let mut anchors: Vec<_> = views.iter().enumerate().flat_map(of).collect();
    // Stable: equal cosines keep the order of the views.
    anchors.sort_by(|a, b| b.cosine.total_cmp(&a.cosine));
    let mut merged = merge(anchors, options);
    merged.retain(|anchor| anchor.views.len() >= options.least_views);
    let kept = spread(merged, options.max_features);
    Features {
        descriptors: kept.iter().map(|a| a.descriptor).collect(),
        faces: kept.iter().map(|a| a.face).collect(),
        barycentrics: kept.iter().map(|a| a.barycentric).collect(),
    }
}

fn anchors_of(
    mesh: &Mesh,
    number: usize,
    view: &FeatureView,
    options: &AnchorOptions,
) -> Vec<FeatureAnchor> {
    let PosedFrame { camera, pose, valid, organ, .. } = view.posed;
    let positions: Vec<_> = mesh.positions.iter().map(|p| pose * p).collect();
    let raster = rasterize(camera, &mesh.topology, &positions);
    let contour = raster.discontinuities(0.02).dilate(options.contour_px);
    let posed = mesh.with_positions(positions);
    let masks = [valid, organ];
    let usable =
        |p: &Point2| !contour.at_pixel(p) && masks.iter().flatten().all(|mask| mask.at_pixel(p));
    view.points
        .iter()
        .zip(view.descriptors)
        .filter(|(pixel, _)| usable(pixel))
        .filter_map(|(pixel, descriptor)| {
            let (face, barycentric) = sub_pixel(&raster, &posed, camera, pixel)?;
            let corners = posed.corners(face as usize);
            let point = point_at(corners, barycentric);
            let [a, b, c] = corners;
            let normal = area_normal(a, b, c).try_normalize(0.0)?;
            let cosine = -normal.dot(&point.coords) / point.coords.norm();
            (cosine >= options.grazing_cos).then(|| FeatureAnchor {
                face,
                barycentric,
                point: point_at(mesh.corners(face as usize), barycentric),
                descriptor: *descriptor,
                footprint: point.z / camera.focal[0],
                cosine,
                views: BTreeSet::from([number]),
            })
        })
        .collect()
}

/// Face and barycentrics where the sightline of a pixel, not of its nearest centre, meets the
/// surface: on the face of the nearest centre, or on one that shares a vertex with it.
fn sub_pixel(
    raster: &Raster,
    posed: &Mesh,
    camera: &CameraModel,
    pixel: &Point2,
) -> Option<(u32, [f64; 3])> {
    let (nearest, fallback) = raster.surface_at(pixel)?;
    let ray = camera.unproject(pixel)?;
    let ring = posed.topology.faces[nearest as usize]
        .iter()
        .flat_map(|&v| posed.topology.vertex_faces[v as usize].iter().copied());
    let hit = std::iter::once(nearest).chain(ring).find_map(|face| {
        let weights = intersect(&ray, posed.corners(face as usize))?;
        weights.iter().all(|&w| w >= 0.0).then_some((face, weights))
    });
    Some(hit.unwrap_or((nearest, fallback)))
}

/// Barycentrics where a ray from the origin meets the plane of a triangle; `None` when parallel.
fn intersect(ray: &Vector3, [a, b, c]: [&Point3; 3]) -> Option<[f64; 3]> {
    let w = [
        ray.dot(&b.coords.cross(&c.coords)),
        ray.dot(&c.coords.cross(&a.coords)),
        ray.dot(&a.coords.cross(&b.coords)),
    ];
    let total = w[0] + w[1] + w[2];
    (total.abs() > 1e-300).then(|| w.map(|v| v / total))
}

/// Drop every anchor that lies next to a better one and looks like it.
fn merge(anchors: Vec<FeatureAnchor>, options: &AnchorOptions) -> Vec<FeatureAnchor> {
    if options.merge_px == 0.0 {
        return anchors;
    }
    let coarsest = anchors.iter().map(|a| a.footprint).fold(0.0, f64::max);
    let cell = (options.merge_px * coarsest).max(1e-300);
    let least = options.merge_deg.to_radians().cos();
    let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    let mut kept: Vec<FeatureAnchor> = Vec::new();
    for anchor in anchors {
        let key: [i64; 3] = anchor.point.coords.map(|x| (x / cell).floor() as i64).into();
        let same = |i: usize| {
            let reach = options.merge_px * anchor.footprint.max(kept[i].footprint);
            (kept[i].point - anchor.point).norm() <= reach
                && similarity(&kept[i].descriptor, &anchor.descriptor) >= least
        };
        let near = neighbours(key).filter_map(|k| cells.get(&k)).flatten();
        match near.copied().find(|&i| same(i)) {
            Some(known) => kept[known].views.extend(anchor.views),
            None => {
                cells.entry(key).or_default().push(kept.len());
                kept.push(anchor);
            }
        }
    }
    kept
}

fn neighbours([x, y, z]: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(move |k| {
        [(x, k % 3), (y, k / 3 % 3), (z, k / 9)].map(|(at, step)| at.saturating_add(step - 1))
    })
}

/// Cosine of the angle between two descriptors.
fn similarity(a: &[u8; 128], b: &[u8; 128]) -> f64 {
    let dot = |u: &[u8; 128], v: &[u8; 128]| {
        u.iter().zip(v).map(|(&x, &y)| u32::from(x) * u32::from(y)).sum::<u32>()
    };
    f64::from(dot(a, b)) / (f64::from(dot(a, a)) * f64::from(dot(b, b))).sqrt().max(1.0)
}

/// At most `limit` anchors, taken in turn from the cells of a grid over the surface, so that no
/// richly textured corner crowds out the rest.
fn spread(anchors: Vec<FeatureAnchor>, limit: usize) -> Vec<FeatureAnchor> {
    if anchors.len() <= limit {
        return anchors;
    }
    let (mut low, mut high) = (anchors[0].point, anchors[0].point);
    for a in &anchors {
        (low, high) = (low.inf(&a.point), high.sup(&a.point));
    }
    const CELLS_ACROSS: f64 = 32.0;
    let cell = ((high - low).max() / CELLS_ACROSS).max(1e-300);
    let mut taken: BTreeMap<[i64; 3], usize> = BTreeMap::new();
    let mut ranked: Vec<(usize, FeatureAnchor)> = anchors
        .into_iter()
        .map(|a| {
            let key: [i64; 3] = (a.point - low).map(|x| (x / cell) as i64).into();
            let rank = taken.entry(key).or_insert(0);
            *rank += 1;
            (*rank, a)
        })
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.truncate(limit);
    ranked.into_iter().map(|(_, a)| a).collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{patch, pictures};
    use super::*;
    use crate::light::LightModel;

    /// Descriptors that differ from one index to the next by more than a merge allows.
    fn descriptor(i: usize) -> [u8; 128] {
        std::array::from_fn(|k| if k % 16 == i % 16 { 200 } else { 5 })
    }

    #[test]
    fn one_spot_in_two_views_becomes_one_feature_at_the_right_place() {
        let mesh = patch();
        let pictures = pictures(&mesh, &LightModel::Collinear, [1.0; 5]);
        let truth: Vec<_> =
            [(100, [0.2, 0.3, 0.5]), (260, [0.6, 0.3, 0.1]), (300, [0.1, 0.1, 0.8])]
                .map(|(f, w)| point_at(mesh.corners(f), w))
                .to_vec();
        let pixels: Vec<Vec<Point2>> = pictures
            .iter()
            .map(|p| truth.iter().map(|t| p.camera.project(&(p.pose * t)).unwrap().pixel).collect())
            .collect();
        let descriptors: Vec<_> = (0..3).map(descriptor).collect();
        let views: Vec<_> = pictures
            .iter()
            .zip(&pixels)
            .map(|(p, points)| FeatureView { posed: p.posed(), points, descriptors: &descriptors })
            .collect();
        let features = anchor_features(&mesh, &views, &AnchorOptions::default());
        assert_eq!(features.faces.len(), 3);
        for ((&face, &w), d) in
            features.faces.iter().zip(&features.barycentrics).zip(&features.descriptors)
        {
            let k = descriptors.iter().position(|x| x == d).unwrap();
            assert!((point_at(mesh.corners(face as usize), w) - truth[k]).norm() < 1e-6);
        }
        // Without merging, every view that saw one has its own, wherever it lies.
        let apart = AnchorOptions { merge_px: 0.0, ..Default::default() };
        assert_eq!(anchor_features(&mesh, &views, &apart).faces.len(), 3 * views.len());
        let tiny = AnchorOptions { merge_px: 1e-300, ..Default::default() };
        assert!(anchor_features(&mesh, &views, &tiny).faces.len() >= 3);
        // What one view alone shows where it does is left out.
        let mut moving = views.clone();
        let elsewhere = [Point2::new(pixels[0][0].x + 9.0, pixels[0][0].y), pixels[0][1]];
        moving[0].points = &elsewhere;
        let seen = |least_views: usize, views: &[FeatureView]| {
            let options = AnchorOptions { least_views, ..Default::default() };
            anchor_features(&mesh, views, &options).faces.len()
        };
        assert_eq!([1, 2, 5].map(|least| seen(least, &views)), [3, 3, 3]);
        assert_eq!([1, 2, 5].map(|least| seen(least, &moving)), [4, 3, 1]);
        let few = AnchorOptions { max_features: 2, ..Default::default() };
        assert_eq!(anchor_features(&mesh, &views, &few).faces.len(), 2);
    }

    #[test]
    fn keypoints_off_the_surface_are_left_out() {
        let mesh = patch();
        let pictures = pictures(&mesh, &LightModel::Collinear, [1.0; 5]);
        let view = FeatureView {
            posed: pictures[0].posed(),
            points: &[Point2::new(0.0, 0.0), Point2::new(-5.0, 900.0)],
            descriptors: &[descriptor(0), descriptor(1)],
        };
        assert!(anchor_features(&mesh, &[view], &AnchorOptions::default()).faces.is_empty());
    }
}
