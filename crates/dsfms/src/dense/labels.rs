//! Which pixels show the organ: one labelling of the depth maps of all frames, of least energy
//! (graph cut).
//!
//! ```text
//! E(x) = Σ_p  cost_p(x_p)                            colour and height above the wall, as each label has them
//!      + Σ_pq λ·(joined_pq·image_pq + ε)            neighbours of a frame that differ
//!      + Σ_pq link·[x_p ≠ x_q]                       a place of the surface in two frames
//! ```
//!
//! Labels part cheaply where depth steps or the surface folds inwards, as an organ meets what it
//! lies on (`joined`), and where the image changes (`image`). What either label looks like is not
//! known before: it is learned from what the explorer looks at, the middle of the frames or what
//! was clicked, and then by each cut from the labels of the last (Rother, Kolmogorov, Blake 2004,
//! in three dimensions). Masks of single frames hold, and so does what is said of single places
//! ([`Seeds`]). Where the outline is a guess, the same energy under another prior offers others
//! ([`Parting::others`]).
//!
//! Weights were chosen on five of the generated scenes (`docs/results/parting.md` has what others
//! give).

use super::cells::{Colours, Grid, GridNode, NODES, NodePair};
use super::depth_map::DepthMap;
use super::looks::LogRatio;
use super::seeds::Seeds;
use crate::camera::PosedFrame;
use crate::geometry::{DisjointSets, Point2, Point3, Vector3};
use crate::image::{Mask, cut::Graph};
use rayon::prelude::*;

/// Cost of a border between nodes side by side where nothing speaks for one, in units of log
/// likelihood, on a grid of [`NODES`]. What nodes say grows with their number, a border with its
/// square root, and so does this.
const LAMBDA: f64 = 8.0;
/// Share of it that stays where everything does: of two outlines the shorter.
const LEAST: f64 = 0.05;
/// Share of the image's part that no edge takes away.
const PLAIN: f64 = 0.3;
/// Cost of two labels for one place, and the nearest frames in which a place is looked for.
const LINK: f64 = 2.0;
const LINKED: usize = 3;
/// Most that the looks of a node say.
const LOOKS: f64 = 4.0;
/// What each feature says: two log ratios of colours, half as much height, for walls are not flat,
/// and motion.
const SAYS: [f64; 4] = [0.5, 0.5, 0.25, 0.5];
/// Cuts, at most, each of which learns from the last, and the share of nodes below which a change
/// is none.
const CUTS: usize = 5;
const SETTLED: f64 = 1e-3;
/// What a mask says of a node: more than everything else can.
const GIVEN: f64 = 100.0;
/// Neighbours that depth and fold join by less are two surfaces, and those that are alike by less
/// look different.
const HALF: f64 = 0.5;
/// Energies are counted in whole numbers of this size.
const UNIT: f64 = 1.0 / 256.0;

/// What is held of the organ before anything is seen of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct LabelPrior {
    /// Distance from the middle of the frame (1: its edge) within which all is organ to begin with.
    pub(super) middle: f64,
    /// Added to what every node says for the organ.
    pub(super) favour: f64,
    /// Weight of what the looks of a node say.
    pub(super) looks: f64,
    /// What a node in the middle says for the organ by its place, and one at the edge against it.
    pub(super) gaze: f64,
    /// Whether pieces part where depth steps or the surface folds, so that of those only one stays.
    pub(super) apart: bool,
    /// What a node in the middle says for the organ in a cut before the first that learns; 0 leaves
    /// it out.
    pub(super) first: f64,
}

/// That of the labels that are taken.
pub(super) const USUAL: LabelPrior =
    LabelPrior { middle: 0.55, favour: 0.0, looks: 1.0, gaze: 0.0, apart: true, first: 0.0 };
