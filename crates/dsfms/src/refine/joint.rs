//! Beyond the paper: motion, prior and shading in one problem.
//!
//! Eq. 4 starts from V′ and can only bend what motion left straight. Here the matches, the conformal
//! prior and the brightness of samples inside faces decide together, from coarse blur to fine, so
//! that texture carries the surface along while shading turns its normals.

use super::Photograph;
use super::glare::{NoiseOptions, weigh};
use super::look::{Look, LookOptions, diagonal};
use super::mirror::mirrored;
use crate::energy::photometric::Sample;
use crate::energy::{
    Brightness, GlobalsPrior, Objective, Photometric, Smoothing, Unknowns, Workspace,
};
use crate::geometry::Point3;
use crate::image::ColorImage;
use crate::light::LightModel;
use crate::mesh::{Mesh, Topology};
use crate::raster::Raster;
use crate::register::objective::{hold_depth, keep, motion, stay};
use crate::register::{Match, Prior, Scene};
use crate::solver::{Loss, Options, Summary};
use serde::{Deserialize, Deserializer, Serialize, de::Error};

/// Options of the joint solve. Lengths are relative to the visible radius, so they hold in any unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JointOptions {
    /// What the surface keeps.
    pub prior: Prior,
    /// Weight of shearing and anisotropy (or of the other priors) per visible area.
    pub conformal: f64,
    /// Weight of the log area ratio per visible area.
    pub stretch: f64,
    /// Weight of the Laplacian of the displacement from the posed template.
    pub smoothing: f64,
    /// Weight of all photometric samples together, in units of one sample for each of 334 vertices.
    pub photometric: f64,
    /// Bounds of the noise of the image model proportional to brightness, which is measured on the
    /// samples of the coarse shape.
    pub sigma_relative: [f64; 2],
    /// Noise of the image model, absolute, linear light.
    pub sigma_absolute: f64,
    /// Weigh the channels so that white glare cancels; else grey, and what may be glare is left out.
    pub colour: bool,
    /// Geman-McClure scale of the photometric residuals, in standard deviations.
    pub robust: f64,
    /// Geman-McClure scale of the matches, px.
    pub match_px: f64,
    /// Depth of the matches under a near light, which fixes scale itself, is held to the rigid pose
    /// within this fraction of the visible radius; under a distant light the tolerance of eq. 3
    /// holds.
    pub near_depth_hold: f64,
    /// Spread of the log gain about its expectation.
    pub gain_sigma: f64,
    /// Spread of the ambient light about 0.
    pub ambient_sigma: f64,
    /// Blurs of image and albedo, coarse to fine, as fractions of the image diagonal; at least one.
    #[serde(deserialize_with = "one_or_more")]
    pub blurs: Vec<f64>,
    /// Three samples a face as long as they are no more than this, else one.
    pub max_samples: usize,
    /// Samples within this many blur radii of a predicted contour are left out.
    pub contour_blurs: f64,
    /// Samples with less cosine towards the camera than this are left out.
    pub grazing: f64,
    /// Samples within this angle of the mirror direction are left out where there are highlights,
    /// degrees.
    pub specular_deg: f64,
    /// Halo around saturated pixels, as a fraction of the image diagonal.
    pub halo: f64,
    /// Geman-McClure scale of shearing, anisotropy and log area ratio: tissue under a tool deforms
    /// strongly in a small place, and beyond this strain the prior no longer resists.
    pub strain: f64,
    /// Regions whose movement along the viewing rays is tried the other way, in every stage but the
    /// coarsest, whose blur hides the texture that tells them apart, and the last.
    pub mirrors: usize,
}

fn one_or_more<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
    let blurs = Vec::deserialize(from)?;
    if blurs.is_empty() {
        return Err(D::Error::custom("blurs is empty; expected one blur or more"));
    }
    Ok(blurs)
}

