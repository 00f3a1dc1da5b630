//! The four passes of a remeshing round. Each works on the adjacency at its start and leaves alone
//! what it has already touched, so the order of the edges alone decides the result.

use super::outline::FixedEdges;
use super::working::WorkingMesh;
use crate::geometry::{Point3, Vector3, area_normal};
use crate::mesh::Topology;
use crate::mesh::normals::vertex_normals;
use crate::mesh::surface_points::ClosestPoints;

/// Split every edge longer than `longest` (times what is wanted there) in the middle, until there
/// is none (at most 8 halvings).
pub(super) fn split(work: &mut WorkingMesh, longest: f64) {
    for _ in 0..8 {
        let topology = work.topology();
        let mut middle = vec![u32::MAX; topology.edges.len()];
        for (e, &[a, b]) in topology.edges.iter().enumerate() {
            let (p, q) = (work.positions[a as usize], work.positions[b as usize]);
            if (p - q).norm() > longest * work.edge_size(a, b) {
                middle[e] = work.positions.len() as u32;
                work.positions.push(nalgebra::center(&p, &q));
                work.size.push(0.5 * (work.size[a as usize] + work.size[b as usize]));
                work.fixed.push(false);
            }
        }
        if middle.iter().all(|&m| m == u32::MAX) {
            return;
        }
        let mut faces = Vec::with_capacity(2 * topology.faces.len());
        for &[a, b, c] in &topology.faces {
            let at = |i, j| topology.edge_index(i, j).map_or(u32::MAX, |e| middle[e]);
            subdivide(&work.positions, [a, b, c], [at(a, b), at(b, c), at(c, a)], &mut faces);
        }
        work.faces = faces;
    }
}

/// Replace a face by two, three or four, given the middles of its edges ab, bc, ca.
fn subdivide(points: &[Point3], face: [u32; 3], middles: [u32; 3], out: &mut Vec<[u32; 3]>) {
    let none = u32::MAX;
    let count = middles.iter().filter(|&&m| m != none).count();
    // Turn the face so that the pattern starts at its first corner.
    let turn = match count {
        1 => middles.iter().position(|&m| m != none).unwrap_or(0),
        2 => middles.iter().position(|&m| m == none).map_or(0, |k| (k + 1) % 3),
        _ => 0,
    };
    let [a, b, c] = [0, 1, 2].map(|k| face[(turn + k) % 3]);
    let [ab, bc, ca] = [0, 1, 2].map(|k| middles[(turn + k) % 3]);
    match count {
        0 => out.push([a, b, c]),
        1 => out.extend([[a, ab, c], [ab, b, c]]),
        2 => {
            out.push([ab, b, bc]);
            let length = |i: u32, j: u32| (points[i as usize] - points[j as usize]).norm();
            // The rest is a quadrilateral a, ab, bc, c: take its shorter diagonal.
            if length(a, bc) <= length(ab, c) {
                out.extend([[a, ab, bc], [a, bc, c]]);
            } else {
                out.extend([[a, ab, c], [ab, bc, c]]);
            }
        }
        _ => out.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]),
    }
}

/// Collapse edges shorter than `shortest` (times what is wanted there), shortest first, where that
/// keeps the topology, turns no face over and makes no edge longer than `longest`.
pub(super) fn collapse(work: &mut WorkingMesh, shortest: f64, longest: f64) {
    for _ in 0..10 {
        let topology = work.topology();
        let length = |&[a, b]: &[u32; 2]| {
            (work.positions[a as usize] - work.positions[b as usize]).norm() / work.edge_size(a, b)
        };
        let mut short: Vec<(f64, usize)> = topology.edges.iter().map(length).zip(0..).collect();
        short.retain(|(l, _)| *l < shortest);
        short.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut touched = vec![false; topology.vertex_count];
        let mut gone = vec![u32::MAX; topology.vertex_count];
        let mut any = false;
        for (_, edge) in short {
            let Some((keep, drop, place)) = plan(work, &topology, edge) else { continue };
            let area = |v: u32| topology.one_ring[v as usize].iter().chain([&keep, &drop]);
            if area(keep).chain(area(drop)).any(|&v| touched[v as usize])
                || !harmless(work, &topology, [keep, drop], place, longest)
            {
                continue;
            }
            let around: Vec<u32> = area(keep).chain(area(drop)).copied().collect();
            around.into_iter().for_each(|v| touched[v as usize] = true);
            gone[drop as usize] = keep;
            work.positions[keep as usize] = place;
            any = true;
        }
        if !any {
            return;
        }
        merge(work, &gone);
    }
}

