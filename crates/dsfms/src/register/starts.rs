//! Starts of eq. 3 where the surface bends as a whole and no part of it gives the pose.
//!
//! The robust pose settles on the part that most matches agree with: of a sheet that is folded in
//! two on one half, from which the solve ends beside the answer. Other starts are the pose that all
//! matches agree with best and those of either half along the two longest axes. Shapes are compared
//! by matches and strain, which tell depth only where matches lie like a net over what is seen;
//! with few matches there is one start.

use super::coarse::RegisterMemory;
use super::correspondence::Match;
use super::objective::{MotionProblem, hold};
use super::pose::rest_point;
use super::solve::{expected_displacement, in_rounds, losses_from, register_in};
use super::{Posed, RegisterOptions, Registered, Scene};
use crate::geometry::{Isometry, Point2, Point3, Vector3, scatter};
use crate::sfm::resection::refine_pose;
use crate::solver::Loss;

/// Displacement expected at another start, over what its matches share: a pose of all matches hides
/// most of the bend from them. Conformal error of kinectPaper with 1, 2 and 3: 12.9, 8.8 and 6.7 mm
/// (`docs/results/totem.md`).
const HIDDEN_BEND: f64 = 3.0;

/// A place is covered by a match within this part of the radius of what is seen: sixty matches,
/// evenly spread, cover it.
const NEAR: f64 = 0.15;

/// Share of what is seen that is to be covered: tracks without those of a quarter of the surface
/// cover 0.7 or more, 25 matches on what hardly moves (choosing scenes) less than this.
const COVERED: f64 = 0.6;

/// Coarsest scale of the loss, in residuals that one match in ten exceeds: at the start no match is
/// wrong.
const ALL_COUNT: f64 = 2.0;

/// Whether matches lie like a net over what is seen, so that the strain between them tells depth.
fn covered(scene: &Scene, matches: &[Match]) -> bool {
    let points: Vec<Point3> = matches.iter().map(|m| rest_point(scene.rest, m)).collect();
    let near = (NEAR * scene.radius()).powi(2);
    let is_near = |at: &Point3| points.iter().any(|p| (p - at).norm_squared() <= near);
    let mass = &scene.laplacian.mass;
    let seen = (0..mass.len()).filter(|&v| scene.visible[v]);
    let (mut all, mut covered) = (0.0, 0.0);
    for v in seen {
        all += mass[v];
        covered += if is_near(&scene.rest.positions[v]) { mass[v] } else { 0.0 };
    }
    covered >= COVERED * all
}

/// Solve eq. 3 from the rigid pose.
///
/// Where neighbouring matches share a motion that the pose does not explain and that the depth hold
/// would not allow, the surface bends as a whole and no part of it gives the pose: the solve is
/// then repeated from the rest shape posed again, with smoothing and depth hold loosened to the
/// motion found, until that no longer grows; and from other rigid starts, of which the one that
/// leaves least of matches and strain is taken.
///
/// ```
/// use dsfms::register::{RegisterOptions, Scene, pose, register};
/// use dsfms::synth::Case;
///
/// let (case, options) = (Case::example(1), RegisterOptions::default());
/// let rest = &case.template.mesh;
/// let posed = pose(&case.camera, rest, &case.matches, &options, 0)?;
/// let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
/// let scene = Scene::new(&case.camera, rest, rigid);
/// let found = register(&scene, &case.matches, &posed, &options);
/// assert!(found.residual_px < 3.0);
/// # Ok::<_, dsfms::register::RegisterError>(())
/// ```
#[doc(alias(
    "eq. 3",
    "NRSfM",
    "shape from template",
    "SfT",
    "deformable registration",
    "non-rigid registration"
))]
pub fn register(
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    options: &RegisterOptions,
) -> Registered {
    let memory = &mut RegisterMemory::default();
    let found = register_in(memory, scene, matches, posed, options);
    let bends = expected_displacement(scene, posed, options) > hold(scene, options);
    match bends && covered(scene, matches) {
        true => best_of_starts(memory, scene, matches, posed, found, options),
        false => found,
    }
}

/// Matches on the rest shape: their points and pixels.
struct Sighted<'a> {
    scene: &'a Scene<'a>,
    points: Vec<Point3>,
    pixels: Vec<Point2>,
}

/// Of eq. 3 solved from `found` and from every other start the one that leaves least of matches and
/// strain.
fn best_of_starts(
    memory: &mut RegisterMemory,
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    found: Registered,
    options: &RegisterOptions,
) -> Registered {
    let problem = MotionProblem { scene, matches, displacement: 0.0, options };
    let cost = |found: &Registered| problem.left(&found.vertices);
    let mut best = (cost(&found), found);
    for pose in Sighted::of(scene, matches).starts(posed) {
        let found = from_pose(memory, scene, matches, pose, options);
        let cost = cost(&found);
        if cost < best.0 {
            best = (cost, found);
        }
    }
    best.1
}

