//! The control mesh: about a thousand unknown points, and the user's mesh that follows them.
//!
//! What one frame tells of a surface does not grow with its vertices, so eqs. 3 and 4 and the joint
//! problem are solved on a decimated mesh. The full mesh follows by fixed weights (every vertex by
//! the displacement of a face and its gradient, [`Decimated::prolong`]), and what it has beyond the
//! control mesh, its finer relief, is carried along ([`Lift`](crate::energy::Lift)).

use super::pose::rest_point;
use super::scene::visibility;
use super::{Match, Scene, Volume};
use crate::camera::Camera;
use crate::geometry::{Point3, Vector3};
use crate::mesh::Mesh;
use crate::mesh::decimate::{Decimated, decimate};
use std::borrow::Cow;

/// Meshes of more vertices are carried by a control mesh: below, it would be hardly coarser.
pub const CONTROL_ABOVE: usize = 1500;

/// Vertices of a control mesh: on `rendered_scene` the deformed zone is 0.69 mm off, 0.60 mm solved
/// on all 7,200 vertices, in a ninth of the time (`docs/results/scenes.md`).
const CONTROL: usize = 1000;

/// A control mesh and where the vertices of the full mesh lie on it.
#[derive(Clone, Debug)]
pub struct Control {
    decimated: Decimated,
    /// Face and barycentrics of every vertex of the full mesh; the latter may be a little negative.
    places: Vec<(u32, [f64; 3])>,
    /// Control vertex of every vertex of the full mesh that is one.
    numbers: Vec<Option<u32>>,
}

impl Control {
    /// The control mesh of a rest shape; `None` for one that is coarse already or cannot be made
    /// coarser.
    pub fn of(mesh: &Mesh) -> Option<Self> {
        if mesh.positions.len() <= CONTROL_ABOVE {
            return None;
        }
        let decimated = decimate(mesh, CONTROL)?;
        let at = |(v, p): (usize, &Point3)| decimated.locate(p, v as u32);
        let places = mesh.positions.iter().enumerate().map(at).collect::<Option<_>>()?;
        let mut numbers = vec![None; mesh.positions.len()];
        for (k, &v) in decimated.kept.iter().enumerate() {
            numbers[v as usize] = Some(k as u32);
        }
        Some(Self { decimated, places, numbers })
    }

    /// The control mesh at rest.
    pub fn mesh(&self) -> &Mesh {
        &self.decimated.mesh
    }
}

/// What deforms in one frame: the full mesh as the user has it, and the control mesh that carries
/// it.
pub struct Body<'a> {
    full: &'a Scene<'a>,
    control: Option<(&'a Control, Scene<'a>)>,
    volume: Option<&'a Volume>,
    /// How firmly the hidden side hangs on its surroundings.
    anchor: f64,
}

/// What deforms of a template, made once and used for every frame.
#[doc(alias("embedded deformation", "control mesh"))]
#[derive(Clone, Debug)]
pub struct Deformable {
    control: Option<Control>,
    volume: Option<Volume>,
}

impl Deformable {
    /// Of a rest shape.
    pub fn of(rest: &Mesh) -> Self {
        let control = Control::of(rest);
        let volume = Volume::of(control.as_ref().map_or(rest, Control::mesh));
        Self { control, volume }
    }
}

impl<'a> Body<'a> {
    /// The full mesh and nothing else: it is solved on itself.
    pub fn plain(full: &'a Scene<'a>) -> Self {
        Self { full, control: None, volume: None, anchor: 0.0 }
    }

