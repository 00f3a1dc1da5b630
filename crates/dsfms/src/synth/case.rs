//! One synthetic case from a seed: organ, deformation, pose, frame, matches and template.

use super::random::{Random, normal, uniform};
use super::{
    Attraction, Deformation, Draw, Gloss, Patch, RenderOptions, correspond, deform, patch, render,
};
use crate::camera::{CameraModel, Lens};
use crate::geometry::{Isometry, Point3, Vector3};
use crate::image::{Frame, ToneCurve};
use crate::light::LightModel;
use crate::register::Match;
use crate::register::scene::visibility;
use crate::template::{LengthUnit, Template};

/// What a case is made of.
#[derive(Clone, Debug)]
pub struct CaseOptions {
    /// Vertices of the patch.
    pub vertices: usize,
    /// Mean relative edge-length change in the deformed zone (0.1 for 10 %).
    pub extension: f64,
    /// Light of the scene, known to the template.
    pub light: LightModel,
    /// Matches outside the deformed zone.
    pub draw: Draw,
    /// `true` pulls towards the camera, `false` pushes away.
    pub pull: bool,
}

/// Where matches may lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Admitted {
    /// Outside the deformed zone (paper §8.1: tools and highlights hide it).
    Calm,
    /// Anywhere that is seen.
    Everywhere,
}

/// A deformed organ in front of a laparoscope, with its exact truth.
///
/// ```
/// let case = dsfms::synth::Case::example(1);
/// assert_eq!((case.frame.size, case.matches.len()), ([720, 576], 25));
/// assert_eq!(case.zone_rms(&case.truth), 0.0);
/// ```
#[derive(Clone, Debug)]
pub struct Case {
    /// Camera, 720×576.
    pub camera: CameraModel,
    /// Template with exact albedo and light, of unknown exposure.
    pub template: Template,
    /// The image: unknown gain and ambient light, a glossy highlight, noise.
    pub frame: Frame,
    /// Matches outside the zone.
    pub matches: Vec<Match>,
    /// The deformation in the template frame, with its zone.
    pub deformation: Deformation,
    /// True vertices in camera axes.
    pub truth: Vec<Point3>,
    /// Vertices the camera sees.
    pub visible: Vec<bool>,
}

impl Case {
    /// The case of a seed: a patch 75 mm in front of a camera of 750 px, one attraction point 18 to
    /// 22 mm off the surface within 8 × 6 mm of its centre, reach 0.5 rad.
    pub fn new(options: &CaseOptions, seed: u64) -> Self {
        let mut random = Random::new(seed, 0xCA5E);
        let organ = patch(options.vertices, seed);
        let deformation = deformation(&organ.mesh, options, &mut random);
        Self::of(organ, deformation, options, Admitted::Calm, seed, &mut random)
    }

    /// A deformed organ (rest shape about the origin, outward normals along −z) posed 75 mm before
    /// the camera, rendered and matched. `options` tells light and matches, `seed` the exposure and
    /// the noise of the image, `random` pose and matches.
    pub fn of(
        organ: Patch,
        deformation: Deformation,
        options: &CaseOptions,
        admitted: Admitted,
        seed: u64,
        random: &mut Random,
    ) -> Self {
        let pose = pose(random);
        let truth: Vec<Point3> = deformation.vertices.iter().map(|v| pose * v).collect();
        let camera = CameraModel {
            size: [720, 576],
            focal: [750.0, 750.0],
            centre: [359.5, 287.5],
            lens: Lens::default(),
        };
        let look = RenderOptions {
            gain: (0.2 * normal(random)).exp(),
            ambient: 0.02 * uniform(random),
            gloss: Some(Gloss { strength: 1.5, width: 0.06 }),
            noise: 1.5,
            seed,
            ..RenderOptions::default()
        };
        let shape = organ.mesh.with_positions(truth.clone());
        let frame = render(&camera, &options.light, &shape, &organ.albedo, &look);
        let visible = visibility(&camera, &organ.mesh, &truth);
        let admit = |(seen, zone): (&bool, &bool)| *seen && !(admitted == Admitted::Calm && *zone);
        let admit: Vec<bool> = visible.iter().zip(&deformation.zone).map(admit).collect();
        let matches = correspond(&camera, &organ.mesh, &truth, &admit, options.draw, random);
        let template = Template {
            unit: LengthUnit::Millimetre,
            mesh: organ.mesh,
            seen: Vec::new(),
            sigma: Vec::new(),
            flattening: None,
            albedo: Some(organ.albedo),
            features: None,
            views: Vec::new(),
            points: Vec::new(),
            camera: Some(camera.clone()),
            tone: ToneCurve::Srgb,
            light: Some(options.light.clone()),
            coat: Default::default(),
            usual: None,
            surroundings: None,
        };
        Self { camera, template, frame, matches, deformation, truth, visible }
    }

