//! Which pixels show the organ: one labelling of the depth maps of all frames, of least energy (graph cut).
//!
//! ```text
//! E(x) = Σ_p  cost_p(x_p)                            colour and height above the wall, as each label has them
//!      + Σ_pq λ·(depth_pq·fold_pq·image_pq + ε)      neighbours of a frame that differ
//!      + Σ_pq link·[x_p ≠ x_q]                       a place of the surface in two frames
//! ```
//!
//! Labels part cheaply where depth steps (`depth`), where the surface folds inwards as an organ meets what it lies
//! on (`fold`), and where the image changes (`image`). What either label looks like is not known before: it is learned
//! from what the explorer looks at, the middle of the frames or what was clicked, and then by each cut from the
//! labels of the last (Rother, Kolmogorov, Blake 2004, in three dimensions). Masks of single frames hold.
//!
//! Weights were chosen on five of the generated scenes (`docs/results/parting.md` has what others give).

use super::cut::Graph;
use super::{DepthMap, PosedFrame, tolerance};
use crate::camera::Camera;
use crate::geometry::{Point2, Point3, Vector3};
use crate::image::Mask;
use rayon::prelude::*;

/// Nodes of a frame, at most: enough to tell the sides of an outline apart, which the image then gives exactly.
const NODES: usize = 20_000;
/// Cost of a border between pixels side by side where nothing speaks for one, in units of log likelihood.
const LAMBDA: f64 = 8.0;
/// Share of it that stays where everything does: of two outlines the shorter.
const LEAST: f64 = 0.05;
/// Share of the image's part that no edge takes away.
const PLAIN: f64 = 0.3;
/// How fast a fold inwards (rad between neighbours) makes a border cheap.
const FOLD: f64 = 3.0;
/// Cost of two labels for one place, and the nearest frames in which a place is looked for.
const LINK: f64 = 2.0;
const LINKED: usize = 3;
/// Distance from the middle of the frame (1: its edge) within which all is organ to begin with.
const MIDDLE: f64 = 0.55;
/// Most that the looks of a pixel say.
const LOOKS: f64 = 4.0;
/// What each feature says: two log ratios of colours, and half as much height, for walls are not flat.
const SAYS: [f64; 3] = [0.5, 0.5, 0.25];
/// Cuts, at most: each learns from the last.
const CUTS: usize = 5;
/// Nothing that is not known outweighs a mask.
const GIVEN: f64 = 100.0;
/// Energies are counted in whole numbers of this size.
const UNIT: f64 = 1.0 / 256.0;

/// Where the organ is in every depth map.
#[derive(Clone, Debug)]
pub struct Labelling {
    /// One a depth map, on its pixels: `true` where it shows the organ.
    pub masks: Vec<Mask>,
    /// Share of the border between organ and wall along which depth steps or is missing, or the surface folds
    /// inwards. Where it is small the border runs over one smooth surface.
    pub stepping: f64,
    /// Share along which it does so or the image changes clearly. Where it is small the border is a guess.
    pub marked: f64,
}

/// Label the depth maps; `maps` are those of [`super::depth_maps`] for the same `views`, in the same order.
/// `at`: a point of the organ in world axes; without it the organ is what the frames look at. Masks of `views`
/// are kept.
pub fn labelling(views: &[PosedFrame], maps: &[DepthMap], at: Option<&Point3>) -> Labelling {
    let axis: Vector3 = maps.iter().map(|m| m.pose.rotation.inverse() * Vector3::z()).sum();
    let grids: Vec<Grid> =
        views.par_iter().zip(maps).map(|(view, map)| Grid::new(view, map, &axis)).collect();
    let all = Nodes::new(&grids, at);
    let organ = all.solve();
    let masks = grids.iter().zip(&all.start).zip(maps);
    let masks = masks.map(|((grid, &start), map)| grid.mask(&organ[start..], map)).collect();
    let [stepping, marked] = all.evidence(&organ);
    Labelling { masks, stepping, marked }
}

/// What the cut reads of one frame, on every `stride`th pixel of its depth map.
struct Grid<'a> {
    map: &'a DepthMap,
    stride: usize,
    size: [usize; 2],
    cells: Vec<Cell>,
}

