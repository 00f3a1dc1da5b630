//! The organ against its surroundings in one picture, from a rough silhouette (Rother, Kolmogorov,
//! Blake, *GrabCut*, 2004).
//!
//! ```text
//! E(x) = Σ_p log p(c_p | surroundings) / p(c_p | organ) · x_p       colours, by histograms of the labels so far
//!      + Σ_pq λ·exp(−‖c_p − c_q‖² / 2⟨‖c_p − c_q‖²⟩)·[x_p ≠ x_q]    neighbours that differ, less across an edge
//! ```
//!
//! Neighbours on a diagonal cost `1/√2` of that. Colours `c` are two log ratios of the channels,
//! which shading leaves alone, and brightness. What lies well inside the rough silhouette or far
//! outside keeps its label. The outline counts only where the colours on its two sides differ: a
//! mesh that ends within the organ has none there.

use super::cut::Graph;
use super::distance::signed_distance;
use super::{ColorImage, Mask, Outline, diagonal};

/// Cells along the diagonal of the image: an outline known to 2 px of 640 x 480.
const CELLS: f64 = 400.0;
/// Depth within the rough silhouette beyond which a cell is the organ's, and distance beyond which
/// it is not, of the diagonal. A long pull moves an outline by a sixth.
const INNER: f64 = 1.0 / 16.0;
const OUTER: f64 = 0.15;
/// Bins of every colour, and the share of cells at either end that share the last.
const BINS: usize = 16;
const TAIL: f64 = 0.01;
/// Share of values that may be anything.
const ANYTHING: f64 = 0.02;
/// Largest log ratio of a cell, and cost λ of a border between cells of one colour (that of
/// GrabCut), in units of log likelihood.
const MOST: f64 = 8.0;
const LAMBDA: f64 = 50.0;
/// Cuts at most, each of which learns from the last.
const CUTS: usize = 5;
/// Cells around a place of the border whose colours are compared, and the difference of the mean
/// log ratio on its two sides by which it is marked.
const NEAR: usize = 4;
const MARKED: f64 = 3.0;
/// Or neighbours across it, there, are less alike than this.
const STEP: f64 = 0.35;
/// Share of the border that is marked, and overlap with the rough silhouette (intersection over
/// union), at least, of an outline that is believed.
const ENOUGH: f64 = 0.5;
const SAME: f64 = 0.6;
/// Energies are counted in whole numbers of this size.
const UNIT: f64 = 1.0 / 64.0;
/// Log ratio of a cell whose label is kept: more than all borders of one cell cost.
const KEPT: f64 = 1e4;

/// An organ that its colours part from its surroundings.
#[derive(Clone)]
pub(crate) struct Segment {
    /// Its outline, known where colours mark it.
    pub(crate) outline: Outline,
    /// Share of it that they mark.
    pub(crate) marked: f64,
    /// Usable pixels that show it.
    pub(crate) usable: Mask,
}

/// The organ in a picture, roughly at `rough` (`true` = organ); pixels that are not `usable`
/// (instruments, beyond the viewport) say nothing. `None` where colours do not part it from its
/// surroundings.
pub(crate) fn segment(picture: &ColorImage, rough: &Mask, usable: &Mask) -> Option<Segment> {
    let cells = Cells::of(picture, rough, usable);
    let (labels, favour) = cells.labels()?;
    let (marked, unmarked) = cells.border(&labels, &favour);
    let (both, either) = cells.overlap(&labels);
    let share = |part: usize, all: usize| part as f64 / all.max(1) as f64;
    let marks = share(marked.len(), marked.len() + unmarked.len());
    if marks < ENOUGH || share(both, either) < SAME {
        return None;
    }
    let organ = cells.on_pixels(|c| labels[c]);
    let mut doubtful = cells.known.iter().map(|k| !k).collect::<Vec<_>>();
    unmarked.iter().for_each(|&c| doubtful[c] = true);
    let outline = Outline::known_off(&organ, &cells.on_pixels(|c| doubtful[c]));
    Some(Segment { outline, marked: marks, usable: organ.and(usable) })
}

/// Square cells of some pixels each.
struct Cells {
    /// Width and height of the picture, px.
    pixels: [usize; 2],
    /// Side of a cell, px.
    step: usize,
    /// Width and height in cells.
    size: [usize; 2],
    /// Every colour in units of its spread, 0 to 1.
    colours: Vec<[f64; 3]>,
    /// Whether half of the pixels are usable.
    known: Vec<bool>,
    rough: Vec<bool>,
    /// Signed distance from the rough outline, of the diagonal of the picture.
    distance: Vec<f64>,
    /// Mean squared difference of neighbours.
    texture: f64,
}