    /// A case of 300 vertices for examples and tests: 25 matches with 1 px of noise, a pull that
    /// stretches the edges in its zone by 3 %.
    pub fn example(seed: u64) -> Self {
        let options = CaseOptions {
            vertices: 300,
            extension: 0.03,
            light: LightModel::default(),
            draw: Draw { count: 25, sigma_px: 1.0 },
            pull: true,
        };
        Self::new(&options, seed)
    }

    /// The organ at rest from so many places, and their `camera_from_template`: the camera goes
    /// once around it on a circle 75 mm before it, 25 degrees off its axis, and looks at its
    /// centre.
    pub fn explore(&self, count: usize) -> (Vec<Frame>, Vec<Isometry>) {
        let Template { mesh, albedo, light, .. } = &self.template;
        let (Some(albedo), Some(light)) = (albedo, light) else { return Default::default() };
        let frame = |(k, pose): (usize, &Isometry)| {
            let posed = mesh.positions.iter().map(|p| pose * p).collect();
            let look = RenderOptions { seed: k as u64, ..Default::default() };
            let frame = render(&self.camera, light, &mesh.with_positions(posed), albedo, &look);
            Frame { name: format!("frame_{k:03}"), ..frame }
        };
        let poses: Vec<Isometry> = (0..count).map(|k| around(k as f64 / count as f64)).collect();
        (poses.iter().enumerate().map(frame).collect(), poses)
    }

    /// Root mean square 3D error of a shape over the zone, or over everything without one, mm.
    pub fn zone_rms(&self, shape: &[Point3]) -> f64 {
        let zone = &self.deformation.zone;
        let all = !zone.iter().any(|&z| z);
        let squares: Vec<f64> = (0..shape.len())
            .filter(|&v| all || zone[v])
            .map(|v| (shape[v] - self.truth[v]).norm_squared())
            .collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }
}

fn deformation(
    mesh: &crate::mesh::Mesh,
    options: &CaseOptions,
    random: &mut Random,
) -> Deformation {
    let sign = if options.pull { -1.0 } else { 1.0 };
    let height = 18.0 + 4.0 * uniform(random);
    let centre = Point3::new(16.0 * (uniform(random) - 0.5), 12.0 * (uniform(random) - 0.5), 0.0);
    let direction = Vector3::z() * sign;
    let attraction = Attraction { direction, point: centre + direction * height, angle: 0.5 };
    deform(mesh, &[attraction], options.extension, 0.0)
}

/// A camera on the circle of [`Case::explore`], at a part of the way around.
fn around(part: f64) -> Isometry {
    let turn = std::f64::consts::TAU * part;
    let tilt = Vector3::new(turn.cos(), turn.sin(), 0.0) * 25f64.to_radians();
    Isometry::new(Vector3::new(0.0, 0.0, 75.0), tilt)
}

fn pose(random: &mut Random) -> Isometry {
    let mut around = |s: f64| s * normal(random);
    let offset = Vector3::new(around(2.0), around(2.0), 75.0);
    Isometry::new(offset, Vector3::new(around(0.1), around(0.1), around(0.3)))
}
