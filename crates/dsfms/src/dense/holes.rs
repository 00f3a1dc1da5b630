//! Small holes closed by a film that meets the surface around them.

use super::tetrahedra::Triangles;
use crate::geometry::{Point3, Vector3};
use crate::mesh::faces::{pieces, simple_loops};
use std::collections::BTreeMap;

/// Close every boundary loop of at most `max_edges` edges but the longest of each piece, which is
/// the rim of that open surface. Expects one fan a vertex.
pub(super) fn close_small(triangles: &mut Triangles, max_edges: usize) {
    let loops = simple_loops(&triangles.faces);
    let length = |ring: &Vec<u32>| -> f64 {
        let place = |i: usize| triangles.positions[ring[i % ring.len()] as usize];
        (0..ring.len()).map(|i| (place(i + 1) - place(i)).norm()).sum()
    };
    let mut piece = vec![0; triangles.positions.len()];
    for (face, label) in triangles.faces.iter().zip(pieces(&triangles.faces)) {
        face.iter().for_each(|&v| piece[v as usize] = label);
    }
    let mut rims: BTreeMap<u32, (f64, usize)> = BTreeMap::new();
    for (i, ring) in loops.iter().enumerate() {
        let rim = rims.entry(piece[ring[0] as usize]).or_insert((0.0, i));
        if length(ring) > rim.0 {
            *rim = (length(ring), i);
        }
    }
    for (i, ring) in loops.iter().enumerate() {
        let rim = rims.get(&piece[ring[0] as usize]).is_some_and(|rim| rim.1 == i);
        if !rim && ring.len() >= 3 && ring.len() <= max_edges {
            close(triangles, ring);
        }
    }
}

fn close(triangles: &mut Triangles, ring: &[u32]) {
    if ring.len() == 3 {
        triangles.faces.push([ring[2], ring[1], ring[0]]);
        return;
    }
    let first = triangles.positions.len();
    let sum: Vector3 = ring.iter().map(|&v| triangles.positions[v as usize].coords).sum();
    let middle = Point3::from(sum / ring.len() as f64);
    // As many rings as make about square cells half way in.
    let rings = (ring.len() / 6).min(MAX_RINGS);
    let mut outer = ring.to_vec();
    for k in 1..=rings {
        let t = k as f64 / (rings + 1) as f64;
        let inner: Vec<u32> = (0..ring.len())
            .map(|i| {
                let rim = triangles.positions[ring[i] as usize];
                triangles.positions.push(rim + t * (middle - rim));
                triangles.positions.len() as u32 - 1
            })
            .collect();
        for i in 0..ring.len() {
            let j = (i + 1) % ring.len();
            triangles.faces.push([outer[j], outer[i], inner[i]]);
            triangles.faces.push([outer[j], inner[i], inner[j]]);
        }
        outer = inner;
    }
    let centre = triangles.positions.len() as u32;
    triangles.positions.push(middle);
    for i in 0..ring.len() {
        let [a, b] = [outer[(i + 1) % ring.len()], outer[i]];
        triangles.faces.push([a, b, centre]);
    }
    fair(triangles, first, ring);
}

/// Rings of vertices in a closed hole, at most.
const MAX_RINGS: usize = 12;
/// Share of the last step that is taken again; settles waves of twice [`MAX_RINGS`] edges.
const MOMENTUM: f64 = 0.97;
/// Rounds of fairing; each moves what the rim says one ring inwards.
const FAIRING: usize = 400;