/// That where nothing is left of those: what is learned from the middle tells nothing where the
/// rest looks like the organ as often. The labels of the gallbladder clip, which need it, are the
/// same for 3 and for 6.
const CUT_FIRST: LabelPrior = LabelPrior { first: 3.0, ..USUAL };
/// Share of what the frames show below which nothing is left.
pub(super) const NOTHING: f64 = 0.02;

/// Where the organ is in every depth map.
#[derive(Clone, Debug)]
pub struct Labelling {
    /// One a depth map, on its pixels: `true` where it shows the organ.
    pub masks: Vec<Mask>,
    /// Share of the border between organ and wall, 0 to 1, along which depth steps or is missing,
    /// or the surface folds inwards. Where it is small the border runs over one smooth surface.
    pub stepping: f64,
    /// Share along which it does so or the image changes clearly. Where it is small the border is a
    /// guess.
    pub marked: f64,
    /// One a depth map: the border.
    pub borders: Vec<Vec<Border>>,
}

/// A place of the border between organ and wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Border {
    /// Where the frame shows it, px.
    pub pixel: Point2,
    /// How clearly depth, a fold or the image marks it, 0 to 1.
    pub confidence: f64,
}

/// Depth maps, to be parted into the organ and the rest.
pub struct Parting<'a> {
    nodes: Nodes<'a>,
}

impl<'a> Parting<'a> {
    /// `maps` are those of [`super::depth_maps`] for the same `views`, in the same order. Masks of
    /// `views` and `seeds` are kept; without seeds of the organ it is what the frames look at.
    /// `moved`: points of the surface, world axes, and how far they move in other frames, in any
    /// measure: which of the two moves is learned.
    pub fn new(
        views: &[PosedFrame],
        maps: &'a [DepthMap],
        seeds: &Seeds,
        moved: &[(Point3, f64)],
    ) -> Self {
        let colours: Vec<Colours> =
            views.par_iter().zip(maps).map(|(view, map)| Colours::of(view, map)).collect();
        Self::of_colours(views, maps, &colours, seeds, moved)
    }

    /// [`Self::new`] by the [`Colours`] of the frames, whose own pixels are not read.
    pub fn of_colours(
        views: &[PosedFrame],
        maps: &'a [DepthMap],
        colours: &[Colours],
        seeds: &Seeds,
        moved: &[(Point3, f64)],
    ) -> Self {
        let axis: Vector3 = maps.iter().map(|m| m.pose.rotation.inverse() * Vector3::z()).sum();
        let grid = |((view, map), colours)| Grid::new(view, map, colours, &axis);
        let mut grids: Vec<Grid> = views.par_iter().zip(maps).zip(colours).map(grid).collect();
        grids.par_iter_mut().for_each(|grid| {
            grid.hold(seeds);
            grid.note(moved);
        });
        Self { nodes: Nodes::new(grids, seeds) }
    }

    /// The labels of least energy. Where nothing parts, all or nothing is organ and both shares are
    /// 0.
    pub fn best(&self) -> Labelling {
        let mut organ = self.nodes.solve(&USUAL);
        if (organ.iter().filter(|&&own| own).count() as f64) < NOTHING * organ.len() as f64 {
            organ = self.nodes.solve(&CUT_FIRST);
        }
        self.nodes.labelling(&organ)
    }

    /// The labels of least energy under another prior.
    pub(super) fn under(&self, prior: &LabelPrior) -> Labelling {
        self.nodes.labelling(&self.nodes.solve(prior))
    }
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
    /// How clearly depth, a fold or the image parts them, 0 to 1.
    parted: f32,
}

/// The nodes of all frames and what joins them.
struct Nodes<'a> {
    grids: Vec<Grid<'a>>,
    /// First node of every frame.
    start: Vec<usize>,
    /// Distance from the middle, or from what is known to be organ, and from what is known not to
    /// be: 1 is half the frame's width or height.
    off: Vec<[f64; 2]>,
    pairs: Vec<Pair>,
    /// One place in two frames.
    links: Vec<(u32, u32)>,
}

