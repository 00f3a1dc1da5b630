//! A synthetic laparoscopic clip of known truth: a textured organ before a wall, pushed and pulled
//! by attraction points (paper §8.1) that move smoothly, under a hand-held camera with a near
//! light. Instruments pass and touch, the exposure changes, the lens is covered for some frames and
//! one cut changes view and shape at once. Everything is a function of the seed and the frame's
//! number.
//!
//! The organ is drawn on the mesh that carries the truth, so the error of a template's own
//! discretisation is not part of such a clip.

mod instrument;
mod path;
mod photo;
mod script;
mod tissue;

pub use script::{Event, EventKind, Script};

use super::Patch;
use super::deform::{Attraction, ExtensionOf, attraction_field, deform_to};
use super::random::{Random, uniform};
use crate::camera::{CameraModel, Lens};
use crate::geometry::{Isometry, Point3, Vector3};
use crate::image::{Frame, Mask};
use crate::light::{Coat, Coated, LightModel, PointLight, Spot};
use crate::mesh::Mesh;
use crate::mesh::boundary::boundary_loops;
use crate::mesh::normals::vertex_normals;
use crate::raster::{rasterize, visible_vertices};
use instrument::Instrument;
pub use path::RATE;
use path::{CameraPath, smooth};
use photo::{Conditions, Set, photograph};
use serde::{Deserialize, Serialize};
use tissue::{Palette, TissueTexture};

/// Frames of the exploration, which see the organ at rest.
pub const EXPLORATION: usize = 24;

/// What a clip is made of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipOptions {
    /// Frames.
    pub frames: usize,
    /// Width and height, px.
    pub size: [usize; 2],
    /// Seed of everything.
    pub seed: u64,
}

/// One push or pull: who attracts, and how much of the field is applied at its height.
#[derive(Clone, Debug)]
struct Manipulation {
    attraction: Attraction,
    /// Along the surface, mm over the whole manipulation.
    drift: Vector3,
    /// Share of the field at full strength.
    strength: f64,
    /// Vertex nearest to the line of the attraction.
    apex: usize,
}

/// A clip whose frames can be made in any order.
#[derive(Clone, Debug)]
pub struct Clip {
    /// Rest shape in the template frame, mm, outward normals along −z.
    pub rest: Mesh,
    /// Camera of all frames.
    pub camera: CameraModel,
    /// Light of all frames, and the wet tissue it falls on.
    pub light: Coated,
    /// What happens when.
    pub script: Script,
    options: ClipOptions,
    path: CameraPath,
    manipulations: Vec<Manipulation>,
    set: Set,
}

/// What is true of one frame.
#[derive(Clone, Debug)]
pub struct ClipMoment {
    /// `camera_from_template`.
    pub pose: Isometry,
    /// Vertices in camera axes, mm.
    pub vertices: Vec<Point3>,
    /// Distance of every vertex from its place at rest in the template frame, mm.
    pub displacement: Vec<f64>,
    /// Exposure gain.
    pub gain: f64,
    /// The lens is covered.
    pub covered: bool,
    instruments: Vec<Instrument>,
}

/// A picture with what hides the organ in it.
#[derive(Clone, Debug)]
pub struct ClipFrame {
    /// The picture.
    pub frame: Frame,
    /// `true` where an instrument is seen.
    pub instrument: Mask,
    /// Vertices that the camera sees; none where the lens is covered.
    pub visible: Vec<bool>,
}

impl Clip {
    /// The clip of an organ (rest shape about the origin, outward normals along −z, mm).
    pub fn new(organ: &Patch, options: &ClipOptions) -> Self {
        let rest = organ.mesh.clone();
        let seed = options.seed;
        let script = Script::new(options.frames, seed);
        let mut random = Random::new(seed, 0xC11F);
        let places = inner_vertices(&rest);
        let manipulations = script
            .manipulations
            .iter()
            .map(|m| manipulation(&rest, &places, m.pull, &mut random))
            .collect();
        let [w, h] = options.size.map(|s| s as f64);
        let camera = CameraModel {
            size: options.size,
            focal: [0.85 * w; 2],
            centre: [0.5 * (w - 1.0), 0.5 * (h - 1.0)],
            lens: Lens::default(),
        };
        let light = LightModel::from(PointLight {
            positions: vec![Point3::new(1.5, -3.0, 0.0)],
            reference_distance: 75.0,
            spot: Spot::CosinePower { exponent: 3.0 },
        });
        // A film a little thinner than the calibration takes for granted (1.4), and a cavity that
        // throws some light back.
        let light =
            Coated { light, coat: Coat { refractive_index: 1.37, ambient: 0.04, vignetting: 0.0 } };
        let set = set(&rest, seed);
        let path = CameraPath::new(script.cut, seed);
        Self { rest, camera, light, script, options: options.clone(), path, manipulations, set }
    }

