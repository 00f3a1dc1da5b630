//! SIFT (Lowe 2004): extrema of differences of Gaussians of the doubled image, one keypoint for
//! every dominant gradient direction, and histograms of gradients around.
//!
//! Written for processors with wide registers: every pass over the image goes along rows, blurs and
//! the search for extrema in strips, and only what a mask lets through is described. The same bits
//! at any number of threads.

mod descriptor;
mod extrema;
mod orientation;
mod scale_space;

use crate::geometry::Point2;
use crate::image::Plane;
use extrema::Extremum;
use rayon::prelude::*;

/// One keypoint with its descriptor.
#[derive(Clone, Debug)]
pub(super) struct Keypoint {
    /// Position, px.
    pub point: Point2,
    /// Standard deviation of the Gaussian at which it was found, px.
    pub scale: f32,
    /// Dominant gradient direction, radians, clockwise from +x (y points down).
    pub angle: f32,
    /// Histogram of 4 × 4 cells of 8 directions, 0 to 255.
    pub descriptor: [f32; 128],
}

/// The strongest `most` keypoints of a grey image in `[0, 1]` at which `usable` holds, strongest
/// first; none for an image that is too small.
pub(super) fn sift(
    grey: &Plane,
    contrast: f64,
    most: usize,
    usable: &(dyn Fn(&Point2) -> bool + Sync),
) -> Vec<Keypoint> {
    let octaves = scale_space::octaves(grey);
    let mut strongest: Vec<(usize, Extremum)> = Vec::new();
    for (o, octave) in octaves.iter().enumerate() {
        let extrema = extrema::find(octave, contrast).into_iter();
        strongest.extend(extrema.map(|e| (o, e)).filter(|(o, e)| usable(&place(*o, e))));
    }
    // Stable: equal responses stay in the order of octaves, rows and columns.
    strongest.sort_by(|a, b| b.1.response.total_cmp(&a.1.response));
    // Nearly every extremum has a direction, so that no more of them are asked than are wanted.
    let mut found: Vec<(usize, Extremum, f32)> = Vec::new();
    for some in strongest.chunks(most.max(1)) {
        let directions = |(o, e): &(usize, Extremum)| orientation::dominant(&octaves[*o], e);
        let angles: Vec<Vec<f32>> = some.par_iter().map(directions).collect();
        for ((o, e), angles) in some.iter().zip(angles) {
            found.extend(angles.into_iter().map(|angle| (*o, *e, angle)));
        }
        if found.len() >= most {
            break;
        }
    }
    found.truncate(most);
    let describe = |(o, e, angle): &(usize, Extremum, f32)| Keypoint {
        point: place(*o, e),
        scale: (0.5 * f64::from(1u32 << o)) as f32 * e.sigma,
        angle: *angle,
        descriptor: descriptor::describe(&octaves[*o], e, *angle),
    };
    found.par_iter().with_min_len(64).map(describe).collect()
}

