//! What makes a light unusable.

/// What makes a light unusable.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LightError {
    /// A point light that is nowhere.
    #[error("light.positions is empty; a point light needs at least one [x, y, z] in camera axes")]
    NoPosition,
    /// NaN or infinite coordinate.
    #[error("light.positions[{0}] holds a number that is not finite")]
    Position(usize),
    /// Not positive.
    #[error("light.reference_distance is {0}; it must be positive")]
    ReferenceDistance(f64),
    /// Angles out of order.
    #[error(
        "light.spot runs from {inner_deg} to {outer_deg} degrees; expected 0 <= inner < outer <= 180"
    )]
    Spot {
        /// Where full light ends.
        inner_deg: f64,
        /// Where the light ends.
        outer_deg: f64,
    },
    /// Negative or not finite.
    #[error("light.radius is {0}; it must not be negative")]
    Radius(f64),
    /// NaN or infinite coordinate.
    #[error("light.centre holds a number that is not finite")]
    Centre,
    /// Negative or not finite.
    #[error("light.spot exponent is {0}; it must not be negative")]
    Exponent(f64),
}
