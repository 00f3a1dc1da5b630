//! Truncated signed distances on a sparse grid of blocks (Curless and Levoy 1996).
//!
//! Positive outside (towards the cameras), negative inside. A depth pixel speaks about grid points
//! within the truncation distance of its plane, and, with less weight, about the free space before
//! it; never about what lies behind.

use super::depth_map::DepthMap;
use super::grid::{self, BLOCK, EDGE};
use super::observe::{DistanceEvidence, ObservedView, average};
use super::options::{DenseOptions, MOST_VERTICES};
use crate::camera::PosedFrame;
use crate::geometry::{Point3, median};
use rayon::prelude::*;

/// Truncation distance in grid edges.
const TRUNCATION: f64 = 3.0;
/// Depth pixels (every second along rows and columns) of a cell that counts as surface.
const FILLED_CELL: usize = 9;

/// The grid: world position of grid point `g` of block `b` is `voxel * (8 b + g)`.
pub(super) struct DistanceVolume {
    pub voxel: f64,
    /// Block coordinates, ascending.
    pub blocks: Vec<[i32; 3]>,
    /// Signed distance in units of the truncation distance.
    pub distance: Vec<f32>,
    /// Trust of the frames that see a surface here, summed.
    pub support: Vec<f32>,
    /// What the frames say of the distance.
    pub evidence: Vec<DistanceEvidence>,
}

impl DistanceVolume {
    /// Allocate around the depth maps and average them; the distances are those of the evidence.
    pub(super) fn fuse(views: &[PosedFrame], maps: &[DepthMap], options: &DenseOptions) -> Self {
        let voxel = options
            .voxel
            .unwrap_or_else(|| voxel_edge(maps, options.target_vertices.unwrap_or(MOST_VERTICES)));
        let blocks = widened(&allocate(maps, voxel));
        let lenses: Vec<ObservedView> =
            views.iter().zip(maps).map(|(v, m)| ObservedView::new(v, m)).collect();
        let mut volume = Self {
            voxel,
            distance: vec![0.0; blocks.len() * BLOCK],
            support: vec![0.0; blocks.len() * BLOCK],
            evidence: vec![DistanceEvidence::default(); blocks.len() * BLOCK],
            blocks,
        };
        let blocks = &volume.blocks;
        volume
            .distance
            .par_chunks_mut(BLOCK)
            .zip(volume.support.par_chunks_mut(BLOCK))
            .zip(volume.evidence.par_chunks_mut(BLOCK))
            .enumerate()
            .for_each_init(Vec::new, |seen, (b, ((distance, support), evidence))| {
                for g in 0..BLOCK {
                    let point = position(voxel, &blocks[b], g);
                    (evidence[g], support[g]) = average(&lenses, &point, TRUNCATION * voxel, seen);
                    distance[g] = evidence[g].distance;
                }
            });
        volume
    }

    /// Count what lies within `reach` edges of points of at least `least` support near the zero
    /// level as supported.
    pub(super) fn spread_support(&mut self, least: f32, reach: usize) {
        /// Of the truncation distance.
        const NEAR: f32 = 0.67;
        let around = grid::neighbours(&self.blocks);
        let mut front: Vec<u32> = (0..self.support.len())
            .filter(|&i| self.support[i] >= least && self.distance[i].abs() < NEAR)
            .map(|i| i as u32)
            .collect();
        let mut known = vec![false; self.support.len()];
        front.iter().for_each(|&i| known[i as usize] = true);
        for _ in 0..reach {
            let mut next = Vec::new();
            for &n in front.iter().flat_map(|&i| &around[i as usize]) {
                if n != grid::NONE && !std::mem::replace(&mut known[n as usize], true) {
                    self.support[n as usize] = self.support[n as usize].max(least);
                    next.push(n);
                }
            }
            front = next;
        }
    }

    /// Index of a block.
    pub(super) fn find(&self, block: [i32; 3]) -> Option<usize> {
        self.blocks.binary_search(&block).ok()
    }

    /// World position of grid point `g` of block number `b`.
    pub(super) fn position(&self, b: usize, g: usize) -> Point3 {
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

/// The blocks and all beside them, where the field may go on.
fn widened(blocks: &[[i32; 3]]) -> Vec<[i32; 3]> {
    let beside = |b: &[i32; 3]| {
        let [x, y, z] = *b;
        (0..27).map(move |i| [x + i % 3 - 1, y + i / 3 % 3 - 1, z + i / 9 - 1])
    };
    let mut all: Vec<[i32; 3]> = blocks.iter().flat_map(beside).collect();
    all.par_sort_unstable();
    all.dedup();
    all
}
