//! What is said of the exploration: its precision.

use dsfms::pipeline::SparsePrecision;
use dsfms::template::LengthUnit;

/// A row below those of `inspect`.
pub fn precision_row(precision: &SparsePrecision, unit: LengthUnit) -> String {
    let (centre, rotation_deg) = precision.cameras();
    let (points, unit) = (precision.point_median, unit.label());
    format!(
        "{:<14}camera centres {centre:.4} {unit}, rotations {rotation_deg:.4} deg (rms), \
         sparse points {points:.4} {unit} (median): expected errors, see precision.json\n",
        "precision"
    )
}
