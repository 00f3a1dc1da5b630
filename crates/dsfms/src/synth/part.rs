//! A part of an organ as a laparoscope sees it: what faces one direction around a random place.

use super::patch::{Patch, textured};
use super::random::{Random, uniform};
use crate::geometry::{Point3, Vector3, area};
use crate::mesh::boundary::boundary_loops;
use crate::mesh::remesh::{RemeshOptions, remesh};
use crate::mesh::{Mesh, components::face_edges};
use nalgebra::{Rotation3, Unit};

/// Width and height of the part before it is scaled, of the diagonal of the organ's bounding box.
const WIDTH: f64 = 0.30;
const HEIGHT: f64 = 0.24;

/// Faces that turn further away than this from the part's direction do not belong to it, degrees.
const STEEPEST_DEG: f64 = 62.0;

/// Area of the part after scaling, that of a patch of 50 × 40 mm, mm².
const AREA: f64 = 2000.0;

/// Times that faces hanging by one edge are dropped from the rim.
const EAR_ROUNDS: usize = 3;

/// Rounds of averaging along the rim.
const RIM_ROUNDS: usize = 6;

/// Largest `perimeter² / (4π area)`; 1 for a flat disc, 1.3 for a rectangle of 5 × 4.
const LEAST_COMPACT: f64 = 1.8;

/// Places that are tried.
const ATTEMPTS: usize = 60;

/// A random part of a closed or open surface (outward normals; any unit), turned so that it faces
/// −z with its centre at the origin, scaled to an area of 2,000 mm², remeshed to about `vertices`
/// vertices and given a seeded albedo. The part is a compact disc: one boundary, no handle.
///
/// `None` where no place gave such a part with at least half of the area of its frame.
pub fn part(organ: &Mesh, vertices: usize, seed: u64) -> Option<Patch> {
    let mut random = Random::new(seed, 0x0A27);
    let [low, high] = organ.bounding_box();
    let diagonal = (high - low).norm();
    let areas = organ.face_areas();
    let mut cumulative = Vec::with_capacity(areas.len());
    areas.iter().fold(0.0, |sum, a| {
        cumulative.push(sum + a);
        sum + a
    });
    let total = *cumulative.last()?;
    let neighbours = face_edges(&organ.topology);
    for _ in 0..ATTEMPTS {
        let drawn = uniform(&mut random) * total;
        let face = cumulative.partition_point(|&c| c <= drawn).min(areas.len() - 1);
        let turn = std::f64::consts::TAU * uniform(&mut random);
        let found = cut(organ, face, turn, diagonal, &neighbours);
        if let Some(mesh) = found.and_then(|mesh| finish(mesh, diagonal, vertices)) {
            return Some(textured(mesh, seed));
        }
    }
    None
}

/// The connected piece around a face, in axes where its mean normal is −z.
fn cut(
    organ: &Mesh,
    face: usize,
    turn: f64,
    diagonal: f64,
    neighbours: &[[u32; 3]],
) -> Option<Mesh> {
    let centroid = |f: usize| {
        let [a, b, c] = organ.corners(f);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    };
    let normal = |f: usize| {
        let [a, b, c] = organ.corners(f);
        (b - a).cross(&(c - a))
    };
    let centre = centroid(face);
    let near = |f: usize| {
        (centroid(f) - centre).norm() < 0.5 * HEIGHT * diagonal
            && normal(f).dot(&normal(face)) > 0.0
    };
    let around = grow(organ, face, neighbours, near);
    let facing = Unit::try_new(around.iter().map(|&f| normal(f)).sum::<Vector3>(), 1e-12)?;
    let to_view = Rotation3::rotation_between(&facing, &-Vector3::z_axis())
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let to_view = Rotation3::from_axis_angle(&Vector3::z_axis(), turn) * to_view;
    let place = |p: &Point3| to_view * (p - centre);
    let cosine = STEEPEST_DEG.to_radians().cos();
    let inside = |f: usize| {
        let n = normal(f);
        let corners = organ.corners(f).map(place);
        n.dot(&facing) > cosine * n.norm()
            && corners.iter().all(|p| {
                p.x.abs() <= 0.5 * WIDTH * diagonal && p.y.abs() <= 0.5 * HEIGHT * diagonal
            })
    };
    if !inside(face) {
        return None;
    }
    let mut faces = grow(organ, face, neighbours, inside);
    for _ in 0..EAR_ROUNDS {
        faces = without_ears(organ, &faces, neighbours);
    }
    let (piece, _) = organ.subset(&faces);
    let positions = piece.positions.iter().map(|p| Point3::from(place(p))).collect();
    Some(smooth_rim(piece.with_positions(positions)))
}

