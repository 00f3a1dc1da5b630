//! What the labelling of the organ reads of one frame, on a coarse grid of its depth map.

use super::depth_map::{DepthMap, SAME_SURFACE, tolerance};
use super::seeds::Seeds;
use crate::camera::{Camera, PosedFrame};
use crate::geometry::{Point2, Point3, Vector3};
use crate::image::{Mask, nearest_pixel};

/// Nodes of a frame, at most: enough to tell the sides of an outline apart, which the image then
/// gives exactly.
pub(super) const NODES: usize = 20_000;
/// How far about a point its motion is taken to be that of the surface, of the frame's width.
const REACH: f64 = 0.03;
/// How fast a fold inwards (rad between neighbours) makes a border cheap.
const FOLD: f64 = 3.0;
/// Added to encoded values, 0 to 1, before their logarithm: noise of dark pixels is no colour.
const DARK: f64 = 0.06;

/// One frame, on every `stride`th pixel of its depth map.
pub(super) struct Grid<'a> {
    pub(super) map: &'a DepthMap,
    stride: usize,
    size: [usize; 2],
    pub(super) cells: Vec<GridNode>,
}

/// One node of the grid.
pub(super) struct GridNode {
    /// Camera axes; `None` without depth.
    pub(super) point: Option<Point3>,
    normal: Vector3,
    /// Encoded, 0 to 1; NaN beside the frame.
    rgb: [f64; 3],
    /// Two log ratios of colours, the height along the mean line of sight, and motion; NaN where
    /// unknown.
    pub(super) features: [f64; 4],
    /// Of the frame; `None` beside it.
    pub(super) pixel: Option<Point2>,
    /// From the middle of the frame, 1 at its edges.
    off: f64,
    /// What a mask of the frame, or a seed, says.
    pub(super) given: Option<bool>,
}

/// What a frame shows at every pixel of its depth map: the sum of nine encoded pixels of each
/// channel, all that the labelling reads of the frame itself.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Colours(Vec<[u16; 3]>);

/// Beside the frame.
const BESIDE: [u16; 3] = [u16::MAX; 3];

impl Colours {
    /// Of one frame, on the pixels of its depth map.
    pub fn of(view: &PosedFrame, map: &DepthMap) -> Self {
        let sum = |place: usize| {
            let at = pixel_of(view, map, place).and_then(|p| nearest_pixel(&p, view.frame.size));
            at.map_or(BESIDE, |at| sum_of_nine(view, at))
        };
        Self((0..map.depth.len()).map(sum).collect())
    }

    /// How many pixels there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// Encoded colour, 0 to 1; NaN beside the frame.
    fn mean(&self, place: usize) -> [f64; 3] {
        match self.0[place] {
            BESIDE => [f64::NAN; 3],
            sum => sum.map(|s| f64::from(s) / (9.0 * 255.0)),
        }
    }
}

/// Two neighbours of one grid.
pub(super) struct NodePair {
    pub(super) p: usize,
    pub(super) q: usize,
    /// One over their distance, nodes.
    pub(super) nearness: f64,
    /// How much depth and fold join them, 0 to 1.
    pub(super) joined: f64,
    /// Squared distance of their encoded colours.
    pub(super) contrast: f64,
}

impl<'a> Grid<'a> {
    /// `axis`: the mean line of sight of all frames, world axes, along which height is measured.
    pub(super) fn new(
        view: &PosedFrame,
        map: &'a DepthMap,
        colours: &Colours,
        axis: &Vector3,
    ) -> Self {
        let [w, h] = map.camera.size;
        let stride = ((w * h) as f64 / NODES as f64).sqrt().ceil().max(1.0) as usize;
        let size = [w.div_ceil(stride), h.div_ceil(stride)];
        let place = |k: usize| k / size[0] * stride * w + k % size[0] * stride;
        let cell = |k: usize| GridNode::new(view, map, colours.mean(place(k)), axis, place(k));
        let cells = (0..size[0] * size[1]).map(cell);
        Self { map, stride, size, cells: cells.collect() }
    }

