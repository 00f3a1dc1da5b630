//! Image beside prediction over the visible surface: what of it shows the template, and how well.
//!
//! Image and predicted light (albedo under the light, at the surface) are averaged over the same
//! pixels of small blocks and compared as logarithms, in which an exposure is a constant. A tile of
//! blocks says three things: its mean difference (brightness), that of red to green (colour), and,
//! where the prediction has texture, whether the image has the same (zero-mean correlation, and the
//! slope of one on the other: 1 where it is as strong, 0 where a flat thing hides it, less through
//! blur and smoke).

use crate::camera::{Camera, CameraModel};
use crate::geometry::{Point3, centre_and_spread, median};
use crate::image::{Mask, Picture, diagonal};
use crate::mesh::Mesh;
use crate::raster::{Raster, rasterize};
use crate::template::SurfaceTexels;
use crate::template::usual::Appearance;
use rayon::prelude::*;

/// Blocks along the diagonal, at most: a surface a third of a millimetre off must not look strange.
/// A picture of that size says as much as a larger one.
pub(crate) const BLOCKS: f64 = 460.0;

/// Side of a tile, of the diagonal: at least a hundred blocks.
const TILE: f64 = 0.028;

/// Least share of a tile, or of a block, that counts.
const HALF: f64 = 0.5;

/// Light that a camera cannot tell from none, linear.
const DARK: f32 = 0.004;

/// Least spread of the predicted logarithm over a tile for its structure to tell: below, noise
/// decides.
const TEXTURE: f64 = 0.03;

/// What is nearer to a saturated pixel may be glare, and to a predicted contour another surface; of
/// the diagonal.
const HALO: f64 = 0.012;
const CONTOUR: f64 = 0.006;

/// What is compared.
pub(crate) struct Compared<'a> {
    /// Camera of the frame.
    pub(crate) camera: &'a CameraModel,
    /// Linear light.
    pub(crate) picture: &'a Picture,
    /// `true` where the organ may be seen.
    pub(crate) usable: &'a Mask,
    /// Albedo of the template.
    pub(crate) albedo: &'a SurfaceTexels,
    /// Ambient light of the frame in units of its exposure, linear; 0 where it is not known.
    pub(crate) ambient: f64,
}

/// When a tile shows the template.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileLimits {
    /// Largest difference of the logarithms from that of the frame: brightness, colour.
    pub(crate) log: [f64; 2],
    /// Least correlation.
    pub(crate) correlation: f64,
    /// Least slope, of the frame's usual one.
    pub(crate) slope: f64,
}

/// One tile.
#[derive(Clone, Copy, Debug)]
struct Tile {
    /// Blocks of the silhouette in it, and those that can be compared.
    blocks: [usize; 2],
    /// Mean differences of the logarithms: brightness, colour.
    log: [f64; 2],
    /// Correlation and slope, where there is texture.
    structure: Option<[f64; 2]>,
}

/// What one tile says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TileVerdict {
    /// It looks like the template.
    Agrees,
    /// It does not.
    Contradicts,
    /// It cannot be compared.
    Nothing,
}

/// A frame looked at.
pub(crate) struct ImageAgreement {
    /// What the frame as a whole shows.
    pub(crate) appearance: Appearance,
    /// Pixels a tile is wide.
    side: usize,
    /// Tiles in a row.
    columns: usize,
    tiles: Vec<TileVerdict>,
}

impl ImageAgreement {
    /// What the image says where a point of the surface appears.
    pub(crate) fn at(&self, camera: &CameraModel, point: &Point3) -> TileVerdict {
        let Some(pixel) = camera.project(point).map(|p| p.pixel) else {
            return TileVerdict::Nothing;
        };
        let tile = pixel.coords.map(|c| (c + 0.5).floor() / self.side as f64);
        let inside = tile.iter().all(|c| *c >= 0.0) && tile.x < self.columns as f64;
        let index = tile.y as usize * self.columns + tile.x as usize;
        if inside {
            self.tiles.get(index).copied().unwrap_or(TileVerdict::Nothing)
        } else {
            TileVerdict::Nothing
        }
    }
}

