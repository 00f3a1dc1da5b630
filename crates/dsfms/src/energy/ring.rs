//! The area-weighted normal of a vertex as a function of its one-ring.

use crate::geometry::{Point3, Vector3, area_normal};
use crate::mesh::Topology;

/// A vertex, its neighbours, and the faces between them in local indices.
#[derive(Clone, Debug)]
pub struct OneRing {
    /// The vertex first, then its neighbours.
    pub stencil: Vec<u32>,
    faces: Vec<[u32; 3]>,
}

/// A unit normal and what its derivatives need.
#[derive(Clone, Copy, Debug)]
pub struct RingNormal {
    /// Outward unit normal.
    pub unit: Vector3,
    length: f64,
}

impl OneRing {
    /// The ring of a vertex; `None` where it has no face.
    pub fn of(topology: &Topology, vertex: u32) -> Option<Self> {
        let around = &topology.vertex_faces[vertex as usize];
        if around.is_empty() {
            return None;
        }
        let mut stencil = vec![vertex];
        stencil.extend(&topology.one_ring[vertex as usize]);
        let local = |v: u32| stencil.iter().position(|&s| s == v).unwrap_or(0) as u32;
        let faces = around.iter().map(|&f| topology.faces[f as usize].map(local)).collect();
        Some(Self { stencil, faces })
    }

    /// The normal at the gathered stencil; `None` where the ring has no area.
    pub fn normal(&self, v: &[Point3]) -> Option<RingNormal> {
        let sum: Vector3 = self
            .faces
            .iter()
            .map(|&[a, b, c]| area_normal(&v[a as usize], &v[b as usize], &v[c as usize]))
            .sum();
        let length = sum.norm();
        (length > 1e-300).then(|| RingNormal { unit: sum / length, length })
    }

    /// Add to `gradients` the gradient with respect to the stencil of a function of the normal
    /// whose derivative with respect to it is `d_normal`.
    pub(crate) fn pull_back(
        &self,
        v: &[Point3],
        normal: &RingNormal,
        d_normal: &Vector3,
        mut add: impl FnMut(usize, Vector3),
    ) {
        let n = &normal.unit;
        let u = (d_normal - n * n.dot(d_normal)) / normal.length;
        for face in &self.faces {
            let [a, b, c] = face.map(|k| &v[k as usize]);
            add(face[0] as usize, u.cross(&(c - b)));
            add(face[1] as usize, u.cross(&(a - c)));
            add(face[2] as usize, u.cross(&(b - a)));
        }
    }
}