struct Cell {
    /// Camera axes; `None` without depth.
    point: Option<Point3>,
    normal: Vector3,
    /// Encoded, 0 to 1.
    rgb: [f64; 3],
    /// Two log ratios of colours and the height; NaN where unknown.
    features: [f64; 3],
    /// From the middle of the frame, 1 at its edges.
    off: f64,
    /// What a mask of the frame says.
    given: Option<bool>,
}

impl<'a> Grid<'a> {
    fn new(view: &PosedFrame, map: &'a DepthMap, axis: &Vector3) -> Self {
        let [w, h] = map.camera.size;
        let stride = ((w * h) as f64 / NODES as f64).sqrt().ceil().max(1.0) as usize;
        let size = [w.div_ceil(stride), h.div_ceil(stride)];
        let cell = |k: usize| {
            let i = k / size[0] * stride * w + k % size[0] * stride;
            Cell::new(view, map, axis, i)
        };
        Self { map, stride, size, cells: (0..size[0] * size[1]).map(cell).collect() }
    }

    /// The labels of its nodes on the pixels of the depth map.
    fn mask(&self, organ: &[bool], map: &DepthMap) -> Mask {
        let [w, h] = map.camera.size;
        let node = |i: usize| i / w / self.stride * self.size[0] + i % w / self.stride;
        Mask { size: [w, h], data: (0..w * h).map(|i| organ[node(i)]).collect() }
    }

    /// Neighbours to the right, below, and on both diagonals, and one over their distance.
    fn pairs(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let [w, h] = self.size;
        let near = [(1, 0), (0, 1), (1, 1), (-1, 1)];
        (0..w * h).flat_map(move |i| {
            near.into_iter().filter_map(move |(dx, dy)| {
                let (x, y) = ((i % w).checked_add_signed(dx)?, i / w + dy);
                let distance = ((dx * dx) as f64 + (dy * dy) as f64).sqrt();
                (x < w && y < h).then_some((i, y * w + x, 1.0 / distance))
            })
        })
    }

    /// The node that shows a point (world axes) and agrees with its depth.
    fn showing(&self, point: &Point3) -> Option<usize> {
        let p = self.map.pose * point;
        let i = self.map.pixel(&p)?;
        let w = self.map.camera.size[0];
        let k = i / w / self.stride * self.size[0] + i % w / self.stride;
        let z = self.cells[k].point?.z;
        ((z - p.z).abs() < super::SAME_SURFACE * p.z).then_some(k)
    }
}

impl Cell {
    fn new(view: &PosedFrame, map: &DepthMap, axis: &Vector3, i: usize) -> Self {
        let w = map.camera.size[0];
        let (u, v) = ((i % w) as f64, (i / w) as f64);
        let [cx, cy] = map.camera.centre;
        let ray = Vector3::new((u - cx) / map.camera.focal[0], (v - cy) / map.camera.focal[1], 1.0);
        let point = (map.depth[i] > 0.0).then(|| map.point(i));
        let pixel = view.camera.project(&ray.into()).map(|p| p.pixel);
        let pixel = pixel.filter(|p| inside(p, view.frame.size));
        let rgb = pixel.map_or([f64::NAN; 3], |p| mean_of_nine(view, &p));
        let log = rgb.map(|v| (v + DARK).ln());
        let height = point.map_or(f64::NAN, |p| (map.pose.inverse() * p).coords.dot(axis));
        let [w, h] = view.frame.size.map(|n| 0.5 * n as f64);
        Self {
            point,
            normal: Vector3::from(map.normal[i].map(f64::from)),
            rgb,
            features: [log[0] - log[1], log[2] - log[1], height],
            off: pixel.map_or(f64::INFINITY, |p| ((p.x - w) / w).hypot((p.y - h) / h)),
            given: pixel
                .and_then(|p| Some(view.organ?.at(p.x.round() as usize, p.y.round() as usize))),
        }
    }

