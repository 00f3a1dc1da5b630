//! Essential matrices of five pairs of sightlines: the minimal samples of the paper's §4. The
//! cubics of Nistér 2004, solved by the eigenvectors of an action matrix (Stewénius, Engels, Nistér
//! 2006), which keeps digits at narrow baselines that the roots of a polynomial of degree 10 lose.
//!
//! Five pairs leave `E = xX + yY + zZ + W`. A matrix is essential where `det E = 0` and
//! `E Eᵀ E = ½ tr(E Eᵀ) E`: ten cubics in `(x, y, z)`. They tell the ten monomials of degree 3 by
//! the ten of less; what multiplication by `z` makes of the latter is a matrix whose eigenvectors
//! hold the solutions.

use crate::geometry::Vector3;
use nalgebra::{Matrix3, SMatrix, SVector, Schur};

/// Monomials of degree 3 at most, as powers of `x`, `y`, `z`; those of degree 3 first.
const MONOMIALS: [[u8; 3]; 20] = [
    [3, 0, 0],
    [2, 1, 0],
    [2, 0, 1],
    [1, 2, 0],
    [1, 1, 1],
    [1, 0, 2],
    [0, 3, 0],
    [0, 2, 1],
    [0, 1, 2],
    [0, 0, 3],
    [2, 0, 0],
    [1, 1, 0],
    [1, 0, 1],
    [0, 2, 0],
    [0, 1, 1],
    [0, 0, 2],
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [0, 0, 0],
];

/// The places of `x`, `y`, `z` and 1 among the monomials.
const UNKNOWNS: [usize; 4] = [16, 17, 18, 19];

/// Place of the product of a monomial and each of `x`, `y`, `z`, 1; 20 where its degree is 4.
const TIMES: [[usize; 4]; 20] = products();

const fn products() -> [[usize; 4]; 20] {
    let mut table = [[20; 4]; 20];
    let mut i = 0;
    while i < 20 {
        let mut j = 0;
        while j < 4 {
            let mut wanted = MONOMIALS[i];
            if j < 3 {
                wanted[j] += 1;
            }
            let mut k = 0;
            while k < 20 {
                let found = MONOMIALS[k];
                if found[0] == wanted[0] && found[1] == wanted[1] && found[2] == wanted[2] {
                    table[i][j] = k;
                }
                k += 1;
            }
            j += 1;
        }
        i += 1;
    }
    table
}

/// `ax + by + cz + d`.
type Linear = [f64; 4];

/// A polynomial of degree 3 at most in `x`, `y`, `z`: the coefficients of [`MONOMIALS`].
type Cubic = SVector<f64, 20>;

/// `sum += p·q` for `p` of degree 2 at most.
fn add_product(sum: &mut Cubic, p: &Cubic, q: &Linear) {
    for (&coefficient, places) in p.iter().zip(&TIMES) {
        if coefficient != 0.0 {
            for (&place, q) in places.iter().zip(q) {
                sum[place] += coefficient * q;
            }
        }
    }
}

fn cubic(p: &Linear) -> Cubic {
    let mut sum = Cubic::zeros();
    for (place, coefficient) in UNKNOWNS.iter().zip(p) {
        sum[*place] = *coefficient;
    }
    sum
}

/// Essential matrices `E` of norm 1 with `bᵢᵀ E aᵢ = 0` for five pairs of sightlines of any length
/// but 0: at most ten, none where the pairs leave more than a finite number.
pub(super) fn five_point(a: &[Vector3; 5], b: &[Vector3; 5]) -> Vec<Matrix3<f64>> {
    let basis = null_space(a, b);
    let constraints = constraints(&basis);
    let Some(action) = action_of_z(&constraints) else { return Vec::new() };
    let assembled = |z| {
        let [x, y, z] = polished(&constraints, solution(&action, z)?).into();
        let e = (basis[0] * x + basis[1] * y + basis[2] * z + basis[3]).normalize();
        is_essential(&e).then_some(e)
    };
    real_eigenvalues(&action).into_iter().filter_map(assembled).collect()
}

/// Four matrices, orthonormal as vectors, with `bᵢᵀ X aᵢ = 0`.
fn null_space(a: &[Vector3; 5], b: &[Vector3; 5]) -> [Matrix3<f64>; 4] {
    let mut rows = SMatrix::<f64, 9, 9>::zeros();
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        let row = b.normalize() * a.normalize().transpose();
        rows.column_mut(i).copy_from_slice(row.as_slice());
    }
    // The last four columns are zero: of an orthonormal basis whose first five columns span the
    // rows they hold the complement.
    let q = rows.qr().q();
    std::array::from_fn(|k| Matrix3::from_column_slice(q.column(5 + k).as_slice()))
}

