//! Contrast-limited adaptive histogram equalisation (Zuiderveld 1994), byte for byte as OpenCV's
//! `createCLAHE`: every tile has a look-up table of its own, a pixel blends those of the four tiles
//! about it.

use super::Plane;
use rayon::prelude::*;

/// Grey values of the histograms.
const LEVELS: usize = 256;

type Lut = [u8; LEVELS];

/// How the image is divided: `count` tiles of `size` px, both `[across, down]`.
#[derive(Clone, Copy)]
struct Tiles {
    count: [usize; 2],
    size: [usize; 2],
}

impl Tiles {
    /// Equal tiles that cover the image. Where one side does not divide evenly both are extended,
    /// the even one by a whole tile row, as in OpenCV.
    fn over(image: [usize; 2], count: usize) -> Self {
        let even = image.iter().all(|side| side.is_multiple_of(count));
        let size = image.map(|side| if even { side / count } else { side / count + 1 });
        Self { count: [count; 2], size }
    }

    fn area(&self) -> usize {
        self.size[0] * self.size[1]
    }
}

/// Equalise the contrast of a grey image in `[0, 1]`, quantised to 256 levels.
///
/// `clip`: largest count of a level over the mean count of a level, not limited where 0 or less;
/// `tiles`: tiles along each side. The image itself where it or the number of tiles is empty.
#[doc(alias = "histogram equalisation")]
pub(crate) fn clahe(grey: &Plane, clip: f64, tiles: usize) -> Plane {
    if tiles == 0 || grey.data.is_empty() {
        return grey.clone();
    }
    let levels: Vec<u8> =
        grey.data.iter().map(|v| (v * 255.0).round().clamp(0.0, 255.0) as u8).collect();
    let tiles = Tiles::over(grey.size, tiles);
    let luts: Vec<Lut> = (0..tiles.count[0] * tiles.count[1])
        .into_par_iter()
        .map(|tile| lut(&histogram(&levels, grey.size, &tiles, tile), clip, tiles.area()))
        .collect();
    Plane { size: grey.size, data: blend(&levels, grey.size, &tiles, &luts) }
}

/// Counts of the levels in one tile; beyond the right and lower edge the image is mirrored.
fn histogram(levels: &[u8], image: [usize; 2], tiles: &Tiles, tile: usize) -> [usize; LEVELS] {
    let corner = [tile % tiles.count[0] * tiles.size[0], tile / tiles.count[0] * tiles.size[1]];
    let mut counts = [0; LEVELS];
    for y in corner[1]..corner[1] + tiles.size[1] {
        let row = &levels[mirrored(y, image[1]) * image[0]..][..image[0]];
        for x in corner[0]..corner[0] + tiles.size[0] {
            counts[row[mirrored(x, image[0])] as usize] += 1;
        }
    }
    counts
}

/// Index `i ≥ 0` folded into `0..n` without doubling the pixels of the edge.
fn mirrored(i: usize, n: usize) -> usize {
    if i < n {
        return i;
    }
    let period = (2 * (n - 1)).max(1);
    let folded = i % period;
    if folded < n { folded } else { period - folded }
}

/// The clipped histogram's cumulative sum, scaled to `0..=255`.
fn lut(counts: &[usize; LEVELS], clip: f64, area: usize) -> Lut {
    let mut counts = *counts;
    if clip > 0.0 {
        redistribute(&mut counts, ((clip * area as f64 / LEVELS as f64) as usize).max(1));
    }
    let scale = 255.0 / area as f32;
    let mut sum = 0;
    counts.map(|count| {
        sum += count;
        (sum as f32 * scale).round_ties_even().min(255.0) as u8
    })
}

/// Cut every count at `limit` and hand out the excess: evenly, what is left one by one at equal
/// steps.
fn redistribute(counts: &mut [usize; LEVELS], limit: usize) {
    let excess: usize = counts.iter().map(|count| count.saturating_sub(limit)).sum();
    let (each, left) = (excess / LEVELS, excess % LEVELS);
    for count in counts.iter_mut() {
        *count = (*count).min(limit) + each;
    }
    if let Some(step) = LEVELS.checked_div(left) {
        counts.iter_mut().step_by(step).take(left).for_each(|count| *count += 1);
    }
}

/// Where a pixel lies between the centres of two tiles, along one axis.
struct Between {
    tiles: [usize; 2],
    /// Weights of the two.
    weights: [f32; 2],
}

