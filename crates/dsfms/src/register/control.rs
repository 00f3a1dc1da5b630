//! The control mesh: about a thousand unknown points, and the user's mesh that follows them.
//!
//! What one frame tells of a surface does not grow with its vertices, so eqs. 3 and 4 and the joint
//! problem are solved on a decimated mesh. The full mesh follows by fixed weights (every vertex by
//! the displacement of a face and its gradient, `Decimated::prolong`), and what it has beyond the
//! control mesh, its finer relief, is carried along ([`Lift`](crate::energy::Lift)).

use super::correspondence::Match;
use super::fineness::fineness;
use super::pose::rest_point;
use super::scene::visibility;
use super::{Scene, Volume};
use crate::camera::Camera;
use crate::geometry::Point3;
use crate::mesh::Mesh;
use crate::mesh::decimate::{Decimated, decimate, decimate_finer};
use crate::mesh::laplacian::Laplacian;
use std::borrow::Cow;

/// Meshes of more vertices are carried by a control mesh: below, it would be hardly coarser.
pub const CONTROL_ABOVE: usize = 1500;

/// Vertices of a control mesh: on `rendered_scene` the deformed zone is 0.69 mm off, 0.60 mm solved
/// on all 7,200 vertices, in a ninth of the time (`docs/results/scenes.md`).
const CONTROL: usize = 1000;

/// Vertices of a control mesh that is finer where the shape bends, at most: a bound on time. This
/// and the two below are not measured.
const MOST_CONTROL: f64 = 3000.0;

/// A finer control mesh has this many times the vertices at least: it is not worth making for less.
const FINER: f64 = 1.05;

/// And at most this part of those of the full mesh, which cannot be made much coarser evenly.
const COARSER: f64 = 0.9;

/// A control mesh and where the vertices of the full mesh lie on it.
#[derive(Clone, Debug)]
pub struct Control {
    decimated: Decimated,
    /// Face and barycentrics of every vertex of the full mesh; the latter may be a little negative.
    places: Vec<(u32, [f64; 3])>,
    /// Control vertex of every vertex of the full mesh that is one.
    numbers: Vec<Option<u32>>,
    /// Cotangent Laplacian of the control mesh at rest.
    laplacian: Laplacian,
}

impl Control {
    /// The control mesh of a rest shape; `None` for one that is coarse already or cannot be made
    /// coarser.
    pub fn of(mesh: &Mesh) -> Option<Self> {
        if mesh.positions.len() <= CONTROL_ABOVE {
            return None;
        }
        Self::on(mesh, decimate(mesh, CONTROL)?)
    }

    fn on(mesh: &Mesh, decimated: Decimated) -> Option<Self> {
        let at = |(v, p): (usize, &Point3)| decimated.locate(p, v as u32);
        let places = mesh.positions.iter().enumerate().map(at).collect::<Option<_>>()?;
        let mut numbers = vec![None; mesh.positions.len()];
        for (k, &v) in decimated.kept.iter().enumerate() {
            numbers[v as usize] = Some(k as u32);
        }
        let laplacian = Laplacian::new(&decimated.mesh);
        Some(Self { decimated, places, numbers, laplacian })
    }