/// Which end of an edge stays and where; `None` where a collapse would change the topology.
fn plan(work: &WorkingMesh, t: &Topology, edge: usize) -> Option<(u32, u32, Point3)> {
    let [a, b] = t.edges[edge];
    let open = t.edge_faces[edge][1] == u32::MAX;
    let on = |v: u32| t.boundary[v as usize];
    let pinned = |v: u32| work.fixed[v as usize];
    if (on(a) && on(b) && !open) || (pinned(a) && pinned(b)) {
        return None;
    }
    let ring = &t.one_ring[b as usize];
    let common = t.one_ring[a as usize].iter().filter(|v| ring.binary_search(v).is_ok()).count();
    if common != if open { 1 } else { 2 } {
        return None;
    }
    // An open triangle or a tetrahedron must not vanish.
    if t.one_ring[a as usize].len() + ring.len() < if open { 5 } else { 8 } {
        return None;
    }
    let (p, q) = (work.positions[a as usize], work.positions[b as usize]);
    let rank = |v: u32| (pinned(v), on(v));
    Some(match rank(a).cmp(&rank(b)) {
        std::cmp::Ordering::Greater => (a, b, p),
        std::cmp::Ordering::Less => (b, a, q),
        std::cmp::Ordering::Equal => (a, b, nalgebra::center(&p, &q)),
    })
}

/// No face around the edge turns over or becomes a needle, no edge becomes too long.
fn harmless(work: &WorkingMesh, t: &Topology, ends: [u32; 2], place: Point3, longest: f64) -> bool {
    let moved = |v: u32| if ends.contains(&v) { place } else { work.positions[v as usize] };
    let size = |v: u32| work.edge_size(v, ends[0]).min(work.edge_size(v, ends[1]));
    ends.iter().all(|&end| {
        let short = t.one_ring[end as usize]
            .iter()
            .all(|&v| ends.contains(&v) || (moved(v) - place).norm() <= longest * size(v));
        short
            && t.vertex_faces[end as usize].iter().all(|&f| {
                let face = t.faces[f as usize];
                if ends.iter().all(|e| face.contains(e)) {
                    return true;
                }
                let [a, b, c] = face.map(|v| work.positions[v as usize]);
                let [d, e, g] = face.map(moved);
                let (before, after) = (area_normal(&a, &b, &c), area_normal(&d, &e, &g));
                let longest_side = (e - d).norm().max((g - e).norm()).max((d - g).norm());
                before.dot(&after) > 0.5 * before.norm() * after.norm()
                    && after.norm() > 0.1 * longest_side * longest_side
            })
    })
}

