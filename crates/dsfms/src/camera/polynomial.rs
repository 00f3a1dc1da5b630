//! Is a small polynomial positive on an interval? The distortion models ask it of the derivative
//! of their radial function, which bounds the part of space they can describe.

/// `Σ cᵢ uⁱ`.
pub(super) fn evaluate<const N: usize>(c: &[f64; N], u: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * u + c)
}

/// Whether `Σ cᵢ uⁱ > 0` on the whole of `[0, end]`, exactly up to rounding.
///
/// In the Bernstein basis a polynomial lies within the hull of its coefficients: all positive
/// proves it, an end point at or below zero refutes it, anything else is halved.
pub(super) fn positive_up_to<const N: usize>(c: &[f64; N], end: f64) -> bool {
    let mut power = 1.0;
    let scaled = c.map(|c| {
        let value = c * power;
        power *= end;
        value
    });
    bernstein_positive(bernstein(&scaled), 40)
}

/// Bernstein coefficients on `[0, 1]` of a polynomial in powers.
fn bernstein<const N: usize>(c: &[f64; N]) -> [f64; N] {
    // The difference table of the coefficients divided by their binomials, unrolled upwards.
    let n = N - 1;
    let mut b = [0.0; N];
    let mut binomial = 1.0;
    for (i, (b, c)) in b.iter_mut().zip(c).enumerate() {
        *b = c / binomial;
        binomial *= (n - i) as f64 / (i + 1) as f64;
    }
    for level in 1..N {
        for i in (level..N).rev() {
            b[i] += b[i - 1];
        }
    }
    b
}

fn bernstein_positive<const N: usize>(b: [f64; N], depth: usize) -> bool {
    if b.iter().all(|&v| v > 0.0) {
        return true;
    }
    // Written so that NaN counts as not positive.
    if !(b[0] > 0.0 && b[N - 1] > 0.0) || depth == 0 {
        return false;
    }
    let (left, right) = halves(b);
    bernstein_positive(left, depth - 1) && bernstein_positive(right, depth - 1)
}

/// De Casteljau's subdivision at one half.
fn halves<const N: usize>(mut b: [f64; N]) -> ([f64; N], [f64; N]) {
    let mut left = b;
    for (level, left) in left.iter_mut().enumerate().skip(1) {
        for i in 0..N - level {
            b[i] = 0.5 * (b[i] + b[i + 1]);
        }
        *left = b[0];
    }
    (left, b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_first_root_of_a_cubic() {
        // (u-1)(u-2)(u-3) = -6 + 11u - 6u² + u³, negated: positive before 1.
        let c = [6.0, -11.0, 6.0, -1.0];
        assert!(positive_up_to(&c, 0.999));
        assert!(!positive_up_to(&c, 1.001));
        // Positive again at 2.5: still refused, because (1, 2) lies before it.
        assert!(evaluate(&c, 2.5) > 0.0 && !positive_up_to(&c, 2.5));
    }

    #[test]
    fn proves_a_polynomial_that_only_comes_near_zero() {
        // (u - 0.5)² + 1e-6
        let c = [0.25 + 1e-6, -1.0, 1.0, 0.0];
        assert!(positive_up_to(&c, 1.0));
        assert!(!positive_up_to(&[0.25 - 1e-6, -1.0, 1.0, 0.0], 1.0));
        assert!(!positive_up_to(&[1.0, f64::NAN, 0.0, 0.0], 1.0));
    }

    #[test]
    fn bernstein_coefficients_by_hand() {
        // u² in degree 2 is (0, 0, 1); u is (0, ½, 1).
        assert_eq!(bernstein(&[0.0, 0.0, 1.0]), [0.0, 0.0, 1.0]);
        assert_eq!(bernstein(&[0.0, 1.0, 0.0]), [0.0, 0.5, 1.0]);
    }
}
