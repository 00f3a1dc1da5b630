//! The blocks of the grid and those of the next coarser one: who lies beside whom, and what of a
//! field comes from one to the other.

use super::observe::DistanceEvidence;
use rayon::prelude::*;

/// Grid points along the edge of a block.
pub(super) const EDGE: usize = 8;
/// Grid points in a block.
pub(super) const BLOCK: usize = EDGE * EDGE * EDGE;
/// No neighbour.
pub(super) const NONE: u32 = u32::MAX;

/// Index of the six neighbours of every point, along x, y, z, down and up; [`NONE`] where there is
/// none.
pub(super) fn neighbours(blocks: &[[i32; 3]]) -> Vec<[u32; 6]> {
    let mut around = vec![[NONE; 6]; blocks.len() * BLOCK];
    around.par_chunks_mut(BLOCK).enumerate().for_each(|(b, around)| {
        let beside: [Option<usize>; 6] = std::array::from_fn(|n| {
            let mut at = blocks[b];
            at[n / 2] += if n % 2 == 0 { -1 } else { 1 };
            blocks.binary_search(&at).ok()
        });
        for (g, around) in around.iter_mut().enumerate() {
            let local = [g % EDGE, g / EDGE % EDGE, g / (EDGE * EDGE)];
            for n in 0..6 {
                let (axis, up) = (n / 2, n % 2 == 1);
                let mut to = local;
                let leaves = if up { local[axis] + 1 == EDGE } else { local[axis] == 0 };
                to[axis] =
                    if up { (local[axis] + 1) % EDGE } else { (local[axis] + EDGE - 1) % EDGE };
                let block = if leaves { beside[n] } else { Some(b) };
                if let Some(block) = block {
                    around[n] = (block * BLOCK + (to[2] * EDGE + to[1]) * EDGE + to[0]) as u32;
                }
            }
        }
    });
    around
}

/// Blocks and evidence of the grid of twice the edge; a point there stands for eight.
pub(super) fn coarser(
    blocks: &[[i32; 3]],
    evidence: &[DistanceEvidence],
) -> (Vec<[i32; 3]>, Vec<DistanceEvidence>) {
    let mut parents: Vec<[i32; 3]> = blocks.iter().map(|b| b.map(|c| c.div_euclid(2))).collect();
    parents.sort_unstable();
    parents.dedup();
    let mut sums = vec![[0.0f32; 4]; parents.len() * BLOCK];
    for (b, block) in blocks.iter().enumerate() {
        let Ok(parent) = parents.binary_search(&block.map(|c| c.div_euclid(2))) else { continue };
        let base = block.map(|c| c.rem_euclid(2) as usize * EDGE / 2);
        for g in 0..BLOCK {
            let local = [g % EDGE, g / EDGE % EDGE, g / (EDGE * EDGE)];
            let at = [0, 1, 2].map(|k| base[k] + local[k] / 2);
            let sum = &mut sums[parent * BLOCK + (at[2] * EDGE + at[1]) * EDGE + at[0]];
            let e = &evidence[b * BLOCK + g];
            if e.bound {
                sum[2] += e.weight;
                sum[3] += e.weight * e.distance;
            } else {
                sum[0] += e.weight;
                sum[1] += e.weight * e.distance;
            }
        }
    }
    let evidence = sums.iter().map(|s| match s {
        [w, sum, ..] if *w > 0.0 => {
            DistanceEvidence { distance: sum / w, weight: *w, bound: false }
        }
        [_, _, w, sum] if *w > 0.0 => {
            DistanceEvidence { distance: sum / w, weight: *w, bound: true }
        }
        _ => DistanceEvidence { distance: 1.0, weight: 0.0, bound: false },
    });
    (parents, evidence.collect())
}

/// The coarse field at the fine points, trilinear within a parent's neighbours that there are.
pub(super) fn prolonged(blocks: &[[i32; 3]], parents: &[[i32; 3]], coarse: &[f32]) -> Vec<f32> {
    let mut fine = vec![0.0; blocks.len() * BLOCK];
    fine.par_chunks_mut(BLOCK).zip(blocks).for_each(|(fine, block)| {
        for (g, value) in fine.iter_mut().enumerate() {
            let local = [g % EDGE, g / EDGE % EDGE, g / (EDGE * EDGE)];
            let at = [0, 1, 2].map(|k| block[k] * EDGE as i32 + local[k] as i32);
            let (mut sum, mut weight) = (0.0, 0.0);
            for corner in 0..8 {
                let mut share = 1.0;
                // Fine point x lies at (x - ½) / 2 of the coarse grid.
                let to = [0, 1, 2].map(|k| {
                    let far = corner >> k & 1 == 1;
                    share *= if far { 0.25 } else { 0.75 };
                    let side = if at[k].rem_euclid(2) == 0 { -1 } else { 1 };
                    at[k].div_euclid(2) + if far { side } else { 0 }
                });
                let parent = to.map(|c| c.div_euclid(EDGE as i32));
                if let Ok(p) = parents.binary_search(&parent) {
                    let l = to.map(|c| c.rem_euclid(EDGE as i32) as usize);
                    sum += share * coarse[p * BLOCK + (l[2] * EDGE + l[1]) * EDGE + l[0]];
                    weight += share;
                }
            }
            *value = sum / weight;
        }
    });
    fine
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_field_survives_the_way_down_and_up() {
        let blocks: Vec<[i32; 3]> =
            (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]).collect();
        let place = |i: usize| {
            let (block, g) = (blocks[i / BLOCK], i % BLOCK);
            let local = [g % EDGE, g / EDGE % EDGE, g / (EDGE * EDGE)];
            [0, 1, 2].map(|k| (block[k] * EDGE as i32 + local[k] as i32) as f32)
        };
        let value = |i: usize| 0.3 * place(i)[0] - 0.2 * place(i)[1] + 0.1 * place(i)[2];
        let known = |i: usize| DistanceEvidence { distance: value(i), weight: 1.0, bound: false };
        let evidence: Vec<DistanceEvidence> = (0..27 * BLOCK).map(known).collect();
        let (parents, data) = coarser(&blocks, &evidence);
        let coarse: Vec<f32> = data.iter().map(|e| e.distance).collect();
        // Eight points of trust 1 each make one.
        assert!(data.iter().all(|e| e.weight == 8.0 || e.weight == 0.0));
        let fine = prolonged(&blocks, &parents, &coarse);
        let around = neighbours(&blocks);
        let inner = (0..fine.len()).filter(|&i| around[i].iter().all(|&n| n != NONE));
        let inside = |i: &usize| place(*i).iter().all(|c| c.abs() < 0.6 * EDGE as f32);
        for i in inner.filter(inside) {
            assert!((fine[i] - value(i)).abs() < 1e-4, "{:?}", place(i));
            assert!(
                around[i]
                    .iter()
                    .zip([-0.3, 0.3, 0.2, -0.2, -0.1, 0.1])
                    .all(|(&n, step)| { (value(n as usize) - value(i) - step).abs() < 1e-4 })
            );
        }
    }
}