/// Even out the teeth that cutting along faces leaves: the boundary is averaged along itself.
fn smooth_rim(mut piece: Mesh) -> Mesh {
    for rim in boundary_loops(&piece.topology) {
        let n = rim.len();
        for _ in 0..RIM_ROUNDS {
            let at = |k: usize| piece.positions[rim[k % n] as usize].coords;
            let even = |k: usize| 0.5 * at(k) + 0.25 * (at(k + 1) + at(k + n - 1));
            let moved: Vec<Vector3> = (0..n).map(even).collect();
            for (&v, p) in rim.iter().zip(moved) {
                piece.positions[v as usize] = Point3::from(p);
            }
        }
    }
    piece
}

/// Faces of a piece without those that hang on it by one edge only.
fn without_ears(organ: &Mesh, faces: &[usize], neighbours: &[[u32; 3]]) -> Vec<usize> {
    let mut kept = vec![false; organ.topology.faces.len()];
    faces.iter().for_each(|&f| kept[f] = true);
    let joined = |f: usize| {
        let across = |&e: &u32| organ.topology.across(e as usize, f as u32);
        neighbours[f].iter().filter_map(across).filter(|&g| kept[g as usize]).count()
    };
    faces.iter().copied().filter(|&f| joined(f) > 1).collect()
}

/// Faces that are joined to a face by admitted ones.
fn grow(
    organ: &Mesh,
    start: usize,
    neighbours: &[[u32; 3]],
    admitted: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let mut reached = vec![false; organ.topology.faces.len()];
    reached[start] = true;
    let mut open = vec![start];
    while let Some(f) = open.pop() {
        for &edge in &neighbours[f] {
            if let Some(next) = organ.topology.across(edge as usize, f as u32) {
                let next = next as usize;
                if !reached[next] && admitted(next) {
                    reached[next] = true;
                    open.push(next);
                }
            }
        }
    }
    (0..reached.len()).filter(|&f| reached[f]).collect()
}

/// Scale and mesh a piece that is large enough and a disc.
fn finish(piece: Mesh, diagonal: f64, vertices: usize) -> Option<Mesh> {
    let found: f64 = piece.face_areas().iter().sum();
    let frame = WIDTH * HEIGHT * diagonal * diagonal;
    let disc =
        piece.topology.euler_characteristic() == 1 && boundary_loops(&piece.topology).len() == 1;
    if !disc || found < 0.5 * frame {
        return None;
    }
    let meshed = remesh(&piece, vertices, &RemeshOptions::default()).ok()?;
    let total: f64 = meshed.face_areas().iter().sum();
    if perimeter(&meshed).powi(2) > LEAST_COMPACT * 4.0 * std::f64::consts::PI * total {
        return None;
    }
    let scale = (AREA / total).sqrt();
    let count = meshed.positions.len() as f64;
    let middle = meshed.positions.iter().map(|p| p.coords).sum::<Vector3>() / count;
    let positions = meshed.positions.iter().map(|p| (p - middle) * scale);
    let mesh = meshed.with_positions(positions.collect());
    // A face that remeshing turned over would be black.
    let upright = |f: usize| {
        let [a, b, c] = mesh.corners(f);
        (b - a).cross(&(c - a)).z < 0.0 && area(a, b, c) > 0.0
    };
    (0..mesh.topology.faces.len()).all(upright).then_some(mesh)
}

fn perimeter(mesh: &Mesh) -> f64 {
    let length = |rim: &Vec<u32>| {
        let at = |k: usize| mesh.positions[rim[k % rim.len()] as usize];
        (0..rim.len()).map(|k| (at(k + 1) - at(k)).norm()).sum::<f64>()
    };
    boundary_loops(&mesh.topology).iter().map(length).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes::icosphere;

    #[test]
    fn a_part_of_a_sphere_faces_the_camera() {
        let organ = icosphere(4, 30.0);
        let part = part(&organ, 150, 5).unwrap();
        let total: f64 = part.mesh.face_areas().iter().sum();
        assert!((total - 2000.0).abs() < 1e-6, "{total}");
        assert_eq!(boundary_loops(&part.mesh.topology).len(), 1);
        let n = part.mesh.positions.len();
        assert!((120..=180).contains(&n), "{n} vertices");
        // Bulging towards −z, about the origin.
        let [low, high] = part.mesh.bounding_box();
        assert!(low.z < -1.0 && high.z > 1.0, "{low} {high}");
        let crown = part.mesh.positions.iter().min_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
        assert!(crown.coords.xy().norm() < 10.0, "{crown}");
    }

    #[test]
    fn every_seed_gives_its_own_part() {
        let organ = icosphere(4, 30.0);
        let of = |seed| part(&organ, 120, seed).unwrap().mesh.positions;
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
    }
}