impl Between {
    fn of(pixel: usize, size: usize, count: usize) -> Self {
        let place = (pixel as f32).mul_add(1.0 / size as f32, -0.5);
        let first = place.floor();
        let second = place - first;
        let at = |tile: f32| (tile.max(0.0) as usize).min(count - 1);
        Self { tiles: [at(first), at(first + 1.0)], weights: [1.0 - second, second] }
    }
}

/// Bilinear blend of the look-up tables of the four tiles about every pixel, in `[0, 1]`.
fn blend(levels: &[u8], image: [usize; 2], tiles: &Tiles, luts: &[Lut]) -> Vec<f32> {
    let between = |axis: usize| move |i| Between::of(i, tiles.size[axis], tiles.count[axis]);
    let columns: Vec<Between> = (0..image[0]).map(between(0)).collect();
    let mut equalised = vec![0.0; levels.len()];
    let rows = equalised.par_chunks_mut(image[0]).zip(levels.par_chunks(image[0])).enumerate();
    rows.for_each(|(y, (target, source))| {
        let row = between(1)(y);
        let luts = row.tiles.map(|tile| &luts[tile * tiles.count[0]..][..tiles.count[0]]);
        for ((target, &level), column) in target.iter_mut().zip(source).zip(&columns) {
            let [above, below] = luts.map(|luts| {
                let [left, right] = column.tiles.map(|tile| f32::from(luts[tile][level as usize]));
                left.mul_add(column.weights[0], right * column.weights[1])
            });
            let value = above.mul_add(row.weights[0], below * row.weights[1]);
            *target = value.round_ties_even().clamp(0.0, 255.0) / 255.0;
        }
    });
    equalised
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(size: [usize; 2], levels: impl Fn(usize) -> u8) -> Plane {
        let data = (0..size[0] * size[1]).map(|i| f32::from(levels(i)) / 255.0).collect();
        Plane { size, data }
    }

    fn bytes(plane: &Plane) -> Vec<u8> {
        plane.data.iter().map(|v| (v * 255.0).round() as u8).collect()
    }

    #[test]
    fn one_tile_without_limit_maps_every_level_to_its_rank() {
        // Of 4 pixels one is at most 10, two at most 20, four at most 30: 255/4, 255/2 (63.75,
        // 127.5 to the even number), 255.
        let image = plane([2, 2], |i| [10, 20, 30, 30][i]);
        assert_eq!(bytes(&clahe(&image, 0.0, 1)), [64, 128, 255, 255]);
    }

    #[test]
    fn a_flat_tile_is_limited_and_its_excess_handed_out() {
        // 512 pixels of level 100; limit 2·512/256 = 4; of the excess of 508 every level gets 1 and
        // 252 more go to the levels 0, 1, …, 251. Up to level 100: 101·2 + 4 = 206; 206·255/512 =
        // 102.6.
        let image = plane([32, 16], |_| 100);
        assert!(bytes(&clahe(&image, 2.0, 1)).iter().all(|&level| level == 103));
    }

    #[test]
    fn equal_to_opencv_on_fixed_images() {
        // FNV-1a of the bytes from kornia-imgproc 0.2.0, which is calibrated against cv2 4.13.
        let noise = |i: usize| ((i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 56) as u8;
        let ramp = |i: usize| ((i * i / 37) % 251) as u8 / 2 + 40;
        let hash = |plane: &Plane| {
            bytes(plane).iter().fold(0xCBF2_9CE4_8422_2325_u64, |hash, &byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01B3)
            })
        };
        let found = [
            hash(&clahe(&plane([64, 48], noise), 2.0, 8)),
            hash(&clahe(&plane([61, 48], ramp), 2.0, 8)),
            hash(&clahe(&plane([97, 53], ramp), 3.5, 5)),
            hash(&clahe(&plane([40, 30], noise), 0.0, 4)),
            hash(&clahe(&plane([3, 2], ramp), 2.0, 8)),
        ];
        let expected = [
            0x502e_d692_9109_e886,
            0x68a4_9a23_bdd8_c87c,
            0xf79d_dc7e_c4a5_428e,
            0x4dce_ca98_bbb1_aef6,
            0x7085_37aa_d943_f66f,
        ];
        assert_eq!(found, expected);
    }
}