impl Default for JointOptions {
    fn default() -> Self {
        Self {
            prior: Prior::Conformal,
            conformal: 5e4,
            stretch: 2e4,
            smoothing: 30.0,
            photometric: 4.0,
            sigma_relative: [0.01, 0.1],
            sigma_absolute: 0.002,
            colour: true,
            robust: 3.0,
            match_px: 4.0,
            near_depth_hold: 0.2,
            gain_sigma: 0.1,
            ambient_sigma: 0.02,
            blurs: vec![0.018, 0.009, 0.0045, 0.0045],
            max_samples: 8000,
            contour_blurs: 1.5,
            grazing: 0.25,
            specular_deg: 12.0,
            halo: 0.02,
            strain: 0.2,
            mirrors: 2,
        }
    }
}

/// The shape of the joint solve.
#[derive(Clone, Debug)]
pub struct Joined {
    /// Vertices in camera axes.
    pub vertices: Vec<Point3>,
    /// Exposure gain of the frame relative to the albedo.
    pub gain: f64,
    /// Ambient light, linear.
    pub ambient: f64,
    /// Photometric samples of the last round.
    pub samples: usize,
    /// The last solve.
    pub summary: Summary,
}

/// Solve motion, prior and shading together, from `start` (V′ of eq. 3).
///
/// `depth_sigma` is eq. 3's tolerance for the depth of the matches under a distant light.
pub fn join(
    scene: &Scene,
    start: &[Point3],
    depth_sigma: f64,
    matches: &[Match],
    photo: &Photograph,
    options: &JointOptions,
) -> Joined {
    let hold = depth_tolerance(scene, depth_sigma, &photo.light.light, options);
    let mut state = Unknowns { vertices: start.to_vec(), globals: vec![0.0, 0.0] };
    let mut expected = photo.expected_log_gain;
    let (mut last, mut workspace) = (None, Workspace::default());
    let last_stage = options.blurs.len().saturating_sub(1);
    let mut reposed: Option<Scene> = None;
    for (stage, &blur) in options.blurs.iter().enumerate() {
        let scene = reposed.as_ref().unwrap_or(scene);
        let look = look(photo, scene.rest, &state.vertices, blur, options);
        if stage == 0 {
            state.globals[0] = look.log_gain;
            expected.get_or_insert(look.log_gain);
        }
        let gain = expected.unwrap_or(look.log_gain);
        let problem = || objective(scene, matches, hold, photo, &look, gain, options);
        let mirrors = if (1..last_stage).contains(&stage) { options.mirrors } else { 0 };
        let (next, summary) =
            settle(problem, &mut workspace, &scene.rest.topology, start, state, mirrors);
        state = next;
        last = Some((summary, look.samples.len()));
        // A near light tells the distance of everything, so the shape now knows the pose better than
        // the matches did; under a distant one only the matches hold it.
        if matches!(photo.light.light, LightModel::Point(_)) {
            reposed = Some(scene.reposed(&state.vertices));
        }
    }
    let (summary, samples) = last.expect("there is at least one blur");
    Joined {
        gain: state.globals[0].exp(),
        ambient: state.globals[1],
        vertices: state.vertices,
        samples,
        summary,
    }
}

/// Tolerance for the depth of the matches, given that of eq. 3.
pub(super) fn depth_tolerance(
    scene: &Scene,
    depth_sigma: f64,
    light: &LightModel,
    options: &JointOptions,
) -> f64 {
    match light {
        LightModel::Point(_) => depth_sigma.max(options.near_depth_hold * scene.radius()),
        LightModel::Collinear => depth_sigma,
    }
}

/// Minimise, then start again from the other answers to what moved since `coarse`; the lowest cost
/// stays.
fn settle<'a>(
    problem: impl Fn() -> Objective<'a>,
    workspace: &mut Workspace,
    topology: &Topology,
    coarse: &[Point3],
    state: Unknowns,
    mirrors: usize,
) -> (Unknowns, Summary) {
    let solver = Options { max_steps: 12, cost_tolerance: 1e-4, ..Options::default() };
    let mut best = problem().minimise_in(workspace, state, &solver);
    for vertices in mirrored(topology, coarse, &best.0.vertices, mirrors) {
        let other = Unknowns { vertices, globals: best.0.globals.clone() };
        let other = problem().minimise_in(workspace, other, &solver);
        if other.1.cost().1 < best.1.cost().1 {
            best = other;
        }
    }
    best
}

/// What one shape makes of a photograph at one blur.
pub(super) struct Seen {
    pub(super) image: ColorImage,
    pub(super) samples: Vec<Sample>,
    pub(super) log_gain: f64,
}