    /// What lies behind the organ, in the template frame, mm; it does not move.
    pub fn wall(&self) -> Mesh {
        let Set { mesh, organ_faces, .. } = &self.set;
        let first = self.rest.positions.len();
        let faces = mesh.topology.faces[*organ_faces..].iter();
        let faces = faces.map(|f| f.map(|v| v - first as u32)).collect();
        Mesh::new(mesh.positions[first..].to_vec(), faces).expect("one of two manifold pieces")
    }

    /// What is true of frame `k`.
    pub fn moment(&self, k: usize) -> ClipMoment {
        let pose = self.path.pose(k);
        let shape = self.shape(k);
        let displacement =
            shape.iter().zip(&self.rest.positions).map(|(a, b)| (a - b).norm()).collect();
        let instruments = self.instruments(k, &shape, &pose);
        ClipMoment {
            pose,
            displacement,
            vertices: shape.iter().map(|p| pose * p).collect(),
            gain: self.script.gain(k),
            covered: self.script.covered(k),
            instruments,
        }
    }

    /// The picture of a moment, named `frame_NNN`.
    pub fn shoot(&self, k: usize, moment: &ClipMoment) -> ClipFrame {
        let seed = self.options.seed ^ ((k as u64 + 1) << 20);
        let conditions = Conditions { gain: moment.gain, covered: moment.covered, seed };
        self.shot(format!("frame_{k:03}"), moment, &conditions)
    }

    /// Exploration frame `i` of [`EXPLORATION`]: the organ at rest, no instrument, one exposure.
    pub fn explore(&self, i: usize) -> (ClipMoment, ClipFrame) {
        let pose = CameraPath::exploration(i, EXPLORATION);
        let moment = ClipMoment {
            pose,
            vertices: self.rest.positions.iter().map(|p| pose * p).collect(),
            displacement: vec![0.0; self.rest.positions.len()],
            gain: script::GAIN,
            covered: false,
            instruments: Vec::new(),
        };
        let seed = self.options.seed ^ ((i as u64 + 1) << 44);
        let conditions = Conditions { gain: moment.gain, covered: false, seed };
        let shot = self.shot(format!("frame_{i:03}"), &moment, &conditions);
        (moment, shot)
    }

    /// Rest shape and the manipulations at work, template frame.
    fn shape(&self, k: usize) -> Vec<Point3> {
        let mut shape = self.rest.positions.clone();
        for (m, plan) in self.manipulations.iter().zip(&self.script.manipulations) {
            let amount = plan.amount(k);
            if amount <= 0.0 {
                continue;
            }
            let point = m.attraction.point + m.drift * (plan.progress(k) - 0.5);
            let field = attraction_field(&self.rest, &[Attraction { point, ..m.attraction }], 0.0);
            let scale = amount * m.strength;
            shape.iter_mut().zip(field).for_each(|(p, d)| *p += d * scale);
        }
        shape
    }

    /// Instruments in view, camera axes.
    fn instruments(&self, k: usize, shape: &[Point3], pose: &Isometry) -> Vec<Instrument> {
        let holding = self.manipulations.iter().zip(&self.script.manipulations);
        let holding = holding.filter_map(|(m, plan)| {
            let near = plan.tool(k)?;
            let contact = shape[m.apex];
            let trocar = script::trocar(m.apex);
            // The jaws rest on the tissue; the tool withdraws along itself.
            let away = (trocar - contact).normalize();
            Some(Instrument::new(contact + away * (2.0 + 45.0 * (1.0 - near)), trocar))
        });
        let passing = self.script.passes.iter().filter_map(|pass| {
            let [from, to] = pass.ends;
            let tip = from + (to - from) * smooth(pass.progress(k)?);
            Some(Instrument::new(tip, pass.trocar))
        });
        holding.chain(passing).map(|i| i.moved(pose)).collect()
    }

    fn shot(&self, name: String, moment: &ClipMoment, conditions: &Conditions) -> ClipFrame {
        let scene = self.set.posed(&moment.vertices, &moment.pose);
        let raster = rasterize(&self.camera, &scene.topology, &scene.positions);
        let (frame, instrument) = photograph(
            name,
            (&self.camera, &self.light),
            (&self.set, &scene, &raster),
            &self.rest.with_positions(moment.vertices.clone()),
            &moment.instruments,
            conditions,
        );
        let tolerance = 0.5 * self.rest.mean_edge_length();
        let seen =
            visible_vertices(&self.camera, &scene.topology, &scene.positions, &raster, tolerance);
        let clear = |(p, seen): (&Point3, &bool)| {
            *seen && !conditions.covered && moment.instruments.iter().all(|i| !i.hides(p))
        };
        let visible = moment.vertices.iter().zip(&seen).map(clear).collect();
        ClipFrame { frame, instrument, visible }
    }
}

