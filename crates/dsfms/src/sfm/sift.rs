//! SIFT (Lowe 2004): extrema of differences of Gaussians of the doubled image, one keypoint for every
//! dominant gradient direction, and histograms of gradients around.
//!
//! Written for processors with wide registers: every pass over the image goes along rows, blurs and the
//! search for extrema in strips, and only what a mask lets through is described. The same bits at any
//! number of threads.

mod descriptor;
mod extrema;
mod orientation;
mod scale_space;

use crate::geometry::Point2;
use crate::image::Plane;
use extrema::Extremum;
use rayon::prelude::*;

/// Layers of an octave that are searched.
const LAYERS: usize = 3;
/// Standard deviation of the first layer, px of the octave.
const SIGMA: f64 = 1.6;
/// Blur that the image itself is taken to have, px.
const CAMERA_BLUR: f64 = 0.5;

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

/// The strongest `most` keypoints of a grey image in `[0, 1]` at which `usable` holds, strongest first;
/// none for an image that is too small.
pub(super) fn sift(
    grey: &Plane,
    contrast: f64,
    most: usize,
    usable: &(dyn Fn(&Point2) -> bool + Sync),
) -> Vec<Keypoint> {
    let octaves = scale_space::octaves(grey);
    let mut found: Vec<(usize, Extremum, f32)> = Vec::new();
    for (o, octave) in octaves.iter().enumerate() {
        let mut extrema = extrema::find(octave, contrast);
        extrema.retain(|e| usable(&place(o, e)));
        let angles: Vec<Vec<f32>> =
            extrema.par_iter().map(|e| orientation::dominant(octave, e)).collect();
        for (e, angles) in extrema.iter().zip(angles) {
            found.extend(angles.into_iter().map(|angle| (o, *e, angle)));
        }
    }
    // Stable: equal responses stay in the order of octaves, rows and columns.
    found.sort_by(|a, b| b.1.response.total_cmp(&a.1.response));
    found.truncate(most);
    let describe = |(o, e, angle): &(usize, Extremum, f32)| Keypoint {
        point: place(*o, e),
        scale: (0.5 * f64::from(1u32 << o)) as f32 * e.sigma,
        angle: *angle,
        descriptor: descriptor::describe(&octaves[*o], e, *angle),
    };
    found.par_iter().with_min_len(64).map(describe).collect()
}

/// From pixels of an octave to those of the image: pixels of the doubled image lie at the quarters, and
/// every octave keeps every second pixel of the one before.
fn place(octave: usize, e: &Extremum) -> Point2 {
    let of = |v: f32| 0.5 * f64::from(v) * f64::from(1u32 << octave) - 0.25;
    Point2::new(of(e.x), of(e.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [96, 80];

    /// Gaussian blobs (centre, standard deviation, height) over grey, turned by `turn` about the middle.
    fn blobs(turn: f64) -> Plane {
        let all = [
            ([30.3, 21.6], 3.0, 0.4),
            ([61.0, 40.2], 2.0, -0.3),
            ([44.7, 55.1], 4.0, 0.3),
            ([52.0, 30.0], 2.5, 0.3),
        ];
        let value = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f64 - 47.5, (i / SIZE[0]) as f64 - 39.5);
            let (s, c) = turn.sin_cos();
            let (x, y) = (c * x + s * y + 47.5, -s * x + c * y + 39.5);
            let sum: f64 = all
                .iter()
                .map(|([bx, by], s, h)| {
                    h * (-((x - bx).powi(2) + (y - by).powi(2)) / (2.0 * s * s)).exp()
                })
                .sum();
            (0.4 + sum) as f32
        };
        Plane { size: SIZE, data: (0..SIZE[0] * SIZE[1]).map(value).collect() }
    }

    fn near(found: &[Keypoint], x: f64, y: f64) -> &Keypoint {
        let away = |k: &&Keypoint| (k.point - Point2::new(x, y)).norm();
        found.iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap()
    }

    #[test]
    fn blobs_are_found_where_they_are_at_their_scale() {
        let found = sift(&blobs(0.0), 0.01, 1000, &|_| true);
        let k = near(&found, 30.3, 21.6);
        assert!((k.point - Point2::new(30.3, 21.6)).norm() < 0.05, "{:?}", k.point);
        // The difference of Gaussians is largest at the blob's own deviation, less the assumed blur's.
        assert!((k.scale / 3.0 - 1.0).abs() < 0.2, "{}", k.scale);
        // Whatever is left out makes room for nothing else.
        let left = sift(&blobs(0.0), 0.01, 1000, &|p| p.x > 40.0);
        assert!(left.iter().all(|k| k.point.x > 40.0));
        assert_eq!(left.len(), found.iter().filter(|k| k.point.x > 40.0).count());
    }

    #[test]
    fn a_turned_image_has_the_same_descriptors() {
        let turn = 0.6f64;
        let (upright, turned) =
            (sift(&blobs(0.0), 0.01, 1000, &|_| true), sift(&blobs(turn), 0.01, 1000, &|_| true));
        let (x, y) = (61.0 - 47.5, 40.2 - 39.5);
        let (s, c) = turn.sin_cos();
        let a = near(&upright, 61.0, 40.2);
        let b = near(&turned, c * x - s * y + 47.5, s * x + c * y + 39.5);
        let around = (f64::from(b.angle - a.angle) - turn).rem_euclid(std::f64::consts::TAU);
        assert!(around.min(std::f64::consts::TAU - around) < 0.05, "{} {}", a.angle, b.angle);
        let distance = |d: &[f32; 128], e: &[f32; 128]| {
            d.iter().zip(e).map(|(x, y)| (x - y).powi(2)).sum::<f32>().sqrt()
        };
        let other = near(&upright, 30.3, 21.6);
        let same = distance(&a.descriptor, &b.descriptor);
        assert!(3.0 * same < distance(&a.descriptor, &other.descriptor), "{same}");
    }

    #[test]
    fn the_same_bits_at_any_number_of_threads_and_nothing_from_nothing() {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let found = pool.install(|| sift(&blobs(0.2), 0.005, 1000, &|_| true));
            found.iter().map(|k| (k.point, k.scale, k.angle, k.descriptor)).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(2));
        for size in [[0, 0], [1, 1], [7, 5], [40, 30]] {
            assert!(sift(&Plane::filled(size, 0.5), 0.006, 1000, &|_| true).is_empty());
        }
    }
}