/// Apply collapses and renumber what is left, in order.
fn merge(work: &mut WorkingMesh, gone: &[u32]) {
    let mut name = vec![0u32; gone.len()];
    let mut next = 0;
    for v in 0..gone.len() {
        if gone[v] == u32::MAX {
            name[v] = next;
            work.positions[next as usize] = work.positions[v];
            work.fixed[next as usize] = work.fixed[v];
            work.size[next as usize] = work.size[v];
            next += 1;
        }
    }
    work.positions.truncate(next as usize);
    work.fixed.truncate(next as usize);
    work.size.truncate(next as usize);
    let target = |v: u32| if gone[v as usize] == u32::MAX { v } else { gone[v as usize] };
    work.faces = work
        .faces
        .iter()
        .map(|face| face.map(|v| name[target(v) as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
}

/// Flip edges towards six neighbours a vertex (four on the boundary).
pub(super) fn flip(work: &mut WorkingMesh) {
    for _ in 0..6 {
        let topology = work.topology();
        let mut touched = vec![false; topology.vertex_count];
        let mut any = false;
        for (edge, &[f, g]) in topology.edge_faces.iter().enumerate() {
            let Some(quad) = topology.quad(edge) else { continue };
            if quad.iter().any(|&v| touched[v as usize]) || !improves(work, &topology, quad) {
                continue;
            }
            let [a, b, c, d] = quad;
            work.faces[f as usize] = [c, d, b];
            work.faces[g as usize] = [d, c, a];
            quad.iter().for_each(|&v| touched[v as usize] = true);
            any = true;
        }
        if !any {
            return;
        }
    }
}

fn improves(work: &WorkingMesh, t: &Topology, [a, b, c, d]: [u32; 4]) -> bool {
    if t.edge_index(c, d).is_some() {
        return false;
    }
    let excess = |v: u32, change: i64| {
        let ideal = if t.boundary[v as usize] { 4 } else { 6 };
        (t.one_ring[v as usize].len() as i64 + change - ideal).pow(2)
    };
    let before = excess(a, 0) + excess(b, 0) + excess(c, 0) + excess(d, 0);
    let after = excess(a, -1) + excess(b, -1) + excess(c, 1) + excess(d, 1);
    if after >= before {
        return false;
    }
    let at = |v: u32| &work.positions[v as usize];
    let old = area_normal(at(a), at(b), at(c)) + area_normal(at(b), at(a), at(d));
    // The new faces must look the old way, must not be needles, and must not fold a crease.
    [[c, d, b], [d, c, a]].iter().all(|&[i, j, k]| {
        let n = area_normal(at(i), at(j), at(k));
        let side = (at(j) - at(i)).norm().max((at(k) - at(j)).norm()).max((at(i) - at(k)).norm());
        n.dot(&old) > 0.7 * n.norm() * old.norm() && n.norm() > 0.2 * side * side
    })
}

/// Move every vertex towards the centre of its neighbours within the tangent plane, then onto the
/// input surface; boundary vertices along the boundary, corners not at all.
pub(super) fn smooth(work: &mut WorkingMesh, surface: &ClosestPoints, outline: &FixedEdges) {
    let topology = work.topology();
    for _ in 0..3 {
        let normals = vertex_normals(&topology, &work.positions);
        let moved: Vec<Point3> = (0..topology.vertex_count)
            .map(|v| {
                let p = work.positions[v];
                if work.fixed[v] || topology.one_ring[v].is_empty() {
                    return p;
                }
                if topology.boundary[v] {
                    return outline.closest(&(p + 0.5 * along_boundary(work, &topology, v)));
                }
                let towards = to_centre(work, &topology, v);
                let target = p + 0.7 * (towards - normals[v] * normals[v].dot(&towards));
                surface.closest(&target).map_or(p, |found| found.point)
            })
            .collect();
        work.positions = moved;
    }
}

/// To the mean of the neighbouring faces' centres, weighted by their areas and by the density under
/// which a centroidal Voronoi tessellation has cells of the size wanted, its power −4 (Du, Faber
/// and Gunzburger 1999).
fn to_centre(work: &WorkingMesh, t: &Topology, v: usize) -> Vector3 {
    let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
    for &f in &t.vertex_faces[v] {
        let [a, b, c] = t.faces[f as usize].map(|i| work.positions[i as usize]);
        let size = t.faces[f as usize].iter().map(|&i| work.size[i as usize]).sum::<f64>() / 3.0;
        let area = area_normal(&a, &b, &c).norm() / size.powi(4);
        sum += ((a.coords + b.coords + c.coords) / 3.0 - work.positions[v].coords) * area;
        weight += area;
    }
    if weight > 0.0 { sum / weight } else { Vector3::zeros() }
}

/// To the middle of the two boundary neighbours.
fn along_boundary(work: &WorkingMesh, t: &Topology, v: usize) -> Vector3 {
    let neighbours: Vec<Vector3> = t.one_ring[v]
        .iter()
        .filter(|&&w| t.edge_index(v as u32, w).is_some_and(|e| t.edge_faces[e][1] == u32::MAX))
        .map(|&w| work.positions[w as usize] - work.positions[v])
        .collect();
    if neighbours.len() == 2 { (neighbours[0] + neighbours[1]) / 2.0 } else { Vector3::zeros() }
}
