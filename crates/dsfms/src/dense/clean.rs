//! A triangle soup into one clean manifold piece.

use super::tetrahedra::Triangles;
use crate::geometry::{Point3, Vector3};
use crate::mesh::faces::{boundary_edges, edge_list, pieces};
use std::collections::BTreeMap;

/// Weights of the two steps of Taubin's smoothing: shrink, then grow back a little more.
const TAUBIN: [f64; 2] = [0.5, -0.53];

/// Keep the pieces (connected over edges) of the most faces only.
pub(super) fn keep_largest(triangles: &mut Triangles) {
    let labels = pieces(&triangles.faces);
    let mut sizes = BTreeMap::<u32, usize>::new();
    labels.iter().for_each(|&l| *sizes.entry(l).or_default() += 1);
    // Of equal pieces the first.
    let largest = sizes.iter().max_by_key(|(label, size)| (**size, std::cmp::Reverse(**label)));
    let Some((&largest, _)) = largest else { return };
    retain(triangles, |f| labels[f] == largest);
}

/// Drop pieces of fewer than `faces` faces.
pub(super) fn drop_small(triangles: &mut Triangles, faces: usize) {
    let labels = pieces(&triangles.faces);
    let mut sizes = BTreeMap::<u32, usize>::new();
    labels.iter().for_each(|&l| *sizes.entry(l).or_default() += 1);
    retain(triangles, |f| sizes[&labels[f]] >= faces);
}

fn retain(triangles: &mut Triangles, keep: impl Fn(usize) -> bool) {
    let mut f = 0;
    triangles.faces.retain(|_| {
        f += 1;
        keep(f - 1)
    });
}

/// Take away faces with two or more sides on the boundary until there are none: the teeth left by
/// the grid at the rim.
pub(super) fn shave(triangles: &mut Triangles) {
    for _ in 0..8 {
        let boundary = boundary_edges(&triangles.faces);
        let mut rim = vec![false; triangles.positions.len()];
        boundary.iter().flatten().for_each(|&v| rim[v as usize] = true);
        let open = |f: &[u32; 3]| {
            let [a, b, c] = *f;
            if !f.iter().any(|&v| rim[v as usize]) {
                return 0;
            }
            [[a, b], [b, c], [c, a]].iter().filter(|e| boundary.binary_search(e).is_ok()).count()
        };
        let before = triangles.faces.len();
        triangles.faces.retain(|f| open(f) < 2);
        if triangles.faces.len() == before {
            break;
        }
    }
}

/// Morphological opening of the open surface: what hangs on by necks narrower than `2 * rings`
/// edges is dropped (crumbs of wrong depth at the rim), the rest keeps its outline.
pub(super) fn open(triangles: &mut Triangles, rings: usize) {
    let n = triangles.positions.len();
    let mut rim = vec![false; n];
    boundary_edges(&triangles.faces).iter().flatten().for_each(|&v| rim[v as usize] = true);
    let eroded = grown(&triangles.faces, rim, rings.saturating_sub(1));
    let core: Vec<usize> = (0..triangles.faces.len())
        .filter(|&f| triangles.faces[f].iter().all(|&v| !eroded[v as usize]))
        .collect();
    if core.is_empty() {
        return;
    }
    let own: Vec<[u32; 3]> = core.iter().map(|&f| triangles.faces[f]).collect();
    let labels = pieces(&own);
    let mut sizes = BTreeMap::<u32, usize>::new();
    labels.iter().for_each(|&l| *sizes.entry(l).or_default() += 1);
    let most = sizes.values().copied().max().unwrap_or(0);
    let mut kept = vec![false; n];
    for (face, label) in own.iter().zip(&labels) {
        // Pieces of some size stay; one piece is chosen elsewhere.
        if sizes[label] * 20 >= most {
            face.iter().for_each(|&v| kept[v as usize] = true);
        }
    }
    let kept = grown(&triangles.faces, kept, rings);
    triangles.faces.retain(|f| f.iter().all(|&v| kept[v as usize]));
}

/// The vertices within `rings` edges of the marked ones.
pub(super) fn grown(faces: &[[u32; 3]], mut marked: Vec<bool>, rings: usize) -> Vec<bool> {
    for _ in 0..rings {
        let before = marked.clone();
        for face in faces.iter().filter(|f| f.iter().any(|&v| before[v as usize])) {
            face.iter().for_each(|&v| marked[v as usize] = true);
        }
    }
    marked
}

/// Give each fan of faces at a vertex its own copy of it, so that every vertex has one fan.
pub(super) fn split_bow_ties(triangles: &mut Triangles) {
    let mut around = vec![Vec::new(); triangles.positions.len()];
    for (f, face) in triangles.faces.iter().enumerate() {
        face.iter().for_each(|&v| around[v as usize].push(f));
    }
    for (v, fan) in around.iter().enumerate() {
        let mut rest = fan.clone();
        let mut first = true;
        while let Some(seed) = rest.first().copied() {
            let group = connected_fan(&triangles.faces, &rest, seed, v as u32);
            rest.retain(|f| !group.contains(f));
            if !first {
                let copy = triangles.positions.len() as u32;
                triangles.positions.push(triangles.positions[v]);
                for &f in &group {
                    triangles.faces[f]
                        .iter_mut()
                        .filter(|c| **c == v as u32)
                        .for_each(|c| *c = copy);
                }
            }
            first = false;
        }
    }
}

