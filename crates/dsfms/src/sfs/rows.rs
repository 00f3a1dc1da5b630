//! Sparse least squares by conjugate gradients: every row has at most three unknowns.

/// A linearised, weighted residual: `weight · (residual + slope · step)²`.
pub(super) struct Row {
    pub index: [u32; 3],
    pub slope: [f64; 3],
    pub residual: f64,
    pub weight: f64,
}

/// Conjugate-gradient iterations of one step: enough for the smooth part of a depth map.
const MAX_ITERATIONS: usize = 150;

/// The step that minimises `Σ weight·(residual + slope·step)² + damping·‖step‖²_D`, `D` the diagonal
/// of the normal matrix, nearly.
pub(super) fn step(rows: &[Row], unknowns: usize, damping: f64) -> Vec<f64> {
    let (mut diagonal, mut r) = (vec![1e-9; unknowns], vec![0.0; unknowns]);
    for row in rows {
        for (&i, s) in row.index.iter().zip(row.slope) {
            diagonal[i as usize] += row.weight * s * s;
            r[i as usize] -= row.weight * s * row.residual;
        }
    }
    let precondition = |r: &[f64]| -> Vec<f64> {
        r.iter().zip(&diagonal).map(|(r, d)| r / ((1.0 + damping) * d)).collect()
    };
    let mut x = vec![0.0; unknowns];
    let mut z = precondition(&r);
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    let target = 1e-6 * rz;
    for _ in 0..MAX_ITERATIONS {
        if rz <= target {
            break;
        }
        let q = multiply(rows, &diagonal, damping, &p);
        let alpha = rz / dot(&p, &q);
        for i in 0..unknowns {
            x[i] += alpha * p[i];
            r[i] -= alpha * q[i];
        }
        z = precondition(&r);
        let next = dot(&r, &z);
        let beta = next / rz;
        rz = next;
        p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + beta * *p);
    }
    x
}

fn multiply(rows: &[Row], diagonal: &[f64], damping: f64, p: &[f64]) -> Vec<f64> {
    let mut q: Vec<f64> = p.iter().zip(diagonal).map(|(p, d)| damping * d * p).collect();
    for row in rows {
        let along: f64 = (0..3).map(|k| row.slope[k] * p[row.index[k] as usize]).sum();
        for k in 0..3 {
            q[row.index[k] as usize] += row.weight * row.slope[k] * along;
        }
    }
    q
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_a_small_system() {
        // (x − 1)² + 4(x + y − 3)² + (z + 2)²
        let row = |index, slope, residual, weight| Row { index, slope, residual, weight };
        let rows = [
            row([0, 1, 2], [1.0, 0.0, 0.0], -1.0, 1.0),
            row([0, 1, 2], [1.0, 1.0, 0.0], -3.0, 4.0),
            row([0, 1, 2], [0.0, 0.0, 1.0], 2.0, 1.0),
        ];
        let x = step(&rows, 3, 0.0);
        for (x, expected) in x.iter().zip([1.0, 2.0, -2.0]) {
            assert!((x - expected).abs() < 1e-5);
        }
    }
}
