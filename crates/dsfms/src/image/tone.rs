//! Tone curves: from the 8-bit value of the file to linear light.

use serde::{Deserialize, Serialize};

/// How encoded values map to linear light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToneCurve {
    /// Values are proportional to light already.
    Linear,
    /// IEC 61966-2-1, the default for camera files that say nothing.
    #[default]
    Srgb,
    /// `light = value^gamma`.
    Gamma(f64),
    /// 256 linear values, one per encoded value.
    Table(Vec<f64>),
}

impl ToneCurve {
    /// Whether every encoded value has a linear one: a table may come from a damaged file.
    pub(crate) fn is_plausible(&self) -> bool {
        match self {
            Self::Linear | Self::Srgb => true,
            Self::Gamma(gamma) => *gamma > 0.0 && gamma.is_finite(),
            Self::Table(table) => {
                table.len() == 256 && table.iter().all(|v| *v >= 0.0 && v.is_finite())
            }
        }
    }

    /// Linear light for each of the 256 encoded values.
    pub fn table(&self) -> [f32; 256] {
        std::array::from_fn(|v| self.decode(v as f64 / 255.0) as f32)
    }

    /// Linear light of one encoded value in `[0, 1]`.
    pub fn decode(&self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Srgb if value <= 0.04045 => value / 12.92,
            Self::Srgb => ((value + 0.055) / 1.055).powf(2.4),
            Self::Gamma(gamma) => value.powf(*gamma),
            Self::Table(table) => table[(value * 255.0).round() as usize],
        }
    }
}