impl<'a> Nodes<'a> {
    fn new(grids: Vec<Grid<'a>>, seeds: &Seeds) -> Self {
        let mut start = vec![0];
        grids.iter().for_each(|g| start.push(start[start.len() - 1] + g.cells.len()));
        let off = grids.par_iter().flat_map_iter(|g| g.off(seeds)).collect();
        let pairs = pairs(&grids, &start);
        let links = (0..grids.len()).into_par_iter().flat_map_iter(|f| links(&grids, &start, f));
        let links = links.collect();
        Self { grids, start, off, pairs, links }
    }

    /// How near every node is to what is looked at: above 0 where all is organ to begin with, 1 at
    /// most.
    fn gaze(&self, prior: &LabelPrior) -> Vec<f64> {
        let gaze = |&[organ, other]: &[f64; 2]| {
            let near = 1.0 - organ / prior.middle;
            if other < organ { near.min(0.0) } else { near }
        };
        self.off.iter().map(gaze).collect()
    }

    fn cells(&self) -> impl Iterator<Item = &GridNode> {
        self.grids.iter().flat_map(|g| &g.cells)
    }

    /// The labels of least energy.
    fn solve(&self, prior: &LabelPrior) -> Vec<bool> {
        let costs = self.pairs.iter().map(|pair| (pair.p, pair.q, whole(pair.cost)));
        let links = self.links.iter().map(|&(p, q)| (p, q, whole(LINK)));
        let gaze = self.gaze(prior);
        let graph = Graph::new(gaze.len(), costs.chain(links));
        let start = gaze.iter().zip(self.cells());
        let mut organ: Vec<bool> = start.map(|(g, c)| c.given.unwrap_or(*g > 0.0)).collect();
        let cut = |favour| self.piece(graph.labels(favour), &gaze, prior.apart);
        if prior.first > 0.0 {
            organ = cut(self.by_place(&gaze, prior.first));
        }
        for _ in 0..CUTS {
            let previous = organ;
            organ = cut(self.favour(&previous, &gaze, prior));
            let changed = organ.iter().zip(&previous).filter(|(a, b)| a != b).count();
            if (changed as f64) < SETTLED * organ.len() as f64 {
                break;
            }
        }
        organ
    }

    /// What masks and seeds say of every node for the organ, and its place, by `weight` at most.
    fn by_place(&self, gaze: &[f64], weight: f64) -> Vec<i32> {
        let place = |gaze: f64| (weight * gaze).max(-2.0 * weight);
        let favour =
            gaze.iter().zip(self.cells()).map(|(&g, cell)| given(cell).unwrap_or(place(g)));
        favour.map(whole).collect()
    }

    /// What masks, seeds and looks, as the last labels have them, say of every node for the organ.
    fn favour(&self, organ: &[bool], gaze: &[f64], prior: &LabelPrior) -> Vec<i32> {
        let mut says = vec![0.0; organ.len()];
        for (feature, weight) in SAYS.into_iter().enumerate() {
            let values: Vec<f64> = self.cells().map(|c| c.features[feature]).collect();
            let ratio = LogRatio::of(&values, organ);
            says.iter_mut().zip(&values).for_each(|(s, v)| *s += weight * ratio.at(*v));
        }
        let all = says.iter().zip(gaze).zip(self.cells());
        let favour = all.map(|((says, gaze), cell)| {
            let place = prior.favour + prior.gaze * gaze.clamp(-1.0, 1.0);
            given(cell).unwrap_or(prior.looks * says.clamp(-LOOKS, LOOKS) + place)
        });
        favour.map(whole).collect()
    }