impl Cells {
    fn of(picture: &ColorImage, rough: &Mask, usable: &Mask) -> Self {
        let [w, h] = picture.size;
        let step = ((diagonal(picture.size) / CELLS).round() as usize).max(1);
        let size = [w / step, h / step];
        let mut colours = Vec::with_capacity(size[0] * size[1]);
        let (mut known, mut inside) = (Vec::new(), Vec::new());
        for cell in 0..size[0] * size[1] {
            let [x, y] = [cell % size[0] * step, cell / size[0] * step];
            let (mut sum, mut count, mut organ) = ([0.0; 3], 0, 0);
            for i in (0..step * step).map(|k| (y + k / step) * w + x + k % step) {
                organ += usize::from(rough.data[i]);
                if usable.data[i] {
                    count += 1;
                    (0..3).for_each(|c| sum[c] += f64::from(picture.data[i][c]));
                }
            }
            colours.push(colour(sum.map(|s| s / f64::from(count.max(1)))));
            known.push(2 * count as usize >= step * step);
            inside.push(2 * organ >= step * step);
        }
        scale(&mut colours, &known);
        let cells = signed_distance(&Mask { size, data: inside.clone() }).data;
        let relative = step as f64 / diagonal(picture.size);
        let distance = cells.iter().map(|&d| f64::from(d) * relative).collect();
        let (pixels, rough) = (picture.size, inside);
        let mut cells = Self { pixels, step, size, colours, known, rough, distance, texture: 1.0 };
        let (sum, count) = cells.neighbours().fold((0.0, 0.0), |(sum, count), (p, q, _)| {
            (sum + squared(cells.colours[p], cells.colours[q]), count + 1.0)
        });
        cells.texture = f64::max(sum / f64::max(count, 1.0), f64::MIN_POSITIVE);
        cells
    }

    /// 1 of neighbours of one colour, less of those that differ.
    fn like(&self, p: usize, q: usize) -> f64 {
        (-squared(self.colours[p], self.colours[q]) / (2.0 * self.texture)).exp()
    }

    /// Known cells to the right, below, and on the two diagonals of that side.
    fn neighbours(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let [w, h] = self.size;
        (0..w * h)
            .flat_map(move |p| {
                let (x, y) = (p % w, p / w);
                let (right, below) = (x + 1 < w, y + 1 < h);
                [
                    right.then_some((p, p + 1, 1.0)),
                    below.then_some((p, p + w, 1.0)),
                    (right && below).then(|| (p, p + w + 1, std::f64::consts::FRAC_1_SQRT_2)),
                    (x > 0 && below).then(|| (p, p + w - 1, std::f64::consts::FRAC_1_SQRT_2)),
                ]
                .into_iter()
                .flatten()
            })
            .filter(|&(p, q, _)| self.known[p] && self.known[q])
    }

    /// The labels of least energy, and what the colours say for the organ; `None` where one label
    /// is left.
    fn labels(&self) -> Option<(Vec<bool>, Vec<f64>)> {
        let whole = |e: f64| (e / UNIT).round() as i32;
        let cost = |(p, q, near): (usize, usize, f64)| {
            (p as u32, q as u32, whole(LAMBDA * near * self.like(p, q)))
        };
        let graph = Graph::new(self.known.len(), self.neighbours().map(cost));
        let mut labels = self.rough.clone();
        let mut favour = Vec::new();
        for _ in 0..CUTS {
            favour = self.favour(&labels)?;
            let held = |c: usize| match self.distance[c] {
                d if d < -INNER => whole(KEPT),
                d if d > OUTER => whole(-KEPT),
                _ => whole(favour[c]),
            };
            let next = graph.labels((0..labels.len()).map(held).collect());
            let settled = next == labels;
            labels = next;
            if settled {
                break;
            }
        }
        let with_tools =
            (0..labels.len()).map(|c| labels[c] || !self.known[c] && self.rough[c]).collect();
        let one = Mask { size: self.size, data: with_tools }.largest_component();
        Some((one.data, favour))
    }

    /// What the colour of every cell says for the organ, as labelled so far; `None` where a label
    /// has no cells.
    fn favour(&self, labels: &[bool]) -> Option<Vec<f64>> {
        let mut counts = [vec![0.0; BINS.pow(3)], vec![0.0; BINS.pow(3)]];
        for c in (0..labels.len()).filter(|&c| self.known[c]) {
            counts[usize::from(labels[c])][bin(self.colours[c])] += 1.0;
        }
        let likely = counts.map(likelihoods);
        let [Some(other), Some(organ)] = likely else { return None };
        let say = |b: usize| (organ[b] / other[b]).ln().clamp(-MOST, MOST);
        let of = |c: usize| if self.known[c] { say(bin(self.colours[c])) } else { 0.0 };
        Some((0..labels.len()).map(of).collect())
    }