/// Compare a frame with what template and light predict at a shape (camera axes; `lit`: the diffuse
/// shading of its vertices); `None` where next to nothing can be compared.
pub(crate) fn look(
    compared: &Compared,
    rest: &Mesh,
    shape: &[Point3],
    lit: &[f64],
    limits: &TileLimits,
) -> Option<ImageAgreement> {
    let raster = rasterize(compared.camera, &rest.topology, shape);
    let diagonal = diagonal(raster.size);
    let block = (diagonal / BLOCKS).ceil().max(1.0) as usize;
    let along = ((TILE * diagonal / block as f64).round() as usize).max(4);
    let blocks = Blocks::of(compared, rest, lit, &raster, block);
    let (columns, tiles) = blocks.tiles(along);
    judge(&tiles, limits).map(|(appearance, tiles)| ImageAgreement {
        appearance,
        side: along * block,
        columns,
        tiles,
    })
}

/// Image and prediction in blocks of pixels.
struct Blocks {
    size: [usize; 2],
    /// The block shows surface.
    surface: Vec<bool>,
    /// Logarithms of brightness and of red over green: image, then prediction.
    pairs: Vec<Option<[[f64; 2]; 2]>>,
}

impl Blocks {
    fn of(compared: &Compared, rest: &Mesh, lit: &[f64], raster: &Raster, block: usize) -> Self {
        let Compared { picture, usable, albedo, ambient, .. } = *compared;
        let predicted = raster.render_quarters([f32::NAN; 3], |face, quarters| {
            let corners = rest.topology.faces[face];
            let shade =
                |b: &[f64; 3]| -> f64 { (0..3).map(|k| b[k] * lit[corners[k] as usize]).sum() };
            let shade = quarters.iter().map(shade).sum::<f64>() / 4.0;
            let shown = picture.shown(albedo.observed_mean(face, quarters));
            shown.map(|a| a * shade as f32 + ambient as f32)
        });
        let diagonal = diagonal(raster.size);
        let contour = raster.discontinuities(0.05).dilate(CONTOUR * diagonal);
        let halo = (HALO * diagonal) as f32;
        let counts = |i: usize| {
            usable.data[i]
                && !contour.data[i]
                && picture.clipped[i] == [false; 3]
                && picture.to_saturated[i] > halo
                && !predicted[i][0].is_nan()
        };
        let [w, h] = raster.size;
        let size = [w.div_ceil(block), h.div_ceil(block)];
        let one = |at: usize| {
            let (x, y) = (at % size[0] * block, at / size[0] * block);
            let (mut count, mut total, mut shown) = (0, 0, 0);
            let (mut seen, mut told) = ([0.0_f32; 3], [0.0_f32; 3]);
            let rows = y..(y + block).min(h);
            for i in rows.flat_map(|row| row * w + x..row * w + (x + block).min(w)) {
                total += 1;
                shown += usize::from(raster.face[i] != u32::MAX);
                if counts(i) {
                    count += 1;
                    (0..3).for_each(|c| seen[c] += picture.linear.data[i][c]);
                    (0..3).for_each(|c| told[c] += predicted[i][c]);
                }
            }
            let enough = count > 0 && count as f64 >= HALF * f64::from(total as u32);
            let pair = enough.then(|| [seen, told].map(|rgb| logs(rgb.map(|v| v / count as f32))));
            (2 * shown > total, pair)
        };
        let (surface, pairs) = (0..size[0] * size[1]).into_par_iter().map(one).unzip();
        Self { size, surface, pairs }
    }

    /// Number of tiles in a row, and all tiles, row by row.
    fn tiles(&self, along: usize) -> (usize, Vec<Tile>) {
        let size = self.size.map(|n| n.div_ceil(along));
        let tile = |t: usize| {
            let (x, y) = (t % size[0] * along, t / size[0] * along);
            let rows = y..(y + along).min(self.size[1]);
            let columns = x..(x + along).min(self.size[0]);
            let all = rows.flat_map(|r| columns.clone().map(move |c| r * self.size[0] + c));
            let all: Vec<usize> = all.filter(|&i| self.surface[i]).collect();
            let pairs: Vec<&[[f64; 2]; 2]> =
                all.iter().filter_map(|&i| self.pairs[i].as_ref()).collect();
            Tile::of(all.len(), &pairs)
        };
        (size[0], (0..size[0] * size[1]).map(tile).collect())
    }
}

