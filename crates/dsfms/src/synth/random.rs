//! Seeded random numbers for synthetic data: the same on every machine.

pub use crate::sfm::random::Random;

/// A uniform number in `[0, 1)`.
pub fn uniform(random: &mut Random) -> f64 {
    random.below(1 << 52) as f64 / (1u64 << 52) as f64
}

/// A standard normal number (Box and Muller 1958).
pub fn normal(random: &mut Random) -> f64 {
    let radius = (-2.0 * (1.0 - uniform(random)).ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform(random)).cos()
}