/// Eq. 3 from a pose that any match may agree with.
fn from_pose(
    memory: &mut RegisterMemory,
    scene: &Scene,
    matches: &[Match],
    pose: Isometry,
    options: &RegisterOptions,
) -> Registered {
    let posed = scene.rest.positions.iter().map(|p| pose * p).collect();
    let there = Scene::new(scene.camera, scene.rest, posed);
    let Sighted { points, pixels, .. } = Sighted::of(scene, matches);
    let posed = Posed::at(scene.camera, &points, &pixels, pose, f64::INFINITY);
    let coarse = options.robust_px[0].max(ALL_COUNT * posed.nine_of_ten_px());
    let displacement = HIDDEN_BEND * expected_displacement(&there, &posed, options);
    in_rounds(memory, &there, matches, displacement, &losses_from(coarse, options), options)
}

impl<'a> Sighted<'a> {
    fn of(scene: &'a Scene<'a>, matches: &[Match]) -> Self {
        let points = matches.iter().map(|m| rest_point(scene.rest, m)).collect();
        Self { scene, points, pixels: matches.iter().map(|m| m.pixel).collect() }
    }

    /// The pose of all matches and of both halves along the two longest axes of their points.
    fn starts(&self, posed: &Posed) -> Vec<Isometry> {
        let loss = Loss::GemanMcClure(3.0 * posed.nine_of_ten_px());
        let fit = |start: &Isometry, which: &dyn Fn(&Point3) -> bool| {
            let of = (0..self.points.len()).filter(|&i| which(&self.points[i]));
            let (points, pixels): (Vec<Point3>, Vec<Point2>) =
                of.map(|i| (self.points[i], self.pixels[i])).unzip();
            let enough = points.len() >= super::pose::NEEDED;
            enough.then(|| refine_pose(self.scene.camera, start, &points, &pixels, loss))
        };
        let Some(all) = fit(&posed.pose, &|_| true) else { return Vec::new() };
        let (centre, [first, second]) = self.longest_axes();
        let half = |side: Vector3| fit(&all, &|p| (p - centre).dot(&side) > 0.0);
        let halves = [first, -first, second, -second].into_iter().filter_map(half);
        std::iter::once(all).chain(halves).collect()
    }

    /// Centre of the points and the two directions in which they spread most.
    fn longest_axes(&self) -> (Point3, [Vector3; 2]) {
        let (centre, spread) = scatter(self.points.iter().copied());
        let eigen = spread.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        (centre, [order[0], order[1]].map(|k| eigen.eigenvectors.column(k).into_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, CameraModel};
    use crate::mesh::{Mesh, shapes::grid_faces};
    use crate::register::{Prior, PriorWeights, pose, register};

    const COLUMNS: usize = 13;
    const ROWS: usize = 9;

    /// A sheet of 240 x 160 mm, 600 mm away, folded by an angle along a line at 35 % of its width.
    fn sheet(fold: f64) -> Vec<Point3> {
        let at = |i: usize| {
            let (x, y) = (20.0 * (i % COLUMNS) as f64, 20.0 * (i / COLUMNS) as f64);
            let beyond = (x - 84.0).max(0.0);
            let x = x.min(84.0) + beyond * fold.cos();
            Point3::new(x - 120.0, y - 80.0, 600.0 + beyond * fold.sin())
        };
        (0..COLUMNS * ROWS).map(at).collect()
    }

    #[test]
    fn a_folded_sheet_is_found_whose_pose_only_one_half_has() {
        let camera = CameraModel::pinhole([640, 480], [600.0; 2], [319.5, 239.5]);
        let faces = grid_faces(COLUMNS, ROWS, false).into_iter().map(|[a, b, c]| [a, c, b]);
        let rest = Mesh::new(sheet(0.0), faces.collect()).unwrap();
        let truth = sheet(1.2);
        let corner = |face: usize, v: u32| rest.topology.faces[face].map(|c| f64::from(c == v));
        let seen = |v: usize| Match {
            face: rest.topology.vertex_faces[v][0],
            barycentric: corner(rest.topology.vertex_faces[v][0] as usize, v as u32),
            pixel: camera.project(&truth[v]).unwrap().pixel,
        };
        let matches: Vec<Match> = (0..truth.len()).map(seen).collect();
        let prior = PriorWeights { kind: Prior::Isometric, ..PriorWeights::default() };
        let options = RegisterOptions { prior, ..RegisterOptions::default() };
        let posed = pose(&camera, &rest, &matches, &options, 0).unwrap();
        let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
        let scene = Scene::new(&camera, &rest, rigid);
        let error = |found: &Registered| {
            let off = found.vertices.iter().zip(&truth).map(|(a, b)| (a - b).norm());
            off.sum::<f64>() / truth.len() as f64
        };
        let memory = &mut RegisterMemory::default();
        let displacement = expected_displacement(&scene, &posed, &options);
        let losses = losses_from(options.robust_px[0], &options);
        let alone = error(&in_rounds(memory, &scene, &matches, displacement, &losses, &options));
        let found = error(&register(&scene, &matches, &posed, &options));
        assert!(found < 3.0 && found < 0.5 * alone, "{found} mm, from the robust pose {alone} mm");
    }
}
