//! A smooth field of signed distances through what the depth maps say.
//!
//! `min_f Σ c (f − d)² + λ Σ ‖∇²f‖²` over the points of the grid, `c` the trust in what the frames
//! say of a point: where many agree the field follows them, where few do it is smoothed over a
//! longer way (`2π (λ/c)^¼` edges), and where nothing is known it goes on as flat as it can. Of
//! free space and of what lies outside the organ's outline it is only known that the distance is at
//! least so much. Solved from coarse to fine by conjugate gradients.

use super::grid::{NONE, coarser, neighbours, prolonged};
use super::observe::DistanceEvidence;
use super::volume::DistanceVolume;
use crate::solver::conjugate_gradients::{Goal, System, conjugate_gradients};
use rayon::prelude::*;

/// Levels, each of half the resolution of the one before.
const LEVELS: usize = 4;
/// Rounds, after each of which the bounds that hold are chosen again.
const ROUNDS: usize = 2;
/// Conjugate gradient steps a round on the finest level; twice as many on every coarser one.
const STEPS: usize = 25;

/// Replace the distances of `volume` by the smooth field.
pub(super) fn run(volume: &mut DistanceVolume, smoothness: f32) {
    volume.distance = level(&volume.blocks, &volume.evidence, smoothness, LEVELS);
}

fn level(
    blocks: &[[i32; 3]],
    evidence: &[DistanceEvidence],
    smoothness: f32,
    levels: usize,
) -> Vec<f32> {
    let mut field: Vec<f32> = if levels > 1 {
        let (parents, data) = coarser(blocks, evidence);
        // A second difference is four times as large, and there are an eighth of the points.
        let coarse = level(&parents, &data, 0.5 * smoothness, levels - 1);
        prolonged(blocks, &parents, &coarse)
    } else {
        evidence.iter().map(|e| e.distance).collect()
    };
    let grid = FieldGrid { around: neighbours(blocks), smoothness };
    for _ in 0..ROUNDS {
        let weight: Vec<f32> = evidence
            .par_iter()
            .zip(&field)
            .map(|(e, &f)| if e.bound && f >= e.distance { 0.0 } else { e.weight })
            .collect();
        grid.solve(&weight, evidence, &mut field, STEPS << (LEVELS - levels));
    }
    field
}

struct FieldGrid {
    around: Vec<[u32; 6]>,
    smoothness: f32,
}

/// `C + λ DᵀD`, `D` the second differences along the axes and, mixed, across the squares.
struct FieldSystem<'a> {
    grid: &'a FieldGrid,
    weight: &'a [f32],
}

impl System<f32> for FieldSystem<'_> {
    fn apply(&mut self, f: &[f32], out: &mut [f32]) {
        let (grid, weight) = (self.grid, self.weight);
        let second: Vec<[f32; 6]> =
            (0..f.len()).into_par_iter().map(|i| grid.differences(f, i)).collect();
        out.par_iter_mut().enumerate().for_each(|(i, out)| {
            *out = weight[i] * f[i] + grid.smoothness * grid.transposed(&second, i);
        });
    }

    fn precondition(&mut self, r: &[f32], out: &mut [f32]) {
        // Six of 1, one of 4 for each of three axes; a little more where differences are missing.
        let smooth = 18.0 * self.grid.smoothness;
        let numbers = r.par_iter().zip(self.weight);
        out.par_iter_mut().zip(numbers).for_each(|(out, (r, weight))| *out = r / (weight + smooth));
    }
}

impl FieldGrid {
    /// `(C + λ DᵀD) f = C d`, nearly.
    fn solve(
        &self,
        weight: &[f32],
        evidence: &[DistanceEvidence],
        field: &mut [f32],
        steps: usize,
    ) {
        let mut normal = FieldSystem { grid: self, weight };
        let mut residual = vec![0.0; field.len()];
        normal.apply(field, &mut residual);
        let right = weight.par_iter().zip(evidence).map(|(weight, e)| weight * e.distance);
        residual.par_iter_mut().zip(right).for_each(|(r, right)| *r = right - *r);
        conjugate_gradients(&mut normal, field, &mut residual, Goal::Below(0.0), steps);
    }

    /// Second differences about point `i` along x, y, z; then of the squares above it in xy, yz,
    /// zx.
    #[inline]
    fn differences(&self, f: &[f32], i: usize) -> [f32; 6] {
        let around = &self.around[i];
        let mut out = [0.0; 6];
        for k in 0..3 {
            let (a, b) = (around[2 * k], around[2 * k + 1]);
            if a != NONE && b != NONE {
                out[k] = f[a as usize] + f[b as usize] - 2.0 * f[i];
            }
            let (u, v) = (b, around[2 * ((k + 1) % 3) + 1]);
            if u != NONE && v != NONE {
                let across = self.around[u as usize][2 * ((k + 1) % 3) + 1];
                if across != NONE {
                    out[3 + k] = f[i] + f[across as usize] - f[u as usize] - f[v as usize];
                }
            }
        }
        out
    }

