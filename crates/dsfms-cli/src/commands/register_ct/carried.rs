//! Structures carried onto the template.

use dsfms::mesh::Mesh;

/// A structure in the template's frame, and the expected error of its points, mm.
pub struct Carried {
    pub name: String,
    pub mesh: Mesh,
    pub expected: Vec<f64>,
}

impl Carried {
    /// Root mean square of the expected errors, mm.
    pub fn error(&self) -> f64 {
        let square: f64 = self.expected.iter().map(|e| e * e).sum();
        (square / self.expected.len().max(1) as f64).sqrt()
    }
}