/// From pixels of an octave to those of the image: pixels of the doubled image lie at the quarters,
/// and every octave keeps every second pixel of the one before.
fn place(octave: usize, e: &Extremum) -> Point2 {
    let of = |v: f32| 0.5 * f64::from(v) * f64::from(1u32 << octave) - 0.25;
    Point2::new(of(e.x), of(e.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [96, 80];

    /// Centre, standard deviation and height of a Gaussian.
    type Blob = ([f64; 2], f64, f64);

    const FEW: [Blob; 3] =
        [([30.3, 21.6], 3.0, 0.4), ([61.0, 40.2], 2.0, -0.3), ([44.7, 55.1], 4.0, 0.3)];

    /// Blobs over grey, turned by `turn` about the middle.
    fn blobs(all: &[Blob], turn: f64) -> Plane {
        let value = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f64 - 47.5, (i / SIZE[0]) as f64 - 39.5);
            let (s, c) = turn.sin_cos();
            let (x, y) = (c * x + s * y + 47.5, -s * x + c * y + 39.5);
            let bell = |([bx, by], s, h): &Blob| {
                h * (-((x - bx).powi(2) + (y - by).powi(2)) / (2.0 * s * s)).exp()
            };
            (0.4 + all.iter().map(bell).sum::<f64>()) as f32
        };
        Plane { size: SIZE, data: (0..SIZE[0] * SIZE[1]).map(value).collect() }
    }

    fn near(found: &[Keypoint], x: f64, y: f64) -> &Keypoint {
        let away = |k: &&Keypoint| (k.point - Point2::new(x, y)).norm();
        found.iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap()
    }

    #[test]
    fn blobs_are_found_where_they_are_at_their_scale() {
        let found = sift(&blobs(&FEW, 0.0), 0.01, 1000, &|_| true);
        let k = near(&found, 30.3, 21.6);
        assert!((k.point - Point2::new(30.3, 21.6)).norm() < 0.05, "{:?}", k.point);
        // The difference of Gaussians is largest at the blob's own deviation, less the assumed
        // blur's.
        assert!((k.scale / 3.0 - 1.0).abs() < 0.2, "{}", k.scale);
        // Whatever is left out makes room for nothing else.
        let left = sift(&blobs(&FEW, 0.0), 0.01, 1000, &|p| p.x > 40.0);
        assert!(left.iter().all(|k| k.point.x > 40.0));
        assert_eq!(left.len(), found.iter().filter(|k| k.point.x > 40.0).count());
    }

    #[test]
    fn a_turned_image_has_the_same_descriptors() {
        let turn = 0.6f64;
        // Blobs of many sizes, strewn by the golden ratio.
        let strewn: Vec<Blob> = (0..150)
            .map(|i| {
                let at = |n: f64| (f64::from(i) * n).fract() * 80.0 - 40.0;
                let sigma = 1.2 + 0.1 * f64::from(i % 13);
                (
                    [47.5 + at(0.618_034), 39.5 + at(0.754_878)],
                    sigma,
                    if i % 3 == 0 { -0.2 } else { 0.15 },
                )
            })
            .collect();
        let [upright, turned] =
            [0.0, turn].map(|turn| sift(&blobs(&strewn, turn), 0.01, 1000, &|_| true));
        let away = |a: &Keypoint, b: &Keypoint| -> f32 {
            a.descriptor.iter().zip(&b.descriptor).map(|(x, y)| (x - y).powi(2)).sum()
        };
        let (mut all, mut good) = (0, 0);
        for a in upright.iter().filter(|k| (k.point - Point2::new(47.5, 39.5)).norm() < 22.0) {
            let b = turned.iter().min_by(|b, c| away(a, b).total_cmp(&away(a, c))).unwrap();
            let (x, y) = (a.point.x - 47.5, a.point.y - 39.5);
            let (s, c) = turn.sin_cos();
            let place = Point2::new(c * x - s * y + 47.5, s * x + c * y + 39.5);
            let around = f64::from(b.angle - a.angle) - turn;
            let same = (place - b.point).norm() < 0.5
                && around.sin().abs() < 0.1
                && around.cos() > 0.0
                && (b.scale / a.scale - 1.0).abs() < 0.1;
            all += 1;
            good += usize::from(same);
        }
        assert!(all > 20 && 3 * good > 2 * all, "{good} of {all}");
    }

    #[test]
    fn the_same_bits_at_any_number_of_threads_and_nothing_from_nothing() {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = pool.install(|| sift(&blobs(&FEW, 0.2), 0.005, 1000, &|_| true));
            found.iter().map(|k| (k.point, k.scale, k.angle, k.descriptor)).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(2));
        for size in [[0, 0], [1, 1], [7, 5], [40, 30]] {
            assert!(sift(&Plane::filled(size, 0.5), 0.006, 1000, &|_| true).is_empty());
        }
    }
}
