//! What the readers of meshes share: units, what was found before any check, how polygons are
//! split.

use crate::geometry::{Point2, Point3};
use crate::template::LengthUnit;
use std::collections::BTreeMap;

/// Unit of the numbers in a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshUnit {
    /// mm: what every file of this program uses where the scale is known.
    Millimetre,
    /// cm.
    Centimetre,
    /// m: what the glTF standard prescribes (and exporters often ignore).
    Metre,
    /// Similar to the true shape, of unknown scale.
    TemplateUnit,
}

impl MeshUnit {
    /// Factor to mm; `None` where the scale is unknown.
    pub fn in_millimetres(self) -> Option<f64> {
        match self {
            Self::Millimetre => Some(1.0),
            Self::Centimetre => Some(10.0),
            Self::Metre => Some(1000.0),
            Self::TemplateUnit => None,
        }
    }

    /// As texts name it; `MeshUnit::from_comment` reads it back.
    pub fn label(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
            Self::TemplateUnit => "template_units",
        }
    }

    /// What lengths in this unit are multiplied by to be in `other`; `None` where only one of the
    /// two scales is known.
    pub fn factor_to(self, other: Self) -> Option<f64> {
        match (self.in_millimetres(), other.in_millimetres()) {
            _ if self == other => Some(1.0),
            (Some(own), Some(other)) => Some(own / other),
            _ => None,
        }
    }

    /// The unit a header comment such as `units mm` names; of one that is not known the name.
    fn from_comment(comment: &str) -> Option<Result<Self, &str>> {
        let mut words = comment.split([' ', '\t', ':', '=', ',', ';']).filter(|w| !w.is_empty());
        words.find(|w| matches!(w.to_ascii_lowercase().as_str(), "units" | "unit"))?;
        let word = words.next()?;
        Some(match word.to_ascii_lowercase().as_str() {
            "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => {
                Ok(Self::Millimetre)
            }
            "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => {
                Ok(Self::Centimetre)
            }
            "m" | "metre" | "metres" | "meter" | "meters" => Ok(Self::Metre),
            "template_unit" | "template_units" => Ok(Self::TemplateUnit),
            "in" | "inch" | "inches" | "ft" | "foot" | "feet" | "um" | "µm" | "micrometre"
            | "micrometres" | "micron" | "microns" => Err(word),
            _ => return None,
        })
    }
}

impl From<LengthUnit> for MeshUnit {
    fn from(unit: LengthUnit) -> Self {
        match unit {
            LengthUnit::Millimetre => Self::Millimetre,
            LengthUnit::TemplateUnit => Self::TemplateUnit,
        }
    }
}

/// Lengths of known and of unknown scale, which no factor brings together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("lengths in {} and in {} cannot be brought together: one of the scales is not known", found.label(), wanted.label())]
pub struct UnitMismatch {
    /// Unit of the mesh.
    pub found: MeshUnit,
    /// Unit that is wanted.
    pub wanted: MeshUnit,
}

/// What a reader of one format found, before any check.
#[derive(Clone, Debug, Default)]
pub(super) struct RawMesh {
    pub positions: Vec<Point3>,
    pub faces: Vec<[u32; 3]>,
    pub uv: Option<Vec<[Point2; 3]>>,
    pub unit: Option<MeshUnit>,
    pub attributes: BTreeMap<String, Vec<f64>>,
    pub warnings: Vec<String>,
}

impl RawMesh {
    /// Take the unit that a comment names, where none is known yet; one that is not known draws a
    /// warning.
    pub(super) fn state_unit(&mut self, comment: &str) {
        match MeshUnit::from_comment(comment) {
            Some(Ok(unit)) => self.unit = self.unit.or(Some(unit)),
            Some(Err(word)) if self.unit.is_none() => {
                self.warnings.push(format!("its unit '{word}' is not known, expected mm, cm or m"))
            }
            _ => {}
        }
    }
}

/// What a reader of one format may complain about; the file's name is added by
/// [`read_mesh`](super::mesh::read_mesh).
#[derive(Debug)]
pub(super) enum FormatError {
    Truncated(String),
    Malformed(String),
}

/// Split a polygon into the fan of its first corner.
pub(super) fn fan(corners: &[u32]) -> impl Iterator<Item = [usize; 3]> + use<> {
    (1..corners.len().saturating_sub(1)).map(|k| [0, k, k + 1])
}

/// The remark on split polygons.
pub(super) fn polygon_warning(count: usize) -> String {
    format!("{count} polygons with more than three corners were split into triangles (fans)")
}
