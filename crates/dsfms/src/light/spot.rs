//! How a near light spreads its rays about the optical axis.

use super::error::LightError;
use serde::{Deserialize, Serialize};

/// Angular profile of a light about its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Spot {
    /// The same in every direction.
    #[default]
    Isotropic,
    /// 1 inside `inner_deg`, falling linearly with the angle to 0 at `outer_deg`.
    Linear {
        /// Half angle of full light, degrees.
        inner_deg: f64,
        /// Half angle where the light ends, degrees.
        outer_deg: f64,
    },
    /// `cosⁿ` of the angle.
    CosinePower {
        /// The exponent n.
        exponent: f64,
    },
}

impl Spot {
    /// Relative intensity at an angle from the axis (rad, `[0, π]`) and its derivative per rad.
    /// Within the kinks of [`Spot::Linear`] the derivative is that of the inner side.
    pub fn profile(&self, angle: f64) -> (f64, f64) {
        match *self {
            Self::Isotropic => (1.0, 0.0),
            Self::Linear { inner_deg, outer_deg } => {
                let (inner, outer) = (inner_deg.to_radians(), outer_deg.to_radians());
                let slope = -1.0 / (outer - inner);
                if angle <= inner {
                    (1.0, 0.0)
                } else if angle <= outer {
                    (slope * (angle - outer), slope)
                } else {
                    (0.0, 0.0)
                }
            }
            Self::CosinePower { exponent: 0.0 } => (1.0, 0.0),
            Self::CosinePower { exponent } => {
                let cos = angle.cos();
                if cos <= 0.0 {
                    return (0.0, 0.0);
                }
                let power = cos.powf(exponent - 1.0);
                (power * cos, -exponent * power * angle.sin())
            }
        }
    }

    /// Check every number.
    pub(super) fn validate(&self) -> Result<(), LightError> {
        match *self {
            Self::Linear { inner_deg, outer_deg }
                if !(0.0 <= inner_deg && inner_deg < outer_deg && outer_deg <= 180.0) =>
            {
                Err(LightError::Spot { inner_deg, outer_deg })
            }
            Self::CosinePower { exponent } if !(exponent >= 0.0 && exponent.is_finite()) => {
                Err(LightError::Exponent(exponent))
            }
            _ => Ok(()),
        }
    }

    /// In words.
    pub(super) fn describe(&self) -> String {
        match self {
            Self::Isotropic => "the same in all directions".into(),
            Self::Linear { inner_deg, outer_deg } => {
                format!(
                    "full within {inner_deg:.1} deg of the axis, none beyond {outer_deg:.1} deg"
                )
            }
            Self::CosinePower { exponent } => {
                format!("cosine of the angle to the power {exponent:.2}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_spot_by_hand() {
        let spot = Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 };
        assert_eq!(spot.profile(0.0), (1.0, 0.0));
        let (value, slope) = spot.profile(31_f64.to_radians());
        assert!((value - 0.5).abs() < 1e-12);
        assert!((slope + 1.0 / 42_f64.to_radians()).abs() < 1e-12);
        assert_eq!(spot.profile(1.0).0, 0.0);
    }
}