    /// Cells of the organ on its border, where colours differ across it and where they do not.
    fn border(&self, labels: &[bool], favour: &[f64]) -> (Vec<usize>, Vec<usize>) {
        let [w, h] = self.size;
        let edge = |&c: &usize| {
            let (x, y) = (c % w, c / w);
            labels[c]
                && self.known[c]
                && x > 0
                && y > 0
                && x + 1 < w
                && y + 1 < h
                && [c - 1, c + 1, c - w, c + w].iter().any(|&q| !labels[q] && self.known[q])
        };
        (0..w * h).filter(edge).partition(|&c| {
            let contrast = self.contrast(c, labels, favour);
            contrast > MARKED || contrast > 0.0 && self.alike(c, labels) < STEP
        })
    }

    /// Known cells within [`NEAR`] cells of one.
    fn near(&self, c: usize) -> impl Iterator<Item = usize> {
        let [w, h] = self.size;
        let (x, y) = (c % w, c / w);
        let rows = y.saturating_sub(NEAR)..(y + NEAR + 1).min(h);
        rows.flat_map(move |v| {
            (x.saturating_sub(NEAR)..(x + NEAR + 1).min(w)).map(move |u| v * w + u)
        })
        .filter(|&q| self.known[q])
    }

    /// Difference of what the colours say on the two sides of a border, near a cell on it.
    fn contrast(&self, c: usize, labels: &[bool], favour: &[f64]) -> f64 {
        let mut sums = [(0.0, 0.0); 2];
        for q in self.near(c) {
            let (sum, count) = &mut sums[usize::from(labels[q])];
            (*sum, *count) = (*sum + favour[q], *count + 1.0);
        }
        let [other, organ] = sums.map(|(sum, count)| sum / f64::max(count, 1.0));
        organ - other
    }

    /// How alike neighbours are across a border, near a cell on it.
    fn alike(&self, c: usize, labels: &[bool]) -> f64 {
        let [w, h] = self.size;
        let across = self.near(c).flat_map(|p| {
            let right = (p % w + 1 < w).then_some(p + 1);
            let below = (p / w + 1 < h).then_some(p + w);
            let beside = right.into_iter().chain(below).filter(|&q| self.known[q]);
            beside.map(move |q| (p, q)).filter(|&(p, q)| labels[p] != labels[q])
        });
        let (sum, count) =
            across.fold((0.0, 0.0), |(sum, count), (p, q)| (sum + self.like(p, q), count + 1.0));
        sum / f64::max(count, 1.0)
    }

    /// Known cells that both the labels and the rough silhouette hold for the organ, and that
    /// either does.
    fn overlap(&self, labels: &[bool]) -> (usize, usize) {
        let known = (0..labels.len()).filter(|&c| self.known[c]);
        known.fold((0, 0), |(both, either), c| {
            let (a, b) = (labels[c], self.rough[c]);
            (both + usize::from(a && b), either + usize::from(a || b))
        })
    }

    fn on_pixels(&self, of: impl Fn(usize) -> bool) -> Mask {
        let [w, h] = self.pixels;
        let cell = |i: usize| {
            let x = (i % w / self.step).min(self.size[0] - 1);
            let y = (i / w / self.step).min(self.size[1] - 1);
            of(y * self.size[0] + x)
        };
        Mask { size: self.pixels, data: (0..w * h).map(cell).collect() }
    }
}

/// Darkest light that has a colour: an 8-bit value of 2.
const DARK: f64 = 6e-4;

fn colour(rgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(|v| v.max(DARK).ln());
    [r - g, b - g, r.max(g).max(b)]
}

/// Every colour as a share of the way from the first to the last hundredth of the known.
fn scale(colours: &mut [[f64; 3]], known: &[bool]) {
    for c in 0..3 {
        let mut all: Vec<f64> =
            colours.iter().zip(known).filter(|k| *k.1).map(|k| k.0[c]).collect();
        if all.is_empty() {
            return;
        }
        all.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| all[(share * (all.len() - 1) as f64) as usize];
        let (low, high) = (at(TAIL), at(1.0 - TAIL));
        let span = (high - low).max(f64::MIN_POSITIVE);
        colours.iter_mut().for_each(|k| k[c] = ((k[c] - low) / span).clamp(0.0, 1.0));
    }
}

