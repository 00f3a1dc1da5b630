//! Small surfaces for tests.

use super::Mesh;
use crate::geometry::{Point3, Vector3};
use std::collections::BTreeMap;

pub(crate) fn mesh(positions: Vec<Point3>, faces: Vec<[u32; 3]>) -> Mesh {
    Mesh::new(positions, faces).unwrap()
}

/// A flat `n × n` sheet on `[0, 1]²`, normals +z, whose inner vertices are shaken.
pub(crate) fn irregular_sheet(n: usize) -> Mesh {
    let noise = |k: usize| ((k * 7919 + 13) % 101) as f64 / 101.0 - 0.5;
    let mut positions = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let inner = i > 0 && j > 0 && i + 1 < n && j + 1 < n;
            let shake = if inner { 0.3 } else { 0.0 };
            let (x, y) = (i as f64 + shake * noise(j * n + i), j as f64 + shake * noise(3 * i + j));
            positions.push(Point3::new(x / (n - 1) as f64, y / (n - 1) as f64, 0.0));
        }
    }
    mesh(positions, grid_faces(n, n, false))
}

/// Faces of a grid of `columns × rows` vertices; `wrapped` joins the last column to the first.
pub(crate) fn grid_faces(columns: usize, rows: usize, wrapped: bool) -> Vec<[u32; 3]> {
    let id = |i: usize, j: usize| (j * columns + i % columns) as u32;
    let mut faces = Vec::new();
    for j in 0..rows - 1 {
        for i in 0..columns - usize::from(!wrapped) {
            faces.push([id(i, j), id(i + 1, j), id(i + 1, j + 1)]);
            faces.push([id(i, j), id(i + 1, j + 1), id(i, j + 1)]);
        }
    }
    faces
}

/// An icosahedron subdivided `levels` times, normals outward, about the origin.
pub(crate) fn icosphere(levels: usize, radius: f64) -> Mesh {
    let t = 0.5 * (1.0 + 5f64.sqrt());
    let corners = [
        [-1., t, 0.],
        [1., t, 0.],
        [-1., -t, 0.],
        [1., -t, 0.],
        [0., -1., t],
        [0., 1., t],
        [0., -1., -t],
        [0., 1., -t],
        [t, 0., -1.],
        [t, 0., 1.],
        [-t, 0., -1.],
        [-t, 0., 1.],
    ];
    let mut points: Vec<Vector3> = corners.iter().map(|&c| Vector3::from(c).normalize()).collect();
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middles = BTreeMap::new();
        let mut next = Vec::new();
        for [a, b, c] in faces {
            let mut middle = |i: u32, j: u32| {
                *middles.entry([i.min(j), i.max(j)]).or_insert_with(|| {
                    points.push((points[i as usize] + points[j as usize]).normalize());
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            next.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = next;
    }
    mesh(points.iter().map(|p| Point3::from(p * radius)).collect(), faces)
}

/// The upper half of [`icosphere`] (faces whose centre has z > 0), unused vertices removed.
pub(crate) fn hemisphere(levels: usize, radius: f64) -> Mesh {
    let sphere = icosphere(levels, radius);
    let keep: Vec<[u32; 3]> = (0..sphere.topology.faces.len())
        .filter(|&f| sphere.corners(f).iter().map(|p| p.z).sum::<f64>() > 0.0)
        .map(|f| sphere.topology.faces[f])
        .collect();
    let mut names = BTreeMap::new();
    let mut positions = Vec::new();
    let faces = keep
        .iter()
        .map(|face| {
            face.map(|v| {
                *names.entry(v).or_insert_with(|| {
                    positions.push(sphere.positions[v as usize]);
                    positions.len() as u32 - 1
                })
            })
        })
        .collect();
    mesh(positions, faces)
}

/// An open cylinder of radius 1 and the given height: two boundary loops, normals outward.
pub(crate) fn tube(columns: usize, rows: usize, height: f64) -> Mesh {
    let mut positions = Vec::new();
    for j in 0..rows {
        for i in 0..columns {
            let angle = std::f64::consts::TAU * i as f64 / columns as f64;
            let z = height * j as f64 / (rows - 1) as f64;
            positions.push(Point3::new(angle.cos(), angle.sin(), z));
        }
    }
    mesh(positions, grid_faces(columns, rows, true))
}

/// A torus of radii 3 and 1, normals outward.
pub(crate) fn torus(columns: usize, rows: usize) -> Mesh {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    let id = |i: usize, j: usize| ((j % rows) * columns + i % columns) as u32;
    for j in 0..rows {
        for i in 0..columns {
            let a = std::f64::consts::TAU * i as f64 / columns as f64;
            let b = std::f64::consts::TAU * j as f64 / rows as f64;
            let r = 3.0 + b.cos();
            positions.push(Point3::new(r * a.cos(), r * a.sin(), b.sin()));
            faces.push([id(i, j), id(i + 1, j), id(i + 1, j + 1)]);
            faces.push([id(i, j), id(i + 1, j + 1), id(i, j + 1)]);
        }
    }
    mesh(positions, faces)
}