/// Barycentrics of the samples of a face.
const INSIDE: [[f64; 3]; 3] = [
    [2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0],
    [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0],
    [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0],
];

/// The one sample of a face on a fine mesh.
const CENTRE: [[f64; 3]; 1] = [[1.0 / 3.0; 3]];

/// Number of faces with at least one pixel.
fn faces_drawn(raster: &Raster) -> usize {
    let mut faces: Vec<u32> = raster.face.iter().copied().filter(|&f| f != u32::MAX).collect();
    faces.sort_unstable();
    faces.dedup();
    faces.len()
}

pub(super) fn look(
    photo: &Photograph,
    rest: &Mesh,
    shape: &[Point3],
    blur: f64,
    options: &JointOptions,
) -> Seen {
    let diagonal = diagonal(photo.picture.linear.size);
    let blur = blur * diagonal;
    let seen = LookOptions {
        blur,
        grazing: options.grazing,
        contour: options.contour_blurs * blur,
        halo: options.halo * diagonal,
        mirror_deg: options.specular_deg,
        colour: options.colour,
    };
    let look = Look::new(photo, rest, shape, seen);
    let fine = 3 * faces_drawn(&look.raster) > options.max_samples;
    let inside = if fine { &CENTRE[..] } else { &INSIDE };
    let (mut places, mut channels) = (Vec::new(), Vec::new());
    for (f, &face) in rest.topology.faces.iter().enumerate() {
        for &b in inside {
            let Some((point, pixel, normal)) = look.on_face(face, b) else { continue };
            if let Some(found) = look.at(&point, &pixel, &normal) {
                places.push((f as u32, b));
                channels.push(found);
            }
        }
    }
    let noise = NoiseOptions {
        relative: options.sigma_relative,
        absolute: options.sigma_absolute,
        colour: options.colour,
    };
    let weighed = weigh(&channels, &noise);
    let sample = |(i, brightness): (usize, Brightness)| {
        let (face, barycentric) = places[i];
        Sample { face, barycentric, brightness }
    };
    let samples = weighed.brightness.into_iter().map(sample).collect();
    Seen { image: look.image, samples, log_gain: weighed.log_gain }
}

pub(super) fn objective<'a>(
    scene: &'a Scene,
    matches: &[Match],
    depth_sigma: f64,
    photo: &Photograph<'a>,
    look: &'a Seen,
    expected_log_gain: f64,
    options: &JointOptions,
) -> Objective<'a> {
    let area = scene.visible_area;
    let share = 334.0 / look.samples.len().max(1) as f64;
    let smoothing = Smoothing::of_displacement(&scene.laplacian, &scene.posed, area);
    let photometric = Photometric::new(
        photo.camera,
        photo.light,
        &look.image,
        &scene.rest.topology,
        look.samples.clone(),
    );
    let strain = Loss::GemanMcClure(options.strain);
    let prior = |index, mean, sigma| GlobalsPrior { index: [index], mean, sigma };
    let matched = Objective::over(scene.posed.len(), 2).plus(
        1.0,
        Loss::GemanMcClure(options.match_px),
        motion(scene, matches, 1.0),
    );
    keep(matched, scene, options.prior, strain, [options.conformal, options.stretch])
        .plus(options.smoothing, Loss::Squared, smoothing)
        .plus(share * options.photometric, Loss::GemanMcClure(options.robust), photometric)
        .plus(1.0, Loss::Huber(1.0), hold_depth(scene, matches, &scene.posed, depth_sigma))
        .plus(3.0, Loss::Squared, stay(scene))
        .plus(1.0, Loss::Squared, prior(0, expected_log_gain, options.gain_sigma))
        .plus(1.0, Loss::Squared, prior(1, 0.0, options.ambient_sigma))
}

#[cfg(test)]
mod tests {
    use super::JointOptions;

    #[test]
    fn no_blur_at_all_is_refused_where_options_are_read() {
        let error = toml::from_str::<JointOptions>("blurs = []").unwrap_err();
        assert!(error.to_string().contains("one blur or more"), "{error}");
        assert!(toml::from_str::<JointOptions>("blurs = [0.01]").is_ok());
    }
}