    /// The node at a place of the depth map.
    fn node(&self, place: usize) -> usize {
        let w = self.map.camera.size[0];
        place / w / self.stride * self.size[0] + place % w / self.stride
    }

    /// The labels of its nodes on the pixels of the depth map.
    pub(super) fn mask(&self, organ: &[bool]) -> Mask {
        let data = (0..self.map.depth.len()).map(|place| organ[self.node(place)]);
        Mask { size: self.map.camera.size, data: data.collect() }
    }

    /// Neighbours to the right, below, and on both diagonals.
    pub(super) fn neighbours(&self) -> impl Iterator<Item = NodePair> + '_ {
        let [w, h] = self.size;
        let near = [(1, 0), (0, 1), (1, 1), (-1, 1)];
        (0..w * h).flat_map(move |p| {
            near.into_iter().filter_map(move |(dx, dy)| {
                let (x, y) = ((p % w).checked_add_signed(dx)?, p / w + dy);
                let nearness = 1.0 / ((dx * dx) as f64 + (dy * dy) as f64).sqrt();
                let q = (x < w && y < h).then_some(y * w + x)?;
                let [a, b] = [&self.cells[p], &self.cells[q]];
                let (joined, contrast) = (a.joined(b), a.contrast(b));
                Some(NodePair { p, q, nearness, joined, contrast })
            })
        })
    }

    /// The node that shows a point (world axes) and agrees with its depth.
    pub(super) fn showing(&self, point: &Point3) -> Option<usize> {
        let p = self.map.pose * point;
        let node = self.node(self.map.pixel(&p)?);
        let z = self.cells[node].point?.z;
        ((z - p.z).abs() < SAME_SURFACE * p.z).then_some(node)
    }

    /// Let the nodes about what is known of single places hold it; where masks and seeds differ the
    /// masks count.
    pub(super) fn hold(&mut self, seeds: &Seeds) {
        let organ = seeds.organ.iter().map(|p| (p, true));
        for (point, label) in organ.chain(seeds.other.iter().map(|p| (p, false))) {
            let Some(node) = self.showing(point) else { continue };
            let z = self.cells[node].point.map_or(0.0, |p| p.z);
            let [w, h] = self.size;
            let (x, y) = (node % w, node / w);
            for v in y.saturating_sub(1)..(y + 2).min(h) {
                for u in x.saturating_sub(1)..(x + 2).min(w) {
                    let cell = &mut self.cells[v * w + u];
                    let same = |p: Point3| (p.z - z).abs() < SAME_SURFACE * z;
                    if cell.point.is_some_and(same) {
                        cell.given.get_or_insert(label);
                    }
                }
            }
        }
    }

    /// Give the nodes near points that were seen to move the mean of what they moved.
    pub(super) fn note(&mut self, moved: &[(Point3, f64)]) {
        let [w, h] = self.size;
        let reach = ((REACH * w as f64) as usize).max(1);
        let mut sums = vec![[0.0; 2]; self.cells.len()];
        for (point, value) in moved {
            let Some(node) = self.showing(point) else { continue };
            let Some(z) = self.cells[node].point.map(|p| p.z) else { continue };
            let (x, y) = (node % w, node / w);
            for v in y.saturating_sub(reach)..(y + reach + 1).min(h) {
                for u in x.saturating_sub(reach)..(x + reach + 1).min(w) {
                    let near = |p: Point3| (p.z - z).abs() < SAME_SURFACE * 3.0 * z;
                    if self.cells[v * w + u].point.is_some_and(near) {
                        let sum = &mut sums[v * w + u];
                        *sum = [sum[0] + value, sum[1] + 1.0];
                    }
                }
            }
        }
        for (cell, [sum, count]) in self.cells.iter_mut().zip(sums).filter(|(_, s)| s[1] > 0.0) {
            cell.features[3] = sum / count;
        }
    }

    /// Distance of every node from what is known to be organ, without it from the middle of the
    /// frame, and from what is known not to be: 1 is half the frame's width or height.
    pub(super) fn off(&self, seeds: &Seeds) -> Vec<[f64; 2]> {
        let nearest = |points: &[Point3]| {
            let seen: Vec<Point2> = points.iter().filter_map(|p| self.place_of(p)).collect();
            let [w, h] = self.size.map(|n| 0.5 * n as f64);
            let off = move |k: usize| {
                let (u, v) = ((k % self.size[0]) as f64, (k / self.size[0]) as f64);
                let each = seen.iter().map(|p| ((u - p.x) / w).hypot((v - p.y) / h));
                each.fold(f64::INFINITY, f64::min)
            };
            (0..self.cells.len()).map(off).collect::<Vec<f64>>()
        };
        let organ = match seeds.organ.as_slice() {
            [] => self.cells.iter().map(|cell| cell.off).collect(),
            points => nearest(points),
        };
        organ.into_iter().zip(nearest(&seeds.other)).map(|(organ, other)| [organ, other]).collect()
    }

    /// Where a point (world axes) lies among the nodes; `None` behind the camera.
    fn place_of(&self, point: &Point3) -> Option<Point2> {
        let pixel = self.map.camera.project(&(self.map.pose * point))?.pixel;
        Some(pixel / self.stride as f64)
    }
}

