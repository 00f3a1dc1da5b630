//! The scale of a reconstruction from a metric surface of the same organ: a similarity that lays the
//! reconstruction, which may be a part, on it.
//!
//! Many starts (the seen side turned to every direction, spun about it), a few steps to the nearest
//! points each, the best refined to the nearest tangent planes (Chen and Medioni 1992). The misfit is
//! relative to the size of the placed surface: shrinking to a point gains nothing.

use super::scale::{Scale, ScaleError};
use super::spots::even_points;
use crate::geometry::{Isometry, Point3, Similarity, Vector3, align_similarity, normal, point_at};
use crate::mesh::Mesh;
use crate::mesh::surface_points::ClosestPoints;
use nalgebra::{SMatrix, SVector, Translation3, Unit, UnitQuaternion};
use rayon::prelude::*;

/// Directions to which the seen side is turned, and turns about each.
const STARTS: [usize; 2] = [40, 12];
/// Points that are moved in the search, and in the refinement.
const POINTS: [usize; 2] = [100, 1500];
/// Steps of the search, of the refinement to points, and to planes.
const STEPS: [usize; 3] = [8, 20, 30];
/// Starts that are refined.
const REFINED: usize = 12;
/// Share of the points that fit best and count: the rest may not be on the metric surface.
const KEPT: f64 = 0.85;
/// Smallest cosine between the normals of a point and of the place it is laid on.
const MIN_COSINE: f64 = 0.3;
/// Misfit above which it is another shape.
const MAX_MISFIT: f64 = 0.05;

/// Millimetres per unit of `found`, from `metric` (mm, any place, outward orientation; it may show
/// more of the organ).
///
/// # Errors
/// Surfaces that do not fit each other in one way only.
#[doc(alias = "ICP")]
pub(crate) fn fit_to_mesh(found: &Mesh, metric: &Mesh) -> Result<Scale, ScaleError> {
    let closest = ClosestPoints::new(metric);
    let fit = |points: &[Oriented]| ScaleFit { points: points.to_vec(), metric, closest: &closest };
    let (coarse, fine) = (fit(&oriented(found, POINTS[0])), fit(&oriented(found, POINTS[1])));
    let mut tried: Vec<(f64, Similarity)> = starts(&coarse.points, &oriented(metric, 2000))
        .into_par_iter()
        .filter_map(|start| coarse.to_points(start, STEPS[0]))
        .collect();
    // Stable: of equal misfits the first start.
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    tried.truncate(REFINED);
    let refined: Vec<(f64, Similarity)> = tried
        .into_par_iter()
        .filter_map(|(_, start)| fine.to_planes(fine.to_points(start, STEPS[1])?.1, STEPS[2]))
        .collect();
    let best = refined.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((misfit, placed)) = best else { return Err(ScaleError::NoFit { misfit: 1.0 }) };
    if misfit > MAX_MISFIT {
        return Err(ScaleError::NoFit { misfit });
    }
    Ok(Scale { factor: placed.scaling(), each: vec![placed.scaling()] })
}

/// A point of a surface and its unit normal.
type Oriented = (Point3, Vector3);

fn oriented(mesh: &Mesh, count: usize) -> Vec<Oriented> {
    let point = |(face, w): (usize, [f64; 3])| {
        let corners = mesh.corners(face);
        Some((point_at(corners, w), normal(corners[0], corners[1], corners[2])?))
    };
    even_points(mesh, count).into_iter().filter_map(point).collect()
}

/// Mean, and root mean square distance from it.
fn extent<'a>(points: impl Iterator<Item = &'a Point3> + Clone) -> (Vector3, f64) {
    let count = points.clone().count().max(1) as f64;
    let mean = points.clone().map(|p| p.coords).sum::<Vector3>() / count;
    let square = points.map(|p| (p.coords - mean).norm_squared()).sum::<f64>() / count;
    (mean, square.sqrt())
}

/// The reconstruction faces the cameras: turned to each direction, it covers what of the metric
/// surface faces that way.
fn starts(found: &[Oriented], metric: &[Oriented]) -> Vec<Similarity> {
    let facing = found.iter().map(|f| f.1).sum::<Vector3>();
    let (middle, size) = extent(found.iter().map(|f| &f.0));
    let (Some(facing), true) = (Unit::try_new(facing, 1e-9), size > 0.0) else { return Vec::new() };
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let [directions, spins] = STARTS;
    (0..directions * spins)
        .filter_map(|k| {
            let (i, spin) = (k / spins, (k % spins) as f64 / spins as f64);
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / directions as f64;
            let (r, a) = ((1.0 - z * z).sqrt(), golden * i as f64);
            let direction = Unit::new_normalize(Vector3::new(r * a.cos(), r * a.sin(), z));
            let side: Vec<&Point3> =
                metric.iter().filter(|m| m.1.dot(&direction) > 0.2).map(|m| &m.0).collect();
            let (target, target_size) = extent(side.iter().copied());
            let turn =
                UnitQuaternion::rotation_between_axis(&facing, &direction).unwrap_or_else(|| {
                    UnitQuaternion::from_axis_angle(&any_across(&facing), std::f64::consts::PI)
                });
            let turn =
                UnitQuaternion::from_axis_angle(&direction, spin * std::f64::consts::TAU) * turn;
            let scale = target_size / size;
            let shift = target - scale * (turn * middle);
            (scale > 0.0).then(|| Similarity::from_parts(Translation3::from(shift), turn, scale))
        })
        .collect()
}

fn any_across(axis: &Unit<Vector3>) -> Unit<Vector3> {
    let other = if axis.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    Unit::new_normalize(axis.cross(&other))
}