/// The ten cubics that make `E` essential, as rows.
fn constraints(basis: &[Matrix3<f64>; 4]) -> SMatrix<f64, 10, 20> {
    let e: [[Linear; 3]; 3] =
        std::array::from_fn(|r| std::array::from_fn(|c| std::array::from_fn(|k| basis[k][(r, c)])));
    let products = |terms: &[(&Cubic, &Linear)]| {
        let mut sum = Cubic::zeros();
        terms.iter().for_each(|(p, q)| add_product(&mut sum, p, q));
        sum
    };
    let cubics = e.map(|row| row.map(|entry| cubic(&entry)));
    let gram: [[Cubic; 3]; 3] = std::array::from_fn(|r| {
        std::array::from_fn(|c| {
            let term = |k: usize| (&cubics[r][k], &e[c][k]);
            products(&[term(0), term(1), term(2)])
        })
    });
    let half_trace = (gram[0][0] + gram[1][1] + gram[2][2]) * 0.5;
    let mut rows = SMatrix::<f64, 10, 20>::zeros();
    for i in 0..9 {
        let (r, c) = (i / 3, i % 3);
        let mut left = gram[r];
        left[r] -= half_trace;
        let row = products(&[(&left[0], &e[0][c]), (&left[1], &e[1][c]), (&left[2], &e[2][c])]);
        rows.set_row(i, &row.transpose());
    }
    let minor = |p: usize, q: usize| {
        products(&[(&cubics[0][p], &e[1][q])]) - products(&[(&cubics[0][q], &e[1][p])])
    };
    let determinant =
        products(&[(&minor(1, 2), &e[2][0]), (&minor(2, 0), &e[2][1]), (&minor(0, 1), &e[2][2])]);
    rows.set_row(9, &determinant.transpose());
    rows
}

/// Multiplication by `z` of the ten monomials of degree 2 at most, where the ten cubics hold.
/// `None` where the cubics are dependent.
fn action_of_z(constraints: &SMatrix<f64, 10, 20>) -> Option<SMatrix<f64, 10, 10>> {
    let highest = constraints.fixed_columns::<10>(0).into_owned();
    let rest = highest.lu().solve(&constraints.fixed_columns::<10>(10).into_owned())?;
    let mut action = SMatrix::<f64, 10, 10>::zeros();
    for (i, places) in TIMES[10..].iter().enumerate() {
        match places[2] {
            cubic @ 0..10 => action.set_row(i, &-rest.row(cubic)),
            lower => action[(i, lower - 10)] = 1.0,
        }
    }
    action.iter().all(|v| v.is_finite()).then_some(action)
}

/// Real eigenvalues, and the real parts of pairs that rounding has pushed off the axis.
fn real_eigenvalues(action: &SMatrix<f64, 10, 10>) -> Vec<f64> {
    /// Largest imaginary part of a real eigenvalue, relative: neighbouring roots are off by the
    /// square root of the rounding. What is none does not pass as essential after polishing.
    const IMAGINARY: f64 = 1e-4;
    const MAX_STEPS: usize = 500;
    let Some(schur) = Schur::try_new(*action, f64::EPSILON, MAX_STEPS) else { return Vec::new() };
    let eigenvalues = schur.complex_eigenvalues();
    let real = eigenvalues.iter().filter(|v| v.im.abs() <= IMAGINARY * v.re.hypot(v.im).max(1e-3));
    real.map(|v| v.re).collect()
}

/// The solution of an eigenvalue, by two steps of inverse iteration a little beside it.
fn solution(action: &SMatrix<f64, 10, 10>, z: f64) -> Option<Vector3> {
    let beside = z + 1e-12 * (1.0 + z.abs());
    let shifted = action - SMatrix::<f64, 10, 10>::identity() * beside;
    let lu = shifted.lu();
    let vector = lu.solve(&lu.solve(&SVector::<f64, 10>::repeat(1.0))?.normalize())?;
    let solution = vector.fixed_rows::<3>(6) / vector[9];
    solution.iter().all(|v| v.is_finite()).then_some(solution)
}

/// Whether polishing has arrived.
fn is_essential(e: &Matrix3<f64>) -> bool {
    let gram = e * e.transpose();
    let residual = gram * e - e * (0.5 * gram.trace());
    residual.norm() < 1e-9 && e.determinant().abs() < 1e-9
}

/// Newton's steps on the ten cubics: elimination costs digits.
fn polished(constraints: &SMatrix<f64, 10, 20>, mut solution: Vector3) -> Vector3 {
    /// Newton doubles the digits each time: from three to all in three, with two to spare.
    const STEPS: usize = 5;
    for _ in 0..STEPS {
        let (values, slopes) = monomials(&solution);
        let (residuals, jacobian) = (constraints * values, constraints * slopes);
        let normal = jacobian.tr_mul(&jacobian);
        let Some(inverse) = normal.try_inverse() else { break };
        let step = inverse * jacobian.tr_mul(&residuals);
        if !step.iter().all(|v| v.is_finite()) {
            break;
        }
        solution -= step;
    }
    solution
}

