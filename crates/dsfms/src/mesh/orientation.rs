//! Inside and outside.

use super::{Mesh, Topology, TopologyError};

/// Volume enclosed by a closed surface, cubic length units; negative where the normals point
/// inward. For an open surface the value depends on the origin and means nothing.
pub(crate) fn signed_volume(mesh: &Mesh) -> f64 {
    let about = mesh.positions.first().map(|p| p.coords).unwrap_or_default();
    let six = |f| {
        let [a, b, c] = mesh.corners(f).map(|p| p.coords - about);
        a.dot(&b.cross(&c))
    };
    (0..mesh.topology.faces.len()).map(six).sum::<f64>() / 6.0
}

/// Whether no edge lies on a boundary.
pub(crate) fn is_closed(topology: &Topology) -> bool {
    topology.edge_faces.iter().all(|f| f[1] != u32::MAX)
}

/// Every face turned inside out (its last two corners swapped); vertex and face order are kept.
///
/// # Errors
/// As [`Mesh::new`], which checks the turned faces.
pub fn flipped(mesh: &Mesh) -> Result<Mesh, TopologyError> {
    let faces = mesh.topology.faces.iter().map(|&[a, b, c]| [a, c, b]).collect();
    Mesh::new(mesh.positions.clone(), faces)
}

/// The mesh with outward normals, and whether it had to be turned. Only a closed surface says
/// where outside is: an open one comes back as it is.
///
/// # Errors
/// As [`flipped`].
pub(crate) fn oriented_outward(mesh: &Mesh) -> Result<(Mesh, bool), TopologyError> {
    if is_closed(&mesh.topology) && signed_volume(mesh) < 0.0 {
        return Ok((flipped(mesh)?, true));
    }
    Ok((mesh.clone(), false))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_sphere_is_turned_once() {
        let sphere = shapes::icosphere(3, 2.0);
        let volume = signed_volume(&sphere);
        assert!((volume - 33.5).abs() < 0.5, "{volume}");
        let inside_out = flipped(&sphere).unwrap();
        assert_eq!(signed_volume(&inside_out), -volume);
        let (back, turned) = oriented_outward(&inside_out).unwrap();
        assert!(turned && signed_volume(&back) > 0.0);
        assert!(!oriented_outward(&shapes::hemisphere(2, 1.0)).unwrap().1);
    }
}
