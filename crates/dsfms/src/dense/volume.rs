//! Truncated signed distances on a sparse grid of blocks (Curless and Levoy 1996).
//!
//! Positive outside (towards the cameras), negative inside. A depth pixel speaks about grid points
//! within the truncation distance of its plane, and, with less weight, about the free space before
//! it; never about what lies behind.

use super::{DenseOptions, DepthMap, PosedFrame};
use crate::camera::Camera;
use crate::geometry::{Point3, median};
use crate::image::Mask;
use rayon::prelude::*;

/// Grid points along the edge of a block.
pub(super) const EDGE: usize = 8;
/// Grid points in a block.
pub(super) const BLOCK: usize = EDGE * EDGE * EDGE;
/// Truncation distance in grid edges.
const TRUNCATION: f64 = 3.0;
/// Weight of free space against that of the surface itself.
const FREE_SPACE: f64 = 0.2;
/// A pixel says nothing about points farther behind it than this many truncation distances, however
/// grazing its plane.
const MAX_BEHIND: f64 = 4.0;
/// Distances that differ by no more, in truncation distances, are of one surface.
const SAME_LAYER: f64 = 0.5;
/// Depth pixels (every second along rows and columns) of a cell that counts as surface.
const FILLED_CELL: usize = 9;
/// Organ masks are widened by this fraction of the image width before they carve.
const MASK_MARGIN: f64 = 0.006;

/// The grid: world position of grid point `g` of block `b` is `voxel * (8 b + g)`.
pub(super) struct Volume {
    pub voxel: f64,
    /// Block coordinates, ascending.
    pub blocks: Vec<[i32; 3]>,
    /// Signed distance in units of the truncation distance.
    pub distance: Vec<f32>,
    /// Trust of the frames that see a surface here, summed.
    pub support: Vec<f32>,
}

impl Volume {
    /// Allocate around the depth maps and average them.
    pub fn fuse(views: &[PosedFrame], maps: &[DepthMap], options: &DenseOptions) -> Self {
        let voxel = options.voxel.unwrap_or_else(|| voxel_edge(maps, options.target_vertices));
        let blocks = allocate(maps, voxel);
        let lenses: Vec<View> = views.iter().zip(maps).map(|(v, m)| View::new(v, m)).collect();
        let mut volume = Self {
            voxel,
            distance: vec![0.0; blocks.len() * BLOCK],
            support: vec![0.0; blocks.len() * BLOCK],
            blocks,
        };
        let blocks = &volume.blocks;
        volume
            .distance
            .par_chunks_mut(BLOCK)
            .zip(volume.support.par_chunks_mut(BLOCK))
            .enumerate()
            .for_each_init(Vec::new, |seen, (b, (distance, support))| {
                for g in 0..BLOCK {
                    let point = position(voxel, &blocks[b], g);
                    (distance[g], support[g]) = average(&lenses, &point, TRUNCATION * voxel, seen);
                }
            });
        volume
    }

    /// Index of a block.
    pub fn find(&self, block: [i32; 3]) -> Option<usize> {
        self.blocks.binary_search(&block).ok()
    }

    /// World position of grid point `g` of block number `b`.
    pub fn position(&self, b: usize, g: usize) -> Point3 {
        position(self.voxel, &self.blocks[b], g)
    }
}

fn position(voxel: f64, block: &[i32; 3], g: usize) -> Point3 {
    let local = [g % EDGE, g / EDGE % EDGE, g / (EDGE * EDGE)];
    Point3::from(std::array::from_fn::<f64, 3, _>(|k| {
        voxel * (block[k] * EDGE as i32 + local[k] as i32) as f64
    }))
}

