//! Exact Euclidean distance transform (Felzenszwalb and Huttenlocher, *Distance Transforms of
//! Sampled Functions*): lower envelopes of parabolas, first along columns, then along rows.

use super::{Mask, Plane};
use rayon::prelude::*;

/// Distance in px from every pixel centre to the nearest `true` pixel centre; 0 in the mask. With
/// no `true` pixel at all, the image's diagonal everywhere.
pub fn distance_to(mask: &Mask) -> Plane {
    let [w, h] = mask.size;
    let mut columns = vec![f64::INFINITY; w * h];
    // Column major, so that each column is one slice.
    columns.par_chunks_mut(h.max(1)).enumerate().for_each(|(x, column)| {
        for (y, v) in column.iter_mut().enumerate() {
            if mask.at(x, y) {
                *v = 0.0;
            }
        }
        let squared = envelope(column);
        column.copy_from_slice(&squared);
    });
    let limit = super::diagonal(mask.size);
    let mut data = vec![0.0_f32; w * h];
    data.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, out)| {
        let row: Vec<f64> = (0..w).map(|x| columns[x * h + y]).collect();
        for (out, squared) in out.iter_mut().zip(envelope(&row)) {
            *out = squared.sqrt().min(limit) as f32;
        }
    });
    Plane { size: mask.size, data }
}

/// Signed distance to the outline of the mask in px: negative inside, positive outside, zero
/// half way between a `true` pixel and its `false` neighbour. The image's border is no outline.
/// Sample it with [`Plane::sample`], which also gives the gradient.
pub(crate) fn signed_distance(mask: &Mask) -> Plane {
    let inside = distance_to(&mask.complement());
    let outside = distance_to(mask);
    let value = |(i, o): (&f32, &f32)| if *o > 0.0 { o - 0.5 } else { 0.5 - i };
    let data = inside.data.iter().zip(&outside.data).map(value).collect();
    Plane { size: mask.size, data }
}

/// `min_q (p − q)² + f(q)` for every `p`; infinite values of `f` are no parabolas.
fn envelope(f: &[f64]) -> Vec<f64> {
    // Parabolas of the envelope and where each begins.
    let mut hull: Vec<(usize, f64)> = Vec::with_capacity(f.len());
    for (q, &height) in f.iter().enumerate().filter(|(_, v)| v.is_finite()) {
        let crossing = |p: usize| {
            let (q, r) = (q as f64, p as f64);
            (height + q * q - f[p] - r * r) / (2.0 * (q - r))
        };
        while hull.last().is_some_and(|&(p, start)| crossing(p) <= start) {
            hull.pop();
        }
        let start = hull.last().map_or(f64::NEG_INFINITY, |&(p, _)| crossing(p));
        hull.push((q, start));
    }
    if hull.is_empty() {
        return vec![f64::INFINITY; f.len()];
    }
    let mut k = 0;
    let lowest = |p: usize| {
        while hull.get(k + 1).is_some_and(|&(_, start)| start < p as f64) {
            k += 1;
        }
        let q = hull[k].0;
        (p as f64 - q as f64).powi(2) + f[q]
    };
    (0..f.len()).map(lowest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point2;

    #[test]
    fn equals_brute_force_on_a_scattered_mask() {
        let size = [23, 17];
        let data: Vec<bool> = (0..23 * 17).map(|i| (i * 7919) % 61 == 3).collect();
        let mask = Mask { size, data };
        let fast = distance_to(&mask);
        for y in 0..17 {
            for x in 0..23 {
                let nearest = (0..23 * 17)
                    .filter(|i| mask.data[*i])
                    .map(|i| ((i % 23) as f32 - x as f32).hypot((i / 23) as f32 - y as f32))
                    .fold(f32::INFINITY, f32::min);
                assert!((fast.at(x, y) - nearest).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn signed_distance_of_a_half_plane_is_linear() {
        let data = (0..200).map(|i| i % 20 < 8).collect();
        let signed = signed_distance(&Mask { size: [20, 10], data });
        let (value, gradient) = signed.sample(&Point2::new(12.25, 4.0)).unwrap();
        assert!((value - (12.25 - 7.5)).abs() < 1e-6);
        assert!((gradient.x - 1.0).abs() < 1e-6 && gradient.y.abs() < 1e-6);
        assert!((signed.at(3, 5) - (3.0 - 7.5)).abs() < 1e-6);
    }

    #[test]
    fn an_empty_mask_gives_the_diagonal() {
        let far = distance_to(&Mask::filled([3, 4], false));
        assert!(far.data.iter().all(|v| *v == 5.0));
        assert!(signed_distance(&Mask::filled([3, 4], true)).data.iter().all(|v| *v == -4.5));
    }
}
