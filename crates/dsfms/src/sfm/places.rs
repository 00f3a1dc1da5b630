//! Descriptor matching against a set in which one place of the surface may be described many times.

use super::matching::{DescriptorMatch, LANES, UnitDescriptors, distance};
use crate::geometry::Point3;
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

/// For every descriptor of `a` its nearest of `b`, when its distance is at most `max_distance` and
/// less than `ratio` times that to the nearest descriptor of any **other** place, farther than
/// `radius` from the first. Every place is matched at most once, to the nearest of `a`.
///
/// `places`: where on the surface each descriptor of `b` lies. Ordered by `a`.
pub(crate) fn match_places(
    a: &UnitDescriptors,
    b: &UnitDescriptors,
    places: &[Point3],
    radius: f64,
    ratio: f32,
    max_distance: f32,
) -> Vec<DescriptorMatch> {
    /// Rows per product: the block of similarities stays in the cache.
    const BLOCK: usize = 64;
    let (na, nb) = (a.len(), b.len());
    if na == 0 || nb == 0 {
        return Vec::new();
    }
    let of_block = |start: usize| -> Vec<DescriptorMatch> {
        let rows = BLOCK.min(na - start);
        let (mut block, mut found) = (vec![0.0f32; rows * nb], Vec::new());
        matmul(
            MatMut::from_row_major_slice_mut(&mut block[..rows * nb], rows, nb),
            Accum::Replace,
            MatRef::from_row_major_slice(a.rows(start, rows), rows, 128),
            MatRef::from_column_major_slice(b.rows(0, nb), 128, nb),
            1.0f32,
            Par::Seq,
        );
        for (i, row) in block[..rows * nb].chunks_exact(nb).enumerate() {
            let best = argmax(row, |_| true);
            let other = argmax(row, |j| (places[j] - places[best]).norm() > radius);
            let nearest = distance(row[best]);
            if nearest <= max_distance && nearest < ratio * distance(row[other]) {
                let (a, b) = ((start + i) as u32, best as u32);
                found.push(DescriptorMatch { a, b, distance: nearest });
            }
        }
        found
    };
    let starts: Vec<usize> = (0..na).step_by(BLOCK).collect();
    let found: Vec<Vec<DescriptorMatch>> = starts.into_par_iter().map(of_block).collect();
    let found = found.concat();
    unique_places(found, places, radius)
}

/// Index of the largest admitted value; the first, when none is admitted.
fn argmax(row: &[f32], admit: impl Fn(usize) -> bool) -> usize {
    let mut best = (0, f32::MIN);
    for (block, values) in row.chunks(LANES).enumerate() {
        // Hardly any block holds a larger one.
        if values.iter().fold(false, |any, &v| any | (v > best.1)) {
            for (j, &v) in (block * LANES..).zip(values) {
                if v > best.1 && admit(j) {
                    best = (j, v);
                }
            }
        }
    }
    best.0
}

/// Of the matches to one place (within a quarter of `radius`) keep the nearest in descriptor.
pub(crate) fn unique_places(
    mut found: Vec<DescriptorMatch>,
    places: &[Point3],
    radius: f64,
) -> Vec<DescriptorMatch> {
    found.sort_by(|x, y| x.distance.total_cmp(&y.distance).then(x.a.cmp(&y.a)));
    let mut kept: Vec<DescriptorMatch> = Vec::new();
    for m in found {
        let here = places[m.b as usize];
        let taken = |k: &DescriptorMatch| (places[k.b as usize] - here).norm() < 0.25 * radius;
        if !kept.iter().any(taken) {
            kept.push(m);
        }
    }
    kept.sort_by_key(|m| m.a);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sfm::random::Random;

    #[test]
    fn repeats_at_one_place_are_not_ambiguous_but_elsewhere_they_are() {
        let mut random = Random::new(5, 0);
        let d: Vec<[u8; 128]> =
            (0..3).map(|_| std::array::from_fn(|_| random.below(90) as u8)).collect();
        let frame = UnitDescriptors::new(&[d[0], d[1]]);
        let template = UnitDescriptors::new(&[d[0], d[0], d[1], d[1], d[2]]);
        let at = |x: f64| Point3::new(x, 0.0, 0.0);
        let places = [at(0.0), at(0.1), at(5.0), at(9.0), at(20.0)];
        let found = match_places(&frame, &template, &places, 1.0, 0.8, 0.7);
        assert_eq!(found.iter().map(|m| m.a).collect::<Vec<_>>(), [0]);
    }
}