    /// The control mesh of a rest shape, its edges shorter than here by the factors `fineness` of
    /// its vertices; `None` where that is hardly finer, nearly as fine as the rest shape, or cannot
    /// be made.
    fn finer(&self, full: &Scene, fineness: &[f64]) -> Option<Self> {
        let faces = &self.decimated.mesh.topology.faces;
        let at = |&(face, b): &(u32, [f64; 3])| -> f64 {
            let corners = faces[face as usize].map(|v| fineness[v as usize]);
            corners.iter().zip(b).map(|(f, b)| f * b.max(0.0)).sum::<f64>().max(1.0)
        };
        let fineness: Vec<f64> = self.places.iter().map(at).collect();
        let area = full.laplacian.mass.iter().zip(&fineness);
        let share =
            area.map(|(m, f)| m * f * f).sum::<f64>() / full.laplacian.mass.iter().sum::<f64>();
        let count = (share * self.decimated.kept.len() as f64).min(MOST_CONTROL);
        if share < FINER || count > COARSER * fineness.len() as f64 {
            return None;
        }
        Self::on(full.rest, decimate_finer(full.rest, count as usize, &fineness)?)
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
            (control, full.on_some(mesh, kept, Cow::Borrowed(&control.laplacian)))
        };
        let Deformable { control, volume } = deformable;
        Self { full, control: control.as_ref().map(on), volume: volume.as_ref(), anchor }
    }

    /// What deforms, with a control mesh that is finer where `shape` (of the mesh that is solved
    /// on) bends; `None` where it bends little or nothing carries the full mesh.
    pub(crate) fn finer(&self, shape: &[Point3]) -> Option<Deformable> {
        let (control, scene) = self.control.as_ref()?;
        let control = control.finer(self.full, &fineness(scene, &scene.displacement(shape)))?;
        let volume = self.volume.and_then(|volume| volume.behind(control.mesh()));
        Some(Deformable { control: Some(control), volume })
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
        let displacement = scene.displacement(shape);
        let place = |v: usize| Some(control.places[v]);
        let moved = control.decimated.prolong_by(self.full.rest, &displacement, place);
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
    pub(crate) fn restricted<'s, T: Copy>(&self, full: &'s [T]) -> Cow<'s, [T]> {
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
    pub(crate) fn is_carried(&self) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::geometry::Vector3;
    use crate::mesh::shapes;

    /// A ball of 10,242 vertices before a camera, and its shape with a narrow pull towards it.
    fn ball() -> (CameraModel, Mesh, Vec<Point3>, Vec<Point3>) {
        let rest = shapes::icosphere(5, 20.0);
        let posed: Vec<Point3> = rest.positions.iter().map(|p| p + Vector3::z() * 80.0).collect();
        let top = Point3::new(0.0, 0.0, 60.0);
        let pull = |p: &Point3| p - Vector3::z() * 8.0 * (-(p - top).norm_squared() / 36.0).exp();
        let pulled = posed.iter().map(pull).collect();
        (CameraModel::pinhole([640, 480], [600.0; 2], [319.5, 239.5]), rest, posed, pulled)
    }

    #[test]
    fn the_control_mesh_is_finer_at_a_pull_and_carries_it_better() {
        let (camera, rest, posed, pulled) = ball();
        let full = Scene::new(&camera, &rest, posed.clone());
        let even = Deformable::of(&rest);
        let body = Body::new(&full, &even, 0.0);
        assert!(body.finer(&body.restricted(&posed)).is_none(), "finer at rest");
        let finer = body.finer(&body.restricted(&pulled)).unwrap();
        let fine = Body::new(&full, &finer, 0.0);
        let times = |at: &dyn Fn(f64) -> bool| {
            let count = |body: &Body| body.scene().posed.iter().filter(|p| at(p.z)).count() as f64;
            count(&fine) / count(&body)
        };
        let (near, behind) = (times(&|z| z < 64.0), times(&|z| z > 80.0));
        assert!(near > 2.5 && (behind - 1.0).abs() < 0.3, "{near} and {behind} times the vertices");
        let off = |body: &Body| {
            let carried = body.carried(&body.restricted(&pulled)).into_owned();
            carried.iter().zip(&pulled).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
        };
        assert!(off(&fine) < 0.5 * off(&body), "{} and {}", off(&fine), off(&body));
        // What lies behind is carried along as before.
        let hidden = |body: &Body| {
            let shape = body.extrapolated(&body.restricted(&pulled)).unwrap();
            let all = body.carried(&shape);
            all.iter().zip(&posed).map(|(a, b)| (a - b).norm()).sum::<f64>() / all.len() as f64
        };
        let hidden = hidden(&fine) / hidden(&body);
        assert!((hidden - 1.0).abs() < 0.2, "{hidden} times the motion");
    }
}