    /// Of the pieces that are organ, joined in frames or between them, that which is looked at
    /// most; see [`LabelPrior::apart`].
    fn piece(&self, organ: Vec<bool>, gaze: &[f64], apart: bool) -> Vec<bool> {
        let mut pieces = DisjointSets::new(organ.len());
        let close = self.pairs.iter().filter(|pair| pair.joined || !apart);
        let close = close.map(|pair| (pair.p, pair.q));
        for (p, q) in close.chain(self.links.iter().copied()) {
            if organ[p as usize] && organ[q as usize] {
                pieces.join(p, q);
            }
        }
        let mut looked = vec![0.0; organ.len()];
        for (v, cell) in (0..organ.len()).zip(self.cells()).filter(|(v, _)| organ[*v]) {
            let given = if cell.given == Some(true) { GIVEN } else { 0.0 };
            looked[pieces.root(v as u32) as usize] += gaze[v].max(0.0) + given;
        }
        let best =
            (0..looked.len()).max_by(|&a, &b| looked[a].total_cmp(&looked[b]).then(b.cmp(&a)));
        let own = |v: usize| organ[v] && Some(pieces.root(v as u32) as usize) == best;
        (0..organ.len()).map(own).collect()
    }

    fn labelling(&self, organ: &[bool]) -> Labelling {
        let own = |start: usize, grid: &Grid| grid.mask(&organ[start..]);
        let masks = self.grids.iter().zip(&self.start).map(|(grid, &start)| own(start, grid));
        let masks = masks.collect();
        let [stepping, marked] = self.evidence(organ);
        Labelling { masks, stepping, marked, borders: self.borders(organ) }
    }

    /// Every node of the organ that borders on the wall, and how clearly, in every frame.
    fn borders(&self, organ: &[bool]) -> Vec<Vec<Border>> {
        let mut parted: Vec<Option<f32>> = vec![None; organ.len()];
        for pair in
            self.pairs.iter().filter(|pair| organ[pair.p as usize] != organ[pair.q as usize])
        {
            let own = if organ[pair.p as usize] { pair.p } else { pair.q };
            let known = &mut parted[own as usize];
            *known = Some(known.map_or(pair.parted, |known| known.max(pair.parted)));
        }
        let frame = |(grid, &start): (&Grid, &usize)| {
            let nodes = grid.cells.iter().zip(&parted[start..]);
            let shown = nodes.filter_map(|(cell, parted)| {
                Some(Border { pixel: cell.pixel?, confidence: f64::from((*parted)?) })
            });
            shown.collect()
        };
        self.grids.iter().zip(&self.start).map(frame).collect()
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

/// What masks and seeds say of a node for the organ.
fn given(cell: &GridNode) -> Option<f64> {
    cell.given.map(|organ| if organ { GIVEN } else { -GIVEN })
}

fn whole(energy: f64) -> i32 {
    (energy / UNIT).round() as i32
}

/// The neighbours of all frames and what a border between them costs.
fn pairs(grids: &[Grid], start: &[usize]) -> Vec<Pair> {
    let near: Vec<Vec<NodePair>> = grids.par_iter().map(|g| g.neighbours().collect()).collect();
    let count = near.iter().map(Vec::len).sum::<usize>();
    let mean = near.iter().flatten().map(|n| n.contrast).sum::<f64>() / count.max(1) as f64;
    let pair = |frame: usize, n: &NodePair| {
        let like = (-0.5 * n.contrast / mean.max(1e-12)).exp();
        let image = PLAIN + (1.0 - PLAIN) * like;
        let lambda = LAMBDA * (grids[frame].cells.len() as f64 / NODES as f64).sqrt();
        Pair {
            p: (start[frame] + n.p) as u32,
            q: (start[frame] + n.q) as u32,
            cost: lambda * n.nearness * (n.joined * image + LEAST),
            joined: n.joined > HALF,
            alike: like > HALF,
            parted: (1.0 - n.joined * like) as f32,
        }
    };
    let all = near.iter().enumerate();
    all.flat_map(|(frame, near)| near.iter().map(move |n| pair(frame, n))).collect()
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