/// Peak of the largest relative edge-length change: 10 to 20 %, as in the paper's Fig. 5.
fn manipulation(rest: &Mesh, places: &[usize], pull: bool, random: &mut Random) -> Manipulation {
    let normals = vertex_normals(&rest.topology, &rest.positions);
    let apex = places[random.below(places.len())];
    let mut tilt = || 0.4 * (uniform(random) - 0.5);
    let lean = Vector3::new(tilt(), tilt(), tilt());
    let sign = if pull { 1.0 } else { -1.0 };
    let direction = (normals[apex] * sign + lean).normalize();
    let height = 18.0 + 4.0 * uniform(random);
    let point = rest.positions[apex] + direction * height;
    let attraction = Attraction { direction, point, angle: (11.0 / height).atan() };
    let extension = 0.10 + 0.10 * uniform(random);
    let full = deform_to(rest, &[attraction], extension, ExtensionOf::Largest, 0.0);
    let field = attraction_field(rest, &[attraction], 0.0);
    let moved = (full.vertices[apex] - rest.positions[apex]).norm();
    let strength = moved / field[apex].norm().max(1e-9);
    let turn = std::f64::consts::TAU * uniform(random);
    let drift = Vector3::new(4.0 * turn.cos(), 4.0 * turn.sin(), 0.0);
    Manipulation { attraction, drift, strength, apex }
}

/// Vertices at least 11 mm from the boundary, where a manipulation may take hold.
fn inner_vertices(mesh: &Mesh) -> Vec<usize> {
    let rim: Vec<u32> = boundary_loops(&mesh.topology).concat();
    let distance = |v: usize| {
        let away = |&r: &u32| (mesh.positions[r as usize] - mesh.positions[v]).norm();
        rim.iter().map(away).fold(f64::INFINITY, f64::min)
    };
    let mut order: Vec<(usize, f64)> =
        (0..mesh.positions.len()).map(|v| (v, distance(v))).collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    let inner = order.iter().filter(|o| o.1 >= 11.0).count().max(1);
    order[..inner.min(order.len())].iter().map(|o| o.0).collect()
}

/// Organ and wall, with their textures.
fn set(organ: &Mesh, seed: u64) -> Set {
    let [low, high] = organ.bounding_box();
    let wall = wall(high.z + 6.0, seed);
    let count = organ.positions.len() as u32;
    let mut faces = organ.topology.faces.clone();
    let organ_faces = faces.len();
    faces.extend(wall.1.iter().map(|f| f.map(|v| v + count)));
    let rest = [organ.positions.clone(), wall.0].concat();
    let reach = 2.0 + [low.x, low.y, high.x, high.y].iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    Set {
        organ_faces,
        mesh: Mesh::new(rest, faces).expect("two manifold pieces"),
        organ: TissueTexture::new([reach; 2], 0.06, Palette::ORGAN, seed),
        wall: TissueTexture::new([WALL[0], WALL[1]], 0.25, Palette::WALL, seed ^ 0x3A11),
    }
}

/// Half width and height of the wall, mm.
const WALL: [f64; 2] = [170.0, 150.0];

/// A bumpy wall behind the organ, facing −z.
fn wall(depth: f64, seed: u64) -> (Vec<Point3>, Vec<[u32; 3]>) {
    /// Bumps of 38 mm come out round.
    const CELLS: usize = 56;
    let at = |i: usize, j: usize| {
        let along = |k: usize, half: f64| half * (2.0 * k as f64 / CELLS as f64 - 1.0);
        let (x, y) = (along(i, WALL[0]), along(j, WALL[1]));
        let bumps = tissue::noise(x / 38.0, y / 38.0, seed)
            + 0.3 * tissue::noise(x / 13.0, y / 13.0, seed ^ 1);
        Point3::new(x, y, depth + 16.0 * bumps)
    };
    let positions = (0..=CELLS).flat_map(|j| (0..=CELLS).map(move |i| at(i, j))).collect();
    let n = CELLS as u32 + 1;
    let cell = |k: u32| {
        let a = k / (n - 1) * n + k % (n - 1);
        [[a, a + n, a + 1], [a + 1, a + n, a + n + 1]]
    };
    (positions, (0..(n - 1) * (n - 1)).flat_map(cell).collect())
}

#[cfg(test)]
mod tests;
