//! Faults of surfaces made elsewhere, mended where there is one way to do it: repeated vertices and
//! faces, faces without area, faces that run against their neighbours.

use super::is_flat;
use crate::geometry::Point3;
use crate::geometry::area;
use std::collections::BTreeMap;

/// A surface that was mended, and what was done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repaired {
    /// Vertices, in their old order without those that were merged into an earlier one.
    pub positions: Vec<Point3>,
    /// Faces, in their old order without those that were removed.
    pub faces: Vec<[u32; 3]>,
    /// Old index of every vertex.
    pub vertex_of: Vec<u32>,
    /// Old index of every face, and whether its last two corners changed places.
    pub face_of: Vec<(u32, bool)>,
    /// One sentence for every kind of fault that was found.
    pub report: Vec<String>,
}

/// Merge vertices at the same place (bit for bit), remove faces without area, faces with the
/// corners of an earlier one, and at edges that more than two share all but the largest face and
/// the largest that goes on from it (of parts that touch, such as those of an anatomical atlas,
/// each goes on where it ran before); turn faces until all neighbours of a piece run the same way:
/// that of most of its faces. A surface of one side (Möbius' band) stays as it is, and
/// [`super::Topology::new`] refuses it. Corners beyond the vertices are left out with their face.
pub fn repair(positions: &[Point3], faces: &[[u32; 3]]) -> Repaired {
    let mut out = Repaired::default();
    let merged = out.merge(positions);
    let within = |face: &&[u32; 3]| face.iter().all(|&v| (v as usize) < merged.len());
    let kept = (0u32..).zip(faces).filter(|(_, face)| within(face));
    for (index, face) in kept {
        out.faces.push(face.map(|v| merged[v as usize]));
        out.face_of.push((index, false));
    }
    let beyond = faces.len() - out.faces.len();
    out.tell(beyond, "name vertices that do not exist, and were removed");
    out.remove_flat();
    out.remove_repeated();
    // What the parts between such edges are, each for itself, says which faces go on there.
    out.orient();
    out.remove_fins();
    out.orient();
    let turned = out.face_of.iter().filter(|f| f.1).count();
    out.tell(turned, "ran against their neighbours, and were turned");
    out
}

impl Repaired {
    fn tell(&mut self, count: usize, what: &str) {
        if count > 0 {
            self.report.push(format!("{count} faces {what}"));
        }
    }

    /// The new vertex of every old one.
    fn merge(&mut self, positions: &[Point3]) -> Vec<u32> {
        let mut known = BTreeMap::new();
        let merged = (0u32..)
            .zip(positions)
            .map(|(index, p)| {
                // −0 and 0 are one place.
                let key = [p.x, p.y, p.z].map(|x| (x + 0.0).to_bits());
                *known.entry(key).or_insert_with(|| {
                    self.positions.push(*p);
                    self.vertex_of.push(index);
                    self.positions.len() as u32 - 1
                })
            })
            .collect();
        let gone = positions.len() - self.positions.len();
        if gone > 0 {
            self.report.push(format!(
                "{gone} vertices stood where another one is, and were merged with it"
            ));
        }
        merged
    }

    /// Keep the faces that are asked for; returns how many went.
    fn retain(&mut self, keep: &[bool]) -> usize {
        let mut flags = keep.iter();
        self.faces.retain(|_| flags.next() == Some(&true));
        let mut flags = keep.iter();
        self.face_of.retain(|_| flags.next() == Some(&true));
        keep.iter().filter(|kept| !**kept).count()
    }

    fn corners(&self, face: usize) -> [&Point3; 3] {
        self.faces[face].map(|v| &self.positions[v as usize])
    }

    fn remove_flat(&mut self) {
        let solid = |f| {
            let [a, b, c] = self.faces[f];
            a != b && b != c && c != a && !is_flat(self.corners(f))
        };
        let keep: Vec<bool> = (0..self.faces.len()).map(solid).collect();
        let gone = self.retain(&keep);
        self.tell(gone, "without area were removed");
    }

    fn remove_repeated(&mut self) {
        let mut known = std::collections::BTreeSet::new();
        let mut first = |face: &[u32; 3]| {
            let mut corners = *face;
            corners.sort_unstable();
            known.insert(corners)
        };
        let keep: Vec<bool> = self.faces.iter().map(&mut first).collect();
        let gone = self.retain(&keep);
        self.tell(gone, "had the three corners of another one, and were removed");
    }

    /// Faces of every edge, edges in order.
    fn edges(&self) -> BTreeMap<[u32; 2], Vec<usize>> {
        let mut edges: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
        for (f, &[a, b, c]) in self.faces.iter().enumerate() {
            for [a, b] in [[a, b], [b, c], [c, a]] {
                edges.entry([a.min(b), a.max(b)]).or_default().push(f);
            }
        }
        edges
    }