struct ScaleFit<'a> {
    points: Vec<Oriented>,
    metric: &'a Mesh,
    closest: &'a ClosestPoints<'a>,
}

/// A point of the reconstruction, where it is laid, the normal there, and the distance.
struct PointPair {
    from: Point3,
    to: Point3,
    normal: Vector3,
    distance: f64,
}

impl ScaleFit<'_> {
    /// The best [`KEPT`] of the pairs whose normals agree.
    fn pairs(&self, placed: &Similarity) -> Vec<PointPair> {
        let pair = |(p, n): &Oriented| {
            let hit = self.closest.closest(&(placed * p))?;
            let [a, b, c] = self.metric.corners(hit.face as usize);
            let normal = normal(a, b, c)?;
            let agree = normal.dot(&(placed.isometry.rotation * n)) > MIN_COSINE;
            agree.then_some(PointPair { from: *p, to: hit.point, normal, distance: hit.distance })
        };
        let mut pairs: Vec<PointPair> = self.points.iter().filter_map(pair).collect();
        pairs.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        pairs.truncate((KEPT * self.points.len() as f64) as usize);
        pairs
    }

    /// Root mean square distance over the size of the placed points; `None` where too few agree.
    fn misfit(&self, placed: &Similarity) -> Option<f64> {
        let pairs = self.pairs(placed);
        let enough = pairs.len() as f64 >= 0.6 * self.points.len() as f64;
        let (_, size) = extent(pairs.iter().map(|p| &p.from));
        let square = pairs.iter().map(|p| p.distance.powi(2)).sum::<f64>() / pairs.len() as f64;
        let misfit = square.sqrt() / (size * placed.scaling());
        (enough && misfit.is_finite()).then_some(misfit)
    }

    fn to_points(&self, mut placed: Similarity, steps: usize) -> Option<(f64, Similarity)> {
        for _ in 0..steps {
            let pairs = self.pairs(&placed);
            let (from, to): (Vec<Point3>, Vec<Point3>) =
                pairs.iter().map(|p| (p.from, p.to)).unzip();
            let rotation = align_similarity(&from, &to)?.isometry.rotation;
            let ((cf, sf), (ct, st)) = (extent(from.iter()), extent(to.iter()));
            // Least squares would shrink: nearest points are pulled together.
            let scale = st / sf;
            if !(scale.is_finite() && scale > 0.0) {
                return None;
            }
            let shift = ct - scale * (rotation * cf);
            placed = Similarity::from_isometry(
                Isometry::from_parts(Translation3::from(shift), rotation),
                scale,
            );
        }
        Some((self.misfit(&placed)?, placed))
    }

    fn to_planes(&self, mut placed: Similarity, steps: usize) -> Option<(f64, Similarity)> {
        for _ in 0..steps {
            let pairs = self.pairs(&placed);
            let (centre, size) = extent(pairs.iter().map(|p| &p.to));
            let (mut h, mut g) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
            for pair in &pairs {
                // About the middle and in its size: turn, shift, growth.
                let x = ((placed * pair.from).coords - centre) / size;
                let (n, turn) = (pair.normal, x.cross(&pair.normal));
                let row = SVector::from([turn.x, turn.y, turn.z, n.x, n.y, n.z, n.dot(&x)]);
                let miss = n.dot(&(pair.to.coords - centre)) / size - n.dot(&x);
                h += row * row.transpose();
                g += row * miss;
            }
            h += SMatrix::identity() * (1e-6 * pairs.len() as f64);
            let step = h.cholesky()?.solve(&g);
            let turn = UnitQuaternion::new(Vector3::new(step[0], step[1], step[2]));
            let growth = step[6].clamp(-0.2, 0.2).exp();
            let shift = Vector3::new(step[3], step[4], step[5]) * size + centre;
            let moved = Similarity::from_parts(
                Translation3::from(shift - growth * (turn * centre)),
                turn,
                growth,
            );
            placed = moved * placed;
            if step.norm() < 1e-7 {
                break;
            }
        }
        Some((self.misfit(&placed)?, placed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// A hemisphere with unequal bumps, and a smaller, turned part of it.
    fn bumpy() -> Mesh {
        let mesh = shapes::hemisphere(4, 30.0);
        let bump = |p: &Point3| {
            let wave =
                (0.13 * p.x).sin() * (0.09 * p.y + 0.4).cos() + 0.5 * (0.2 * p.y - 0.3).sin();
            p + p.coords.normalize() * (4.0 * wave + 0.1 * p.x)
        };
        mesh.with_positions(mesh.positions.iter().map(bump).collect())
    }

    #[test]
    fn a_part_finds_its_place_and_scale() {
        let metric = bumpy();
        let centre = |f: usize| metric.corners(f).iter().map(|p| p.coords.x).sum::<f64>();
        let kept: Vec<usize> =
            (0..metric.topology.faces.len()).filter(|&f| centre(f) < 30.0).collect();
        let part = metric.subset(&kept).0;
        let turned =
            Similarity::new(Vector3::new(3.0, -5.0, 70.0), Vector3::new(0.4, 2.0, -1.0), 0.31);
        let found = part.with_positions(part.positions.iter().map(|p| turned * p).collect());
        let scale = fit_to_mesh(&found, &metric).unwrap();
        assert!((scale.factor * 0.31 - 1.0).abs() < 1e-3, "{}", scale.factor * 0.31);
    }

    #[test]
    fn another_shape_is_refused() {
        // A long thin tube lies on no hemisphere.
        let error = fit_to_mesh(&shapes::tube(24, 80, 60.0), &bumpy()).unwrap_err();
        assert!(matches!(error, ScaleError::NoFit { .. }), "{error}");
    }
}