    /// The full mesh of the rest shape that `deformable` was made of; `anchor`: how firmly its
    /// hidden side hangs on its surroundings ([`Volume::extrapolated`]).
    pub fn new(full: &'a Scene<'a>, deformable: &'a Deformable, anchor: f64) -> Self {
        let on = |control: &'a Control| {
            let Decimated { mesh, kept, .. } = &control.decimated;
            (control, full.on_some(mesh, kept))
        };
        let Deformable { control, volume } = deformable;
        Self { full, control: control.as_ref().map(on), volume: volume.as_ref(), anchor }
    }

    /// The scene of the full mesh.
    pub fn full(&self) -> &Scene<'a> {
        self.full
    }

    /// The scene that is solved on.
    pub fn scene(&self) -> &Scene<'a> {
        self.control.as_ref().map_or(self.full, |(_, scene)| scene)
    }

    /// Matches on the mesh that is solved on. What the full mesh has beyond it moves a match in the
    /// image; its pixel is moved back by as much, at the posed rest shape.
    pub fn matches<'m>(&self, matches: &'m [Match]) -> Cow<'m, [Match]> {
        let Some((control, scene)) = &self.control else { return Cow::Borrowed(matches) };
        let carried = |m: &Match| {
            let (point, near) = (rest_point(self.full.rest, m), self.full.face(m)[0]);
            // A match on a face that has vanished lies where its first corner went.
            let found = control.decimated.locate(&point, near);
            let (face, barycentric) = found.unwrap_or(control.places[near as usize]);
            let there = Match { face, barycentric, pixel: m.pixel };
            let pixel = |p: Point3| Some(self.full.camera.project(&p)?.pixel);
            let full = pixel(self.full.point(m, &self.full.posed));
            let lift = full.zip(pixel(scene.point(&there, &scene.posed)));
            Match { pixel: m.pixel - lift.map_or_else(Default::default, |(a, b)| a - b), ..there }
        };
        Cow::Owned(matches.iter().map(carried).collect())
    }

    /// The full mesh where the mesh that is solved on is at `shape` (camera axes).
    pub fn carried<'s>(&self, shape: &'s [Point3]) -> Cow<'s, [Point3]> {
        let Some((control, scene)) = &self.control else { return Cow::Borrowed(shape) };
        let displacement: Vec<Vector3> =
            shape.iter().zip(&scene.posed).map(|(now, posed)| now - posed).collect();
        let moved = control.decimated.prolong(self.full.rest, &displacement);
        Cow::Owned(self.full.posed.iter().zip(moved).map(|(p, d)| p + d).collect())
    }

    /// `shape` of the mesh that is solved on, its hidden side carried along by what is seen
    /// ([`Volume::extrapolated`]); as it is where it has no inside.
    pub fn settled(&self, shape: Vec<Point3>) -> Vec<Point3> {
        self.extrapolated(&shape).unwrap_or(shape)
    }

    /// The same; `None` of a surface that has no inside, or that is seen as a whole or not at all.
    pub fn extrapolated(&self, shape: &[Point3]) -> Option<Vec<Point3>> {
        let scene = self.scene();
        let seen = visibility(scene.camera, scene.rest, shape);
        self.volume?.extrapolated(&scene.posed, shape, &seen, self.anchor)
    }

    /// Of values at the vertices of the full mesh those of the mesh that is solved on.
    pub fn restricted<'s, T: Copy>(&self, full: &'s [T]) -> Cow<'s, [T]> {
        let Some((control, _)) = &self.control else { return Cow::Borrowed(full) };
        Cow::Owned(control.decimated.kept.iter().map(|&v| full[v as usize]).collect())
    }

    /// The number, on the mesh that is solved on, of a vertex of the full mesh; `None` where it has
    /// none.
    pub fn number(&self, vertex: u32) -> Option<u32> {
        let Some((control, _)) = &self.control else { return Some(vertex) };
        control.numbers[vertex as usize]
    }

    /// Whether a control mesh carries the full one.
    pub fn is_carried(&self) -> bool {
        self.control.is_some()
    }

    /// Face and barycentrics, on the mesh that is solved on, of a vertex of the full mesh; `None`
    /// of one without a face.
    pub fn place(&self, vertex: usize) -> Option<(u32, [f64; 3])> {
        if let Some((control, _)) = &self.control {
            return Some(control.places[vertex]);
        }
        let topology = &self.full.rest.topology;
        let face = *topology.vertex_faces[vertex].first()?;
        let corner = |v: u32| if v as usize == vertex { 1.0 } else { 0.0 };
        Some((face, topology.faces[face as usize].map(corner)))
    }

    /// The point of a shape of the mesh that is solved on, at a [`place`](Self::place).
    pub fn point(&self, (face, barycentric): (u32, [f64; 3]), shape: &[Point3]) -> Point3 {
        self.scene().rest.topology.point(face, barycentric, shape)
    }
}