/// Edge at which tetrahedra give about `target` vertices: about four a squared edge of surface.
fn voxel_edge(maps: &[DepthMap], target: usize) -> f64 {
    let mut footprints: Vec<f64> = maps
        .iter()
        .flat_map(|m| m.depth.iter().filter(|&&z| z > 0.0).map(|&z| z as f64 / m.camera.focal[0]))
        .collect();
    let Some(footprint) = median(&mut footprints) else { return 1.0 };
    // Area from the cells of a coarse grid that points fall into: a plane meets about 1.5 cells a
    // squared edge.
    let cell = 12.0 * footprint;
    let mut cells: Vec<[i32; 3]> = points(maps, 2).map(|p| cell_of(&p, cell)).collect();
    cells.sort_unstable();
    // A cell full of surface holds 36 points a frame; scattered outliers are no surface.
    let filled = cells.chunk_by(|a, b| a == b).filter(|same| same.len() >= FILLED_CELL).count();
    let area = filled.max(1) as f64 * cell * cell / 1.5;
    (4.0 * area / target as f64).sqrt().max(footprint)
}

fn cell_of(point: &Point3, edge: f64) -> [i32; 3] {
    std::array::from_fn(|k| (point[k] / edge).floor().clamp(-1e9, 1e9) as i32)
}

/// World points of every `step`-th depth pixel.
fn points(maps: &[DepthMap], step: usize) -> impl Iterator<Item = Point3> {
    maps.iter().flat_map(move |m| {
        let w = m.camera.size[0];
        (0..m.depth.len()).filter(move |i| i % w % step == 0 && i / w % step == 0).filter_map(
            move |i| {
                let z = m.depth[i] as f64;
                let ray = Point3::new(
                    ((i % w) as f64 - m.camera.centre[0]) / m.camera.focal[0] * z,
                    ((i / w) as f64 - m.camera.centre[1]) / m.camera.focal[1] * z,
                    z,
                );
                (z > 0.0).then(|| m.pose.inverse_transform_point(&ray))
            },
        )
    })
}

/// Every block within the truncation distance of a depth pixel.
fn allocate(maps: &[DepthMap], voxel: f64) -> Vec<[i32; 3]> {
    let edge = voxel * EDGE as f64;
    let reach = TRUNCATION * voxel;
    let mut blocks: Vec<[i32; 3]> = maps
        .par_iter()
        .flat_map_iter(|m| {
            let (mut own, mut last) = (Vec::new(), None);
            for p in points(std::slice::from_ref(m), 1) {
                let low = cell_of(&(p - crate::geometry::Vector3::repeat(reach)), edge);
                let high = cell_of(&(p + crate::geometry::Vector3::repeat(reach)), edge);
                // Pixels side by side mostly lie in the same blocks.
                if last.replace((low, high)) != Some((low, high)) {
                    own.extend((low[0]..=high[0]).flat_map(move |x| {
                        (low[1]..=high[1])
                            .flat_map(move |y| (low[2]..=high[2]).map(move |z| [x, y, z]))
                    }));
                }
            }
            own.sort_unstable();
            own.dedup();
            own
        })
        .collect();
    blocks.par_sort_unstable();
    blocks.dedup();
    blocks
}

/// A depth map with the outline that carves.
struct View<'a> {
    map: &'a DepthMap,
    posed: &'a PosedFrame<'a>,
    organ: Option<Mask>,
}

impl<'a> View<'a> {
    fn new(posed: &'a PosedFrame<'a>, map: &'a DepthMap) -> Self {
        let margin = (MASK_MARGIN * posed.camera.size[0] as f64).round() as usize + 1;
        Self { map, posed, organ: posed.organ.map(|m| widened(m, margin)) }
    }

    /// `true` where the point projects on usable pixels outside the organ.
    fn excludes(&self, point: &Point3) -> bool {
        let Some(organ) = &self.organ else { return false };
        let Some(hit) = self.posed.camera.project(&(self.posed.pose * point)) else { return false };
        let [w, h] = self.posed.camera.size.map(|s| s as f64 - 1.0);
        let p = hit.pixel;
        let inside = p.x >= 0.0 && p.y >= 0.0 && p.x <= w && p.y <= h;
        inside && self.posed.valid.is_none_or(|m| m.at_pixel(&p)) && !organ.at_pixel(&p)
    }