    /// What a border to a neighbour costs by depth and fold, 0 to 1.
    fn joined(&self, other: &Self) -> f64 {
        let (Some(p), Some(q)) = (self.point, other.point) else { return 1.0 };
        let facing = (-self.normal.z).min(-other.normal.z);
        let step = (p.z - q.z) / tolerance(p.z.min(q.z), facing);
        let along = q - p;
        let inwards =
            -(other.normal - self.normal).dot(&along) / along.norm().max(f64::MIN_POSITIVE);
        (-0.5 * step * step - FOLD * inwards.max(0.0)).exp()
    }

    /// How different a neighbour looks: squared distance of the encoded colours.
    fn contrast(&self, other: &Self) -> f64 {
        let squared = (0..3).map(|c| (self.rgb[c] - other.rgb[c]).powi(2)).sum::<f64>();
        if squared.is_finite() { squared } else { 0.0 }
    }
}

/// Added to encoded values, 0 to 1, before their logarithm: noise of dark pixels is no colour.
const DARK: f64 = 0.06;

fn inside(p: &Point2, [w, h]: [usize; 2]) -> bool {
    p.x > -0.5 && p.y > -0.5 && p.x < w as f64 - 0.5 && p.y < h as f64 - 0.5
}

/// Encoded colour about a pixel, 0 to 1.
fn mean_of_nine(view: &PosedFrame, p: &Point2) -> [f64; 3] {
    let [w, h] = view.frame.size;
    let clamped = |v: f64, d: i32, n: usize| (v.round() as i32 + d).clamp(0, n as i32 - 1) as usize;
    let mut sum = [0.0; 3];
    for (dx, dy) in (0..9).map(|k| (k % 3 - 1, k / 3 - 1)) {
        let pixel = view.frame.rgb[clamped(p.y, dy, h) * w + clamped(p.x, dx, w)];
        (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
    }
    sum.map(|s| s / (9.0 * 255.0))
}

/// Neighbours of one frame.
struct Pair {
    p: u32,
    q: u32,
    /// What a border between them costs.
    cost: f64,
    /// Whether depth and fold join them, and whether they look alike.
    joined: bool,
    alike: bool,
}

/// The nodes of all frames and what joins them.
struct Nodes<'a> {
    grids: &'a [Grid<'a>],
    /// First node of every frame.
    start: Vec<usize>,
    /// How near the middle, or what was clicked: above 0 where all is organ to begin with.
    gaze: Vec<f64>,
    pairs: Vec<Pair>,
    /// One place in two frames.
    links: Vec<(u32, u32)>,
}