    /// `Dᵀ` at point `i`, the mixed ones doubled.
    #[inline]
    fn transposed(&self, second: &[[f32; 6]], i: usize) -> f32 {
        let around = &self.around[i];
        let mut sum = 0.0;
        for k in 0..3 {
            let (a, b) = (around[2 * k], around[2 * k + 1]);
            sum -= 2.0 * second[i][k];
            if a != NONE {
                sum += second[a as usize][k];
            }
            if b != NONE {
                sum += second[b as usize][k];
            }
            let back = around[2 * ((k + 1) % 3)];
            let mut mixed = second[i][3 + k];
            if a != NONE {
                mixed -= second[a as usize][3 + k];
                let corner = self.around[a as usize][2 * ((k + 1) % 3)];
                if corner != NONE {
                    mixed += second[corner as usize][3 + k];
                }
            }
            if back != NONE {
                mixed -= second[back as usize][3 + k];
            }
            sum += 2.0 * mixed;
        }
        sum
    }
}

/// Sum of products, in pieces of a fixed size and order.
#[cfg(test)]
mod tests {
    use super::super::grid::{BLOCK, EDGE};
    use super::*;
    use crate::solver::conjugate_gradients::Number;

    /// 4 x 4 x 4 blocks about the origin.
    fn blocks() -> Vec<[i32; 3]> {
        (0..64).map(|i| [i / 16 - 2, i / 4 % 4 - 2, i % 4 - 2]).collect()
    }

    fn place(i: usize) -> [f32; 3] {
        let (block, g) = (blocks()[i / BLOCK], i % BLOCK);
        let local = [g % EDGE, g / EDGE % EDGE, g / (EDGE * EDGE)];
        [0, 1, 2].map(|k| (block[k] * EDGE as i32 + local[k] as i32) as f32)
    }

    fn slope(i: usize) -> f32 {
        let [x, y, z] = place(i);
        0.1 * z + 0.05 * x - 0.02 * y
    }

    #[test]
    fn a_plane_goes_on_where_nothing_is_known() {
        let evidence: Vec<DistanceEvidence> = (0..64 * BLOCK)
            .map(|i| {
                let weight = if place(i)[0] < 0.0 && slope(i).abs() < 0.4 { 1.0 } else { 0.0 };
                DistanceEvidence {
                    distance: if weight > 0.0 { slope(i) } else { 1.0 },
                    weight,
                    bound: false,
                }
            })
            .collect();
        let field = level(&blocks(), &evidence, 1.0, LEVELS);
        let worst = |to: f32| {
            let near = (0..field.len()).filter(|&i| place(i)[0] < to && slope(i).abs() < 0.2);
            near.map(|i| (field[i] - slope(i)).abs()).fold(0.0, f32::max)
        };
        assert!(worst(0.0) < 0.03, "{}", worst(0.0));
        // Nearly: what lies far off has not settled.
        assert!(worst(5.0) < 0.15, "{}", worst(5.0));
    }

    #[test]
    fn a_bound_holds_from_one_side() {
        let with = |bound: f32| {
            let evidence: Vec<DistanceEvidence> = (0..64 * BLOCK)
                .map(|i| {
                    let [x, _, z] = place(i);
                    if x < 0.0 && z.abs() < 3.0 {
                        DistanceEvidence { distance: 0.1 * z, weight: 1.0, bound: false }
                    } else if x > 6.0 && z == 0.0 {
                        DistanceEvidence { distance: bound, weight: 10.0, bound: true }
                    } else {
                        DistanceEvidence { distance: 1.0, weight: 0.0, bound: false }
                    }
                })
                .collect();
            let field = level(&blocks(), &evidence, 0.1, LEVELS);
            let at = (0..field.len()).find(|&i| place(i) == [8.0, 0.0, 0.0]).unwrap();
            field[at]
        };
        assert!(with(-0.5).abs() < 0.05, "{}", with(-0.5));
        assert!(with(0.5) > 0.35, "{}", with(0.5));
    }

    #[test]
    fn the_operator_is_symmetric() {
        let blocks = &blocks()[..9];
        let grid = FieldGrid { around: neighbours(blocks), smoothness: 0.7 };
        let n = grid.around.len();
        let a: Vec<f32> = (0..n).map(|i| (i as f32 * 0.37).sin()).collect();
        let b: Vec<f32> = (0..n).map(|i| (i as f32 * 0.53).cos()).collect();
        let weight = vec![0.3; n];
        let product = |a: &[f32], b: &[f32]| {
            let mut out = vec![0.0; n];
            FieldSystem { grid: &grid, weight: &weight }.apply(b, &mut out);
            f32::dot(a, &out)
        };
        let (ab, ba) = (product(&a, &b), product(&b, &a));
        assert!((ab - ba).abs() < 1e-4 * ab.abs().max(1.0), "{ab} {ba}");
    }
}