fn squared(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|c| (a[c] - b[c]).powi(2)).sum()
}

fn bin(colour: [f64; 3]) -> usize {
    colour.iter().fold(0, |b, v| b * BINS + ((v * BINS as f64) as usize).min(BINS - 1))
}

/// Of counts in bins, smoothed by (1, 2, 1)/4 along every colour; `None` of none.
fn likelihoods(mut counts: Vec<f64>) -> Option<Vec<f64>> {
    for stride in [1, BINS, BINS * BINS] {
        let before = counts.clone();
        for (b, count) in counts.iter_mut().enumerate() {
            let along = b / stride % BINS;
            let low = if along > 0 { before[b - stride] } else { before[b] };
            let high = if along + 1 < BINS { before[b + stride] } else { before[b] };
            *count = 0.25 * low + 0.5 * before[b] + 0.25 * high;
        }
    }
    let all: f64 = counts.iter().sum();
    let anything = ANYTHING / counts.len() as f64;
    (all > 0.0).then(|| counts.iter().map(|n| (1.0 - ANYTHING) * n / all + anything).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;

    const SIZE: [usize; 2] = [320, 240];

    fn disc(x: f64, y: f64, r: f64) -> Mask {
        let inside = |i: usize| ((i % 320) as f64 - x).hypot((i / 320) as f64 - y) <= r;
        Mask { size: SIZE, data: (0..320 * 240).map(inside).collect() }
    }

    /// Yellow where `organ` is and red elsewhere, shaded from left to right, with a grain of a
    /// tenth.
    fn picture(organ: &Mask) -> ColorImage {
        let pixel = |i: usize| {
            let grain = 0.9 + 0.2 * ((i * 7919 % 1009) as f32 / 1009.0);
            let light = grain * (0.3 + 0.5 * (i % 320) as f32 / 320.0);
            let colour = if organ.data[i] { [0.8, 0.6, 0.3] } else { [0.7, 0.25, 0.2] };
            colour.map(|c: f32| c * light)
        };
        ColorImage { size: SIZE, data: (0..320 * 240).map(pixel).collect() }
    }

    fn everywhere() -> Mask {
        Mask::filled(SIZE, true)
    }

    /// Points of a circle.
    fn around(x: f64, y: f64, r: f64) -> impl Iterator<Item = Point2> {
        let at = move |k: u32| (f64::from(k) * 0.1).sin_cos();
        (0..63).map(at).map(move |(sin, cos)| Point2::new(x + r * cos, y + r * sin))
    }

    #[test]
    fn colours_bring_a_rough_silhouette_to_the_outline() {
        let organ = disc(150.0, 120.0, 60.0);
        let tool = disc(210.0, 120.0, 12.0);
        let rough = disc(158.0, 114.0, 57.0);
        let found = segment(&picture(&organ), &rough, &tool.complement()).unwrap();
        let mut known = 0;
        for p in around(150.0, 120.0, 60.0) {
            if found.outline.known_at(&p) {
                known += 1;
                let off = found.outline.distance.sample(&p).unwrap().0;
                assert!(off.abs() < 2.0, "{p}: {off} px");
            } else {
                assert!((p - Point2::new(210.0, 120.0)).norm() < 22.0, "{p} is not known");
            }
        }
        assert!(known > 50, "{known}");
        assert!(found.usable.minus(&organ.dilate(2.0)).coverage() == 0.0);
        assert!(found.usable.and(&tool).coverage() == 0.0);
    }

    #[test]
    fn an_outline_that_no_colour_marks_is_not_known() {
        // The organ goes on to the right of the mesh, whose silhouette ends in the middle of it.
        let columns = |kept: std::ops::Range<usize>| Mask {
            size: SIZE,
            data: (0..320 * 240).map(|i| kept.contains(&(i % 320))).collect(),
        };
        let (organ, rough) = (columns(101..320), columns(104..260));
        let found = segment(&picture(&organ), &rough, &everywhere()).unwrap();
        let known = |x: f64| found.outline.known_at(&Point2::new(x, 120.0));
        assert!(known(100.0) && !known(260.0));
        // And nowhere at all in one colour.
        assert!(segment(&picture(&everywhere()), &rough, &everywhere()).is_none());
        assert!(segment(&picture(&organ), &everywhere(), &everywhere()).is_none());
    }

    #[test]
    fn an_outline_elsewhere_is_not_that_of_the_silhouette() {
        let found =
            segment(&picture(&disc(80.0, 120.0, 50.0)), &disc(240.0, 120.0, 50.0), &everywhere());
        assert!(found.is_none());
    }
}