/// Let the new vertices (from `first` on) settle into a surface whose Laplacian varies as little as
/// it can (a thin plate): it goes on with the slope and the curvature found around the hole,
/// without the crease of a flat lid.
fn fair(triangles: &mut Triangles, first: usize, ring: &[u32]) {
    let n = triangles.positions.len();
    let mut near = vec![false; n];
    (first..n).for_each(|v| near[v] = true);
    ring.iter().for_each(|&v| near[v as usize] = true);
    let mut neighbours: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for face in triangles.faces.iter().filter(|f| f.iter().any(|&v| near[v as usize])) {
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (face[i], face[j])) {
            for (v, other) in [(a, b), (b, a)] {
                if near[v as usize] {
                    neighbours.entry(v).or_default().push(other);
                }
            }
        }
    }
    for around in neighbours.values_mut() {
        around.sort_unstable();
        around.dedup();
    }
    let lag = |positions: &[Point3], v: u32| -> Vector3 {
        let around = &neighbours[&v];
        let sum: Vector3 = around.iter().map(|&o| positions[o as usize].coords).sum();
        sum / around.len() as f64 - positions[v as usize].coords
    };
    let mut speed = vec![Vector3::zeros(); n - first];
    let inside = || neighbours.range(first as u32..).map(|(v, around)| (*v, around));
    for round in 0..FAIRING {
        let film = round < FAIRING / 4;
        let bend: BTreeMap<u32, Vector3> = if film {
            BTreeMap::new()
        } else {
            neighbours.keys().map(|&v| (v, lag(&triangles.positions, v))).collect()
        };
        let moves: Vec<(u32, Vector3)> = inside()
            .map(|(v, around)| {
                if film {
                    return (v, lag(&triangles.positions, v));
                }
                let mean: Vector3 = around.iter().map(|o| bend[o]).sum();
                (v, 0.5 * (bend[&v] - mean / around.len() as f64))
            })
            .collect();
        for (v, step) in moves {
            let moved = &mut speed[v as usize - first];
            // Heavy ball: long waves settle in the square root of the rounds.
            *moved = if film { step } else { MOMENTUM * *moved + step };
            triangles.positions[v as usize] += *moved;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;

    #[test]
    fn a_square_hole_in_a_square_is_closed() {
        // Outer ring 0..4, inner ring 4..8.
        let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let outer = [at(0.0, 0.0), at(3.0, 0.0), at(3.0, 3.0), at(0.0, 3.0)];
        let inner = [at(1.0, 1.0), at(2.0, 1.0), at(2.0, 2.0), at(1.0, 2.0)];
        let mut faces = Vec::new();
        for i in 0..4u32 {
            let j = (i + 1) % 4;
            faces.push([i, j, 4 + i]);
            faces.push([j, 4 + j, 4 + i]);
        }
        let mut square = Triangles { positions: [outer, inner].concat(), faces };
        assert_eq!(simple_loops(&square.faces).len(), 2);
        close_small(&mut square, 10);
        assert_eq!(simple_loops(&square.faces), vec![vec![0, 1, 2, 3]]);
        let topology = Topology::new(square.positions.len(), square.faces).unwrap();
        assert_eq!(topology.euler_characteristic(), 1);
        assert!((square.positions[8] - at(1.5, 1.5)).norm() < 1e-12);
    }

    #[test]
    fn the_rim_of_every_piece_stays_open() {
        let at = |i: usize| Point3::new(i as f64, (i * i) as f64, 0.0);
        let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let mut two = Triangles { positions: (0..8).map(at).collect(), faces };
        close_small(&mut two, 10);
        assert_eq!(two.faces.len(), 4);
    }

    #[test]
    fn a_hole_in_a_dome_is_closed_by_a_dome() {
        // z = r²/40 on a polar grid from r = 4 to r = 10; the hole's rim lies at 0.4.
        let (n, rings) = (36u32, 13u32);
        let dome = |k: u32, i: u32| {
            let (r, a) = (4.0 + 0.5 * k as f64, i as f64 * std::f64::consts::TAU / n as f64);
            Point3::new(r * a.cos(), r * a.sin(), r * r / 40.0)
        };
        let positions = (0..rings).flat_map(|k| (0..n).map(move |i| dome(k, i))).collect();
        let mut faces = Vec::new();
        for (k, i) in (0..rings - 1).flat_map(|k| (0..n).map(move |i| (k, i))) {
            let [a, b, c, d] =
                [k * n + i, (k + 1) * n + i, (k + 1) * n + (i + 1) % n, k * n + (i + 1) % n];
            faces.extend([[a, b, c], [a, c, d]]);
        }
        let mut dome = Triangles { positions, faces };
        let first = dome.positions.len();
        close_small(&mut dome, 40);
        assert_eq!(simple_loops(&dome.faces).len(), 1);
        // A flat lid would be off by 0.4 in the middle.
        let off = |p: &Point3| (p.z - p.coords.xy().norm_squared() / 40.0).abs();
        let worst = dome.positions[first..].iter().map(off).fold(0.0, f64::max);
        assert!(dome.positions.len() > first && worst < 0.2, "{worst}");
    }
}