    /// Of more than two faces at an edge, two stay: the largest, and the largest of those that run
    /// against it there, as neighbours do, or of all where none does.
    fn remove_fins(&mut self) {
        let mut keep = vec![true; self.faces.len()];
        for (edge, users) in self.edges().into_iter().filter(|e| e.1.len() > 2) {
            let size = |f: usize| {
                let [a, b, c] = self.corners(f);
                area(a, b, c)
            };
            let mut users: Vec<usize> = users.into_iter().filter(|&f| keep[f]).collect();
            users.sort_by(|&f, &g| size(g).total_cmp(&size(f)).then(f.cmp(&g)));
            let Some((first, others)) = users.split_first() else { continue };
            let goes_on =
                |g: &&usize| runs(self.faces[**g], edge) != runs(self.faces[*first], edge);
            let second = others.iter().find(goes_on).or(others.first());
            others.iter().filter(|g| Some(*g) != second).for_each(|&g| keep[g] = false);
        }
        let gone = self.retain(&keep);
        self.tell(gone, "at edges that more than two share were removed");
    }

    /// Turn the faces of every piece as most of them are.
    fn orient(&mut self) {
        let edges = self.edges();
        // Neighbours, and whether one of the two has to be turned.
        let mut beside: Vec<Vec<(usize, bool)>> = vec![Vec::new(); self.faces.len()];
        for (edge, users) in &edges {
            if let &[f, g] = users.as_slice() {
                let against = runs(self.faces[f], *edge) == runs(self.faces[g], *edge);
                beside[f].push((g, against));
                beside[g].push((f, against));
            }
        }
        let mut turned: Vec<Option<bool>> = vec![None; self.faces.len()];
        for start in 0..self.faces.len() {
            if turned[start].is_some() {
                continue;
            }
            let mut piece = vec![(start, false)];
            turned[start] = Some(false);
            let mut next = 0;
            while let Some(&(f, own)) = piece.get(next) {
                next += 1;
                for &(g, against) in beside[f].iter() {
                    if turned[g].is_none() {
                        turned[g] = Some(own != against);
                        piece.push((g, own != against));
                    }
                }
            }
            let flips = piece.iter().filter(|(_, flip)| *flip).count();
            let others = 2 * flips > piece.len();
            for (f, _) in piece.into_iter().filter(|(_, flip)| *flip != others) {
                let [a, b, c] = self.faces[f];
                self.faces[f] = [a, c, b];
                self.face_of[f].1 ^= true;
            }
        }
    }
}

/// Whether a face runs along an edge from its first end to its second.
fn runs(face: [u32; 3], [a, b]: [u32; 2]) -> bool {
    (0..3).any(|k| face[k] == a && face[(k + 1) % 3] == b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Topology, shapes};

    #[test]
    fn a_whole_surface_stays_as_it_is() {
        let sphere = shapes::icosphere(2, 3.0);
        let found = repair(&sphere.positions, &sphere.topology.faces);
        assert_eq!(
            (found.positions, found.faces),
            (sphere.positions.clone(), sphere.topology.faces.clone())
        );
        assert!(found.report.is_empty());
    }

    /// Three faces at an edge, as where parts of an atlas touch: to the largest belongs the one
    /// that goes on from it, not the larger one that runs along the edge in the same direction.
    #[test]
    fn at_an_edge_of_three_the_neighbour_stays() {
        let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let positions =
            [at(0., 0., 0.), at(1., 0., 0.), at(0.5, 3., 0.), at(0.5, 0., 2.), at(0.5, -1., 0.)];
        let faces = [[0, 1, 2], [0, 1, 3], [1, 0, 4]];
        let found = repair(&positions, &faces);
        assert_eq!(found.faces, [[0, 1, 2], [1, 0, 4]]);
        assert_eq!(found.face_of, [(0, false), (2, false)]);
        // Where none goes on, the two largest stay, and one is turned.
        let found = repair(&positions, &[[0, 1, 2], [0, 1, 3], [0, 1, 4]]);
        assert_eq!(found.face_of.iter().map(|f| f.0).collect::<Vec<_>>(), [0, 1]);
        assert!(Topology::new(5, found.faces).is_ok());
    }

    #[test]
    fn every_fault_is_mended_and_told() {
        let sphere = shapes::icosphere(1, 3.0);
        let (mut positions, mut faces) = (sphere.positions.clone(), sphere.topology.faces.clone());
        // Vertex 0 of the first face torn off; a face turned; one repeated; one without area; a
        // fin.
        let n = positions.len() as u32;
        positions.push(positions[faces[0][0] as usize]);
        faces[0][0] = n;
        faces[7].swap(0, 2);
        let again = faces[9];
        faces.push([again[1], again[0], again[2]]);
        faces.push([again[0], again[1], again[1]]);
        let middle = positions[again[0] as usize]
            + (positions[again[1] as usize] - positions[again[0] as usize]) * 0.5;
        positions.push(middle + middle.coords * 0.01);
        faces.push([again[0], again[1], n + 1]);
        assert!(Topology::new(positions.len(), faces.clone()).is_err());
        let found = repair(&positions, &faces);
        let topology = Topology::new(found.positions.len(), found.faces.clone()).unwrap();
        assert_eq!(topology.faces.len(), sphere.topology.faces.len());
        assert!(topology.edge_faces.iter().all(|f| f[1] != u32::MAX), "closed again");
        assert_eq!(found.face_of[7], (7, true));
        let told = found.report.join("; ");
        for word in ["1 vertices stood", "without area", "three corners", "more than two", "turned"]
        {
            assert!(told.contains(word), "{word}: {told}");
        }
        assert!(told.contains("1 faces ran against"), "{told}");
    }
}