    /// What the frame says of a point; `None` where it sees no depth or something in front of it.
    fn observe(&self, point: &Point3, truncation: f64) -> Option<Observation> {
        let m = self.map;
        let p = m.pose * point;
        if p.z <= 0.0 {
            return None;
        }
        let [w, h] = m.camera.size;
        let u = m.camera.focal[0] * p.x / p.z + m.camera.centre[0];
        let v = m.camera.focal[1] * p.y / p.z + m.camera.centre[1];
        if !(u >= -0.5 && v >= -0.5 && u < w as f64 - 0.5 && v < h as f64 - 0.5) {
            return None;
        }
        let mut sum = Observation::default();
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
struct Observation {
    distance: f64,
    weight: f64,
    support: f64,
    /// How far the point lies behind the pixel's surface along the optical axis.
    behind: f64,
}

impl Observation {
    fn add(&mut self, share: f64, other: Self) {
        self.distance += share * other.distance;
        self.weight += share * other.weight;
        self.support += share * other.support;
        self.behind += share * other.behind;
    }

    /// Divide by the share of pixels that had depth; `None` for points hidden by the surface.
    fn truncated(self, share: f64, truncation: f64) -> Option<Self> {
        let [distance, weight, support, behind] =
            [self.distance, self.weight, self.support, self.behind].map(|v| v / share);
        let distance = distance / truncation;
        if distance < -1.0 || behind > MAX_BEHIND * truncation {
            return None;
        }
        if distance > 1.0 {
            return Some(Self { distance: 1.0, weight: FREE_SPACE * weight, support: 0.0, behind });
        }
        Some(Self { distance, weight, support, behind })
    }
}

/// A point (camera axes) against the plane of pixel `i`: what is seen at a grazing angle weighs less.
fn tangent_plane(m: &DepthMap, i: usize, [x, y]: [f64; 2], p: &Point3) -> Observation {
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
    Observation { distance, weight: support * facing * facing, support, behind: p.z - z }
}

/// Signed distance over the frames and their support; none where the point is not organ. `seen` is
/// room for what the frames say.
fn average(
    views: &[View],
    point: &Point3,
    truncation: f64,
    seen: &mut Vec<Observation>,
) -> (f32, f32) {
    seen.clear();
    seen.extend(views.iter().filter_map(|v| v.observe(point, truncation)));
    let support: f64 = seen.iter().map(|s| s.support).sum();
    let Some(distance) = robust_distance(seen) else { return (1.0, 0.0) };
    let against = views.iter().filter(|v| v.excludes(point)).count();
    // One outline may be wrong; of few frames each counts.
    if against >= 2 || against == 1 && views.len() <= 4 {
        return (1.0, 0.0);
    }
    (distance as f32, support as f32)
}

/// Weighted mean of the distances within [`SAME_LAYER`] of their weighted median: a depth map that is
/// wrong here must not shift the others. Sorts the observations.
fn robust_distance(seen: &mut Vec<Observation>) -> Option<f64> {
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
    (weight > 0.0).then(|| sum / weight)
}

/// The mask with everything within `radius` px (a square) added.
fn widened(mask: &Mask, radius: usize) -> Mask {
    let [w, h] = mask.size;
    let rows: Vec<bool> = (0..w * h)
        .map(|i| {
            let (x, y) = (i % w, i / w);
            (x.saturating_sub(radius)..(x + radius + 1).min(w)).any(|x| mask.at(x, y))
        })
        .collect();
    let data = (0..w * h)
        .map(|i| {
            let (x, y) = (i % w, i / w);
            (y.saturating_sub(radius)..(y + radius + 1).min(h)).any(|y| rows[y * w + x])
        })
        .collect();
    Mask { size: mask.size, data }
}