/// Logarithms of brightness, and of red over green.
fn logs(rgb: [f32; 3]) -> [f64; 2] {
    let [r, g, b] = rgb.map(|v| f64::from(v.max(0.0) + DARK));
    [((r + g + b) / 3.0).ln(), (r / g).ln()]
}

impl Tile {
    fn of(surface: usize, pairs: &[&[[f64; 2]; 2]]) -> Self {
        let n = pairs.len().max(1) as f64;
        let mean = |which: usize, of: usize| pairs.iter().map(|p| p[which][of]).sum::<f64>() / n;
        let means = [[mean(0, 0), mean(0, 1)], [mean(1, 0), mean(1, 1)]];
        let (mut own, mut cross, mut other) = (0.0, 0.0, 0.0);
        for p in pairs {
            let (seen, told) = (p[0][0] - means[0][0], p[1][0] - means[1][0]);
            own += told * told / n;
            cross += told * seen / n;
            other += seen * seen / n;
        }
        let textured = own.sqrt() > TEXTURE;
        Self {
            blocks: [surface, pairs.len()],
            log: [means[0][0] - means[1][0], means[0][1] - means[1][1]],
            structure: textured.then(|| [cross / (own * other).sqrt().max(1e-12), cross / own]),
        }
    }

    fn tells(&self) -> bool {
        self.blocks[1] >= 4 && self.blocks[1] as f64 >= HALF * self.blocks[0] as f64
    }
}

/// Fewest tiles that tell anything of a frame.
const FEWEST: usize = 6;

fn judge(tiles: &[Tile], limits: &TileLimits) -> Option<(Appearance, Vec<TileVerdict>)> {
    let told: Vec<&Tile> = tiles.iter().filter(|t| t.tells()).collect();
    if told.len() < FEWEST {
        return None;
    }
    let structure: Vec<[f64; 2]> = told.iter().filter_map(|t| t.structure).collect();
    let of = |k: usize| median(&mut structure.iter().map(|s| s[k]).collect::<Vec<f64>>());
    // The exposure is that of what looks like the template, where enough does: what hides most of
    // the organ must not pass for it.
    let alike = |t: &&&Tile| t.structure.is_some_and(|s| s[0] > limits.correlation);
    let sure: Vec<&&Tile> = told.iter().filter(alike).collect();
    let sure: Vec<&&Tile> = if sure.len() < FEWEST { told.iter().collect() } else { sure };
    let [(log, spread), (colour, _)] =
        [0, 1].map(|k| centre_and_spread(&mut sure.iter().map(|t| t.log[k]).collect::<Vec<f64>>()));
    let strong =
        median(&mut sure.iter().filter_map(|t| t.structure.map(|s| s[1])).collect::<Vec<f64>>());
    let says = |tile: &Tile| {
        let like = (tile.log[0] - log).abs() < limits.log[0]
            && (tile.log[1] - colour).abs() < limits.log[1];
        let same = tile.structure.is_none_or(|[alike, slope]| {
            alike > limits.correlation && slope > limits.slope * strong.unwrap_or(1.0)
        });
        match tile.tells() {
            false => TileVerdict::Nothing,
            true if like && same => TileVerdict::Agrees,
            true => TileVerdict::Contradicts,
        }
    };
    let all: Vec<TileVerdict> = tiles.iter().map(says).collect();
    let area = |which: &dyn Fn(TileVerdict) -> bool| -> f64 {
        let those = tiles.iter().zip(&all).filter(|(_, s)| which(**s));
        those.map(|(t, _)| t.blocks[0] as f64).sum()
    };
    let (agrees, whole) = (area(&|s| s == TileVerdict::Agrees), area(&|_| true));
    let compared = area(&|s| s != TileVerdict::Nothing);
    let appearance = Appearance {
        correlation: of(0),
        contrast: of(1),
        residual: spread,
        shown: agrees / compared.max(1.0),
        compared: compared / whole.max(1.0),
    };
    Some((appearance, all))
}
