//! What is known of every vertex, and the parts of the surface of which nothing is.

use super::TileVerdict;
use super::reason::Part;
use crate::camera::{Camera, CameraModel};
use crate::geometry::{GRAIN, Point2, Point3, Vector3, area_normal};
use crate::mesh::Mesh;
use crate::mesh::components::vertex_parts;
use crate::mesh::normals::{face_normals, lumped_areas};
use rayon::prelude::*;

/// What is known of a vertex in one frame; the numbers are those of the files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Region {
    /// Not seen: turned away, behind something, outside of the image, or under a given mask.
    Hidden = 0,
    /// Seen, and matches or the image around speak for it.
    Observed = 1,
    /// Seen, but unobserved: no match and no brightness constrains it.
    Unobserved = 2,
    /// Seen, and the image shows something else than the template there.
    Contradicted = 3,
    /// A face at it is folded over.
    Folded = 4,
}

/// What is known of every vertex, and the number of folded faces. `says`: what the image tells of a
/// point of the surface (camera axes); `near_match`: vertices that a match lies near, where it is
/// known.
pub(crate) fn regions(
    rest: &Mesh,
    shape: &[Point3],
    visible: &[bool],
    says: impl Fn(&Point3) -> TileVerdict + Sync,
    near_match: Option<&[bool]>,
) -> (Vec<Region>, usize) {
    let (over, faces) = folded(rest, shape);
    let of = |v: usize| match says(&shape[v]) {
        _ if !visible[v] => Region::Hidden,
        _ if over[v] => Region::Folded,
        TileVerdict::Contradicts => Region::Contradicted,
        TileVerdict::Agrees => Region::Observed,
        TileVerdict::Nothing if near_match.is_none_or(|near| near[v]) => Region::Observed,
        TileVerdict::Nothing => Region::Unobserved,
    };
    ((0..shape.len()).into_par_iter().with_min_len(GRAIN).map(of).collect(), faces)
}

/// Faces that meet at less than this cosine are folded where they were flat.
const FOLDED: f64 = -0.3;
const FLAT: f64 = 0.5;

/// Vertices of faces that are folded over, and the number of such faces: at an edge whose two faces
/// were about in one plane and now lie back to back.
pub fn folded(rest: &Mesh, shape: &[Point3]) -> (Vec<bool>, usize) {
    let topology = &rest.topology;
    let cosine = |[a, b]: [Vector3; 2]| a.dot(&b) / (a.norm() * b.norm()).max(f64::MIN_POSITIVE);
    let normals = face_normals(&topology.faces, shape);
    let at_rest = |f: u32| {
        let [a, b, c] = rest.corners(f as usize);
        area_normal(a, b, c)
    };
    let mut folded = vec![false; topology.faces.len()];
    for pair in topology.edge_faces.iter().filter(|pair| pair[1] != u32::MAX) {
        let over = cosine(pair.map(|f| normals[f as usize])) < FOLDED;
        if over && cosine(pair.map(at_rest)) > FLAT {
            pair.iter().for_each(|&f| folded[f as usize] = true);
        }
    }
    let mut vertices = vec![false; topology.vertex_count];
    for (face, _) in topology.faces.iter().zip(&folded).filter(|(_, folded)| **folded) {
        face.iter().for_each(|&v| vertices[v as usize] = true);
    }
    (vertices, folded.iter().filter(|f| **f).count())
}

/// The largest connected part of what is in one region, of the area that is seen.
pub fn largest_part(
    rest: &Mesh,
    camera: &CameraModel,
    shape: &[Point3],
    regions: &[Region],
    which: Region,
) -> Option<Part> {
    let areas = lumped_areas(rest);
    let seen = |v: usize| regions[v] != Region::Hidden;
    let whole: f64 = (0..regions.len()).filter(|&v| seen(v)).map(|v| areas[v]).sum();
    let parts = vertex_parts(&rest.topology, |v| (regions[v] == which).then_some(()));
    let mut best: Option<(f64, Vec<usize>)> = None;
    for part in parts {
        let size: f64 = part.iter().map(|&v| areas[v]).sum();
        if best.as_ref().is_none_or(|b| size > b.0) {
            best = Some((size, part));
        }
    }
    let (size, part) = best?;
    let pixels: Vec<Point2> =
        part.iter().filter_map(|&v| Some(camera.project(&shape[v])?.pixel)).collect();
    let n = pixels.len().max(1) as f64;
    let centre = pixels.iter().map(|p| p.coords).sum::<crate::geometry::Vector2>() / n;
    let square = pixels.iter().map(|p| (p.coords - centre).norm_squared()).sum::<f64>() / n;
    Some(Part {
        share: size / whole.max(f64::MIN_POSITIVE),
        centre_px: [centre.x, centre.y],
        radius_px: square.sqrt(),
    })
}

/// Share of the seen area that lies in a region.
pub fn share(rest: &Mesh, regions: &[Region], which: Region) -> f64 {
    let areas = lumped_areas(rest);
    let sum = |of: &dyn Fn(Region) -> bool| -> f64 {
        areas.iter().zip(regions).filter(|(_, r)| of(**r)).map(|(a, _)| a).sum()
    };
    sum(&|r| r == which) / sum(&|r| r != Region::Hidden).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;
    use crate::geometry::Vector3;
    use crate::synth::patch;

    #[test]
    fn a_face_turned_over_is_found_and_a_bend_is_not() {
        let mesh = patch(200, 1).mesh;
        let bent: Vec<Point3> =
            mesh.positions.iter().map(|p| Point3::new(p.x, p.y, p.z + 0.02 * p.x * p.x)).collect();
        assert_eq!(folded(&mesh, &bent).1, 0);
        // One inner vertex drawn far across its neighbours.
        let inner = (0..200).find(|&v| !mesh.topology.boundary[v]).unwrap();
        let mut over = mesh.positions.clone();
        over[inner] += Vector3::new(4.0 * mesh.mean_edge_length(), 0.0, 0.0);
        let (vertices, faces) = folded(&mesh, &over);
        assert!(faces > 0 && vertices[inner]);
    }

    #[test]
    fn the_largest_part_is_named_with_its_place() {
        let mesh = patch(400, 1).mesh;
        let lens = Lens::Pinhole;
        let camera =
            CameraModel { size: [720, 576], focal: [750.0; 2], centre: [359.5, 287.5], lens };
        let shape: Vec<Point3> =
            mesh.positions.iter().map(|p| p + Vector3::new(0.0, 0.0, 75.0)).collect();
        let right = |p: &Point3| if p.x > 0.0 { Region::Unobserved } else { Region::Observed };
        let mut regions: Vec<Region> = mesh.positions.iter().map(right).collect();
        regions[0] = Region::Hidden;
        let part = largest_part(&mesh, &camera, &shape, &regions, Region::Unobserved).unwrap();
        assert!((0.4..0.6).contains(&part.share) && part.centre_px[0] > 400.0, "{part:?}");
        assert!((share(&mesh, &regions, Region::Unobserved) - part.share).abs() < 0.05);
        assert_eq!(largest_part(&mesh, &camera, &shape, &regions, Region::Folded), None);
    }
}