/// Values of the monomials and their derivatives by `x`, `y`, `z`.
fn monomials(at: &Vector3) -> (Cubic, SMatrix<f64, 20, 3>) {
    let powers = [at.x, at.y, at.z].map(|v| [1.0, v, v * v, v * v * v]);
    let slopes = [at.x, at.y, at.z].map(|v| [0.0, 1.0, 2.0 * v, 3.0 * v * v]);
    let factor = |i: usize, k: usize, by: Option<usize>| {
        let table = if by == Some(k) { &slopes } else { &powers };
        table[k][usize::from(MONOMIALS[i][k])]
    };
    let product = |i, by| factor(i, 0, by) * factor(i, 1, by) * factor(i, 2, by);
    (Cubic::from_fn(|i, _| product(i, None)), SMatrix::from_fn(|i, by| product(i, Some(by))))
}

#[cfg(test)]
mod tests {
    use super::super::essential::essential_matrix;
    use super::super::random::Random;
    use super::*;
    use crate::geometry::{Isometry, Point3};

    struct Draw(Random);

    impl Draw {
        /// Uniform in `[−1, 1)`.
        fn next(&mut self) -> f64 {
            self.0.below(1 << 40) as f64 / (1_u64 << 39) as f64 - 1.0
        }

        fn vector(&mut self) -> Vector3 {
            Vector3::new(self.next(), self.next(), self.next())
        }
    }

    /// Five points and a second camera: sightlines from both, and the essential matrix of norm 1.
    fn case(pose: &Isometry, points: &[Point3; 5]) -> ([Vector3; 5], [Vector3; 5], Matrix3<f64>) {
        let seen = points.map(|p| (pose * p).coords);
        (points.map(|p| p.coords), seen, essential_matrix(pose).normalize())
    }

    /// How far the nearest solution is from the truth, the sign aside.
    fn miss(found: &[Matrix3<f64>], truth: &Matrix3<f64>) -> f64 {
        found
            .iter()
            .map(|e| (e - truth).norm().min((e + truth).norm()))
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_true_matrix_is_among_the_solutions_of_random_poses() {
        let mut draw = Draw(Random::new(1, 0));
        for (turn, baseline, bound) in [
            (0.5, 1.0, 1e-8),
            (0.0, 1.0, 1e-8),
            (0.5, 0.1, 1e-8),
            // A parallax of a third of a percent: less is told.
            (0.5, 0.01, 1e-5),
        ] {
            for _ in 0..500 {
                let shift = draw.vector().normalize() * baseline;
                let pose = Isometry::new(shift, draw.vector() * turn);
                let points =
                    std::array::from_fn(|_| Point3::from(draw.vector() + Vector3::z() * 3.0));
                let (a, b, truth) = case(&pose, &points);
                let found = five_point(&a, &b);
                let miss = miss(&found, &truth);
                assert!(found.len() <= 10 && miss < bound, "{miss:e} at {turn}, {baseline}");
            }
        }
    }

    #[test]
    fn every_solution_is_essential_and_fits_the_pairs() {
        let mut draw = Draw(Random::new(2, 0));
        let mut count = 0;
        for _ in 0..200 {
            // Any sightlines at all, those that look backwards too.
            let mut rays = || std::array::from_fn(|_| draw.vector());
            let (a, b): ([Vector3; 5], [Vector3; 5]) = (rays(), rays());
            for e in five_point(&a, &b) {
                let s = e.svd(false, false).singular_values;
                assert!((s[0] - s[1]).abs() < 1e-7 && s[2] < 1e-7, "{s:?}");
                let misses = a.iter().zip(&b).map(|(a, b)| b.dot(&(e * a)).abs());
                assert!(misses.fold(0.0, f64::max) < 1e-10);
                count += 1;
            }
        }
        assert!(count > 400, "{count} solutions of 200 samples");
    }

    #[test]
    fn points_of_a_plane_are_solved() {
        let mut draw = Draw(Random::new(3, 0));
        let pose = Isometry::new(Vector3::new(0.4, -0.1, 0.2), Vector3::new(0.1, 0.3, -0.2));
        for _ in 0..100 {
            let points = std::array::from_fn(|_| {
                let (x, y) = (draw.next(), draw.next());
                Point3::new(x, y, 3.0 + 0.3 * x - 0.2 * y)
            });
            let (a, b, truth) = case(&pose, &points);
            assert!(miss(&five_point(&a, &b), &truth) < 1e-8);
        }
    }

    #[test]
    fn degenerate_pairs_do_no_harm() {
        let ray = Vector3::new(0.1, 0.2, 1.0);
        // One pair five times over: infinitely many matrices fit, and any that comes is one of
        // them.
        for e in five_point(&[ray; 5], &[ray; 5]) {
            assert!(ray.dot(&(e * ray)).abs() < 1e-9);
        }
        let nan = Vector3::repeat(f64::NAN);
        assert!(five_point(&[nan; 5], &[ray; 5]).is_empty());
        assert!(five_point(&[Vector3::zeros(); 5], &[ray; 5]).is_empty());
    }
}