impl GridNode {
    fn new(view: &PosedFrame, map: &DepthMap, rgb: [f64; 3], axis: &Vector3, place: usize) -> Self {
        let point = (map.depth[place] > 0.0).then(|| map.point(place));
        let pixel = pixel_of(view, map, place);
        let at = pixel.and_then(|p| nearest_pixel(&p, view.frame.size));
        let log = rgb.map(|v| (v + DARK).ln());
        let height = point.map_or(f64::NAN, |p| (map.pose.inverse() * p).coords.dot(axis));
        let [w, h] = view.frame.size.map(|n| 0.5 * n as f64);
        let off = |p: Point2| ((p.x - w) / w).hypot((p.y - h) / h);
        Self {
            point,
            normal: Vector3::from(map.normal[place].map(f64::from)),
            rgb,
            features: [log[0] - log[1], log[2] - log[1], height, f64::NAN],
            pixel: at.and(pixel),
            off: at.and(pixel).map_or(f64::INFINITY, off),
            given: at.and_then(|[x, y]| Some(view.organ?.at(x, y))),
        }
    }

    /// How much depth and fold join it to a neighbour, 0 to 1.
    fn joined(&self, other: &Self) -> f64 {
        let (Some(p), Some(q)) = (self.point, other.point) else { return 1.0 };
        let facing = (-self.normal.z).min(-other.normal.z);
        let step = (p.z - q.z) / tolerance(p.z.min(q.z), facing);
        let along = q - p;
        let inwards =
            -(other.normal - self.normal).dot(&along) / along.norm().max(f64::MIN_POSITIVE);
        (-0.5 * step * step - FOLD * inwards.max(0.0)).exp()
    }

    fn contrast(&self, other: &Self) -> f64 {
        let squared = (0..3).map(|c| (self.rgb[c] - other.rgb[c]).powi(2)).sum::<f64>();
        if squared.is_finite() { squared } else { 0.0 }
    }
}

/// Where the frame shows what a place of its depth map sees, px.
fn pixel_of(view: &PosedFrame, map: &DepthMap, place: usize) -> Option<Point2> {
    view.camera.project(&map.ray(place).into()).map(|p| p.pixel)
}

/// Sum of the encoded pixels about one; those beyond the edges are those at them.
fn sum_of_nine(view: &PosedFrame, at: [usize; 2]) -> [u16; 3] {
    let [w, h] = view.frame.size;
    let clamped = |v: usize, d: usize, n: usize| (v + d).saturating_sub(1).min(n - 1);
    let mut sum = [0; 3];
    for (dx, dy) in (0..9).map(|k| (k % 3, k / 3)) {
        let pixel = view.frame.rgb[clamped(at[1], dy, h) * w + clamped(at[0], dx, w)];
        (0..3).for_each(|c| sum[c] += u16::from(pixel[c]));
    }
    sum
}