impl<'a> Nodes<'a> {
    fn new(grids: &'a [Grid<'a>], at: Option<&Point3>) -> Self {
        let mut start = vec![0];
        grids.iter().for_each(|g| start.push(start[start.len() - 1] + g.cells.len()));
        let gaze = grids.iter().flat_map(|g| g.gaze(at)).collect();
        let pairs: Vec<_> = grids.iter().zip(&start).flat_map(|(g, &o)| g.borders(o)).collect();
        let mean = pairs.iter().map(|p| p.3).sum::<f64>() / pairs.len().max(1) as f64;
        let cost = |(p, q, near, contrast, joined): (u32, u32, f64, f64, f64)| {
            let like = (-0.5 * contrast / mean.max(1e-12)).exp();
            let image = PLAIN + (1.0 - PLAIN) * like;
            let cost = LAMBDA * near * (joined * image + LEAST);
            Pair { p, q, cost, joined: joined > HALF, alike: like > HALF }
        };
        let pairs = pairs.into_iter().map(cost).collect();
        let links = (0..grids.len()).into_par_iter().flat_map_iter(|f| links(grids, &start, f));
        let links = links.collect();
        Self { grids, start, gaze, pairs, links }
    }

    fn cells(&self) -> impl Iterator<Item = &Cell> {
        self.grids.iter().flat_map(|g| &g.cells)
    }

    /// The labels of least energy.
    fn solve(&self) -> Vec<bool> {
        let start = self.gaze.iter().zip(self.cells());
        let mut organ: Vec<bool> = start.map(|(g, c)| c.given.unwrap_or(*g > 0.0)).collect();
        for _ in 0..CUTS {
            let before = organ;
            organ = self.piece(self.cut(&self.looks(&before)));
            let changed = organ.iter().zip(&before).filter(|(a, b)| a != b).count();
            if changed * 1000 < organ.len() {
                break;
            }
        }
        organ
    }

    fn cut(&self, favour: &[f64]) -> Vec<bool> {
        let whole = |v: f64| (v / UNIT).round() as i32;
        let favour = favour.iter().zip(self.cells()).map(|(f, cell)| match cell.given {
            Some(organ) => whole(if organ { GIVEN } else { -GIVEN }),
            None => whole(*f),
        });
        let mut graph = Graph::new(favour.collect());
        self.pairs.iter().for_each(|pair| graph.join(pair.p, pair.q, whole(pair.cost)));
        self.links.iter().for_each(|&(p, q)| graph.join(p, q, whole(LINK)));
        graph.labels()
    }

    /// What the looks of every node say for the organ, as the last labels have them.
    fn looks(&self, organ: &[bool]) -> Vec<f64> {
        let mut says = vec![0.0; organ.len()];
        for (feature, weight) in SAYS.into_iter().enumerate() {
            let values: Vec<f64> = self.cells().map(|c| c.features[feature]).collect();
            let ratio = LogRatio::of(&values, organ);
            says.iter_mut().zip(&values).for_each(|(s, v)| *s += weight * ratio.at(*v));
        }
        says.iter().map(|s| s.clamp(-LOOKS, LOOKS)).collect()
    }

    /// Of the pieces that are organ, joined in frames or between them, that which is looked at most.
    fn piece(&self, organ: Vec<bool>) -> Vec<bool> {
        let mut root: Vec<u32> = (0..organ.len() as u32).collect();
        let find = |root: &mut Vec<u32>, mut v: u32| {
            while root[v as usize] != v {
                root[v as usize] = root[root[v as usize] as usize];
                v = root[v as usize];
            }
            v
        };
        let close = self.pairs.iter().filter(|pair| pair.joined).map(|pair| (pair.p, pair.q));
        for (p, q) in close.chain(self.links.iter().copied()) {
            if organ[p as usize] && organ[q as usize] {
                let [p, q] = [find(&mut root, p), find(&mut root, q)];
                root[p.max(q) as usize] = p.min(q);
            }
        }
        let mut looked = vec![0.0; organ.len()];
        for (v, cell) in (0..organ.len()).zip(self.cells()).filter(|(v, _)| organ[*v]) {
            let given = if cell.given == Some(true) { GIVEN } else { 0.0 };
            looked[find(&mut root, v as u32) as usize] += self.gaze[v].max(0.0) + given;
        }
        let best =
            (0..looked.len()).max_by(|&a, &b| looked[a].total_cmp(&looked[b]).then(b.cmp(&a)));
        (0..organ.len())
            .map(|v| organ[v] && Some(find(&mut root, v as u32) as usize) == best)
            .collect()
    }

    /// Shares of the border of the organ: see [`Labelling`].
    fn evidence(&self, organ: &[bool]) -> [f64; 2] {
        let deep: Vec<bool> = self.cells().map(|c| c.point.is_some()).collect();
        let (mut steps, mut marks, mut all) = (0, 0, 0);
        for pair in &self.pairs {
            let (p, q) = (pair.p as usize, pair.q as usize);
            if organ[p] != organ[q] {
                let step = !(pair.joined && deep[p] && deep[q]);
                steps += usize::from(step);
                marks += usize::from(step || !pair.alike);
                all += 1;
            }
        }
        [steps, marks].map(|n| n as f64 / all.max(1) as f64)
    }
}

/// Neighbours that depth and fold join by less are two surfaces, and those that are alike by less look different.
const HALF: f64 = 0.5;