/// Faces of `fan` reached from `seed` over edges at `v`.
fn connected_fan(faces: &[[u32; 3]], fan: &[usize], seed: usize, v: u32) -> Vec<usize> {
    let mut group = vec![seed];
    let mut next = 0;
    while next < group.len() {
        let face = faces[group[next]];
        for &f in fan {
            let shares = faces[f].iter().any(|c| *c != v && face.contains(c));
            if shares && !group.contains(&f) {
                group.push(f);
            }
        }
        next += 1;
    }
    group
}

/// Number the used vertices anew, in their order.
pub(super) fn compact(triangles: &mut Triangles) {
    let mut used = vec![false; triangles.positions.len()];
    triangles.faces.iter().flatten().for_each(|&v| used[v as usize] = true);
    let mut renumbered = vec![0u32; used.len()];
    let mut positions = Vec::new();
    for (v, _) in used.iter().enumerate().filter(|(_, used)| **used) {
        renumbered[v] = positions.len() as u32;
        positions.push(triangles.positions[v]);
    }
    triangles.faces.iter_mut().flatten().for_each(|v| *v = renumbered[*v as usize]);
    triangles.positions = positions;
}

/// Taubin's smoothing against the noise of the grid; the rim is smoothed along itself only.
pub(super) fn smooth(triangles: &mut Triangles, rounds: usize) {
    let n = triangles.positions.len();
    let boundary = boundary_edges(&triangles.faces);
    let mut rim = vec![false; n];
    boundary.iter().flatten().for_each(|&v| rim[v as usize] = true);
    let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); n];
    for ([a, b], _) in edge_list(&triangles.faces) {
        let along = rim[a as usize] == rim[b as usize];
        for (v, other) in [(a, b), (b, a)] {
            if !rim[v as usize] || along && is_boundary(&boundary, a, b) {
                neighbours[v as usize].push(other);
            }
        }
    }
    neighbours.iter_mut().for_each(|ring| ring.dedup());
    for _ in 0..rounds {
        for factor in TAUBIN {
            triangles.positions = step(&triangles.positions, &neighbours, factor);
        }
    }
}

fn is_boundary(boundary: &[[u32; 2]], a: u32, b: u32) -> bool {
    boundary.binary_search(&[a, b]).is_ok() || boundary.binary_search(&[b, a]).is_ok()
}

/// Move every vertex towards the mean of its neighbours by `factor` of the way.
fn step(positions: &[Point3], neighbours: &[Vec<u32>], factor: f64) -> Vec<Point3> {
    let moved = |(p, ring): (&Point3, &Vec<u32>)| {
        if ring.is_empty() {
            return *p;
        }
        let sum: Vector3 = ring.iter().map(|&v| positions[v as usize] - p).sum();
        p + sum * (factor / ring.len() as f64)
    };
    positions.iter().zip(neighbours).map(moved).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(n: usize) -> Vec<Point3> {
        (0..n).map(|i| Point3::new(i as f64, (i * i) as f64, 0.0)).collect()
    }

    #[test]
    fn a_bow_tie_becomes_two_corners() {
        let mut bow_tie = Triangles { positions: points(5), faces: vec![[0, 1, 2], [2, 3, 4]] };
        split_bow_ties(&mut bow_tie);
        assert_eq!(bow_tie.faces, vec![[0, 1, 2], [5, 3, 4]]);
        assert_eq!(bow_tie.positions[5], bow_tie.positions[2]);
    }

    #[test]
    fn the_larger_piece_stays_and_is_renumbered() {
        let faces = vec![[0, 1, 2], [3, 4, 5], [5, 4, 6]];
        let mut two = Triangles { positions: points(7), faces };
        keep_largest(&mut two);
        compact(&mut two);
        assert_eq!(two.faces, vec![[0, 1, 2], [2, 1, 3]]);
        assert_eq!(two.positions[0], points(7)[3]);
    }

    #[test]
    fn a_crumb_on_a_thin_neck_goes_and_the_sheet_stays() {
        // A sheet of 20 x 20 squares, a strip of width 1 from its side, a crumb of 4 x 4 at its
        // end.
        let inside = |x: usize, y: usize| {
            (x < 20 && y < 20) || (x < 30 && y == 10) || (x >= 30 && (8..12).contains(&y))
        };
        let index = |x: usize, y: usize| (y * 35 + x) as u32;
        let mut faces = Vec::new();
        for (x, y) in (0..34).flat_map(|x| (0..20).map(move |y| (x, y))) {
            if inside(x, y) {
                let [a, b, c, d] =
                    [index(x, y), index(x + 1, y), index(x + 1, y + 1), index(x, y + 1)];
                faces.extend([[a, b, c], [a, c, d]]);
            }
        }
        let mut sheet = Triangles { positions: points(35 * 21), faces };
        open(&mut sheet, 3);
        let reach = sheet.faces.iter().flatten().map(|v| v % 35).max();
        assert!(reach.is_some_and(|x| (19..24).contains(&x)), "{reach:?}");
        assert!(sheet.faces.len() > 780, "{}", sheet.faces.len());
    }
}