impl Grid<'_> {
    /// Nearness to the middle, or to where `at` lies: 1 there, 0 at [`MIDDLE`].
    fn gaze(&self, at: Option<&Point3>) -> Vec<f64> {
        let [w, h] = self.size;
        let centre = match at {
            None => None,
            Some(p) => {
                let p = self.map.pose * p;
                let pixel = self.map.camera.project(&p).map(|p| p.pixel);
                Some(pixel.map(|p| [p.x / self.stride as f64, p.y / self.stride as f64]))
            }
        };
        let off = |(k, cell): (usize, &Cell)| match centre {
            None => cell.off,
            Some(None) => f64::INFINITY,
            Some(Some([x, y])) => {
                let (u, v) = ((k % w) as f64, (k / w) as f64);
                ((u - x) / (0.5 * w as f64)).hypot((v - y) / (0.5 * h as f64))
            }
        };
        let says = |off: f64| 1.0 - off / MIDDLE;
        self.cells.iter().enumerate().map(off).map(says).collect()
    }

    /// Neighbours with the nearness, contrast and joinedness of each two.
    fn borders(&self, start: usize) -> Vec<(u32, u32, f64, f64, f64)> {
        let one = |(p, q, near): (usize, usize, f64)| {
            let [a, b] = [&self.cells[p], &self.cells[q]];
            ((start + p) as u32, (start + q) as u32, near, a.contrast(b), a.joined(b))
        };
        self.pairs().map(one).collect()
    }
}

/// The places of one frame in the frames nearest to it.
fn links(grids: &[Grid], start: &[usize], frame: usize) -> Vec<(u32, u32)> {
    let centre = |g: &Grid| g.map.pose.inverse().translation.vector;
    let own = &grids[frame];
    let mut near: Vec<(f64, usize)> = (0..grids.len())
        .filter(|&k| k != frame)
        .map(|k| ((centre(&grids[k]) - centre(own)).norm(), k))
        .collect();
    near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let back = own.map.pose.inverse();
    let mut found = Vec::new();
    for &(_, other) in near.iter().take(LINKED) {
        for (k, point) in
            own.cells.iter().enumerate().filter_map(|(k, c)| Some((k, back * c.point?)))
        {
            if let Some(q) = grids[other].showing(&point) {
                found.push(((start[frame] + k) as u32, (start[other] + q) as u32));
            }
        }
    }
    found
}

/// How much likelier a value is among the organ's than among the wall's: histograms, smoothed.
struct LogRatio {
    low: f64,
    high: f64,
    ratio: [f64; BINS],
}

const BINS: usize = 40;
/// Standard deviation of the smoothing, bins, and the share of values that may be anything.
const SMOOTH: f64 = 1.5;
const ANYTHING: f64 = 0.02;

impl LogRatio {
    fn of(values: &[f64], organ: &[bool]) -> Self {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied();
        let (low, high) = (at(0.01).unwrap_or(0.0), at(0.99).unwrap_or(1.0));
        let mut table = Self { low, high, ratio: [0.0; BINS] };
        let mut counts = [[0.0; BINS]; 2];
        for (v, organ) in values.iter().zip(organ) {
            if let Some(bin) = table.bin(*v) {
                counts[usize::from(*organ)][bin] += 1.0;
            }
        }
        let [wall, organ] = counts.map(likelihoods);
        table.ratio = std::array::from_fn(|b| (organ[b] / wall[b]).ln());
        table
    }

    fn bin(&self, value: f64) -> Option<usize> {
        let along = (value - self.low) / (self.high - self.low).max(f64::MIN_POSITIVE);
        value.is_finite().then(|| ((along * BINS as f64) as usize).min(BINS - 1))
    }

    /// 0 where the value is unknown.
    fn at(&self, value: f64) -> f64 {
        self.bin(value).map_or(0.0, |bin| self.ratio[bin])
    }
}

fn likelihoods(counts: [f64; BINS]) -> [f64; BINS] {
    let kernel = |d: usize| (-0.5 * (d as f64 / SMOOTH).powi(2)).exp();
    let smooth: [f64; BINS] =
        std::array::from_fn(|b| (0..BINS).map(|k| kernel(b.abs_diff(k)) * counts[k]).sum());
    let all = smooth.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    smooth.map(|s| (1.0 - ANYTHING) * s / all + ANYTHING / BINS as f64)
}
