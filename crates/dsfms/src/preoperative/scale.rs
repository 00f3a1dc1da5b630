//! The scale of a reconstruction from a metric surface of the same organ, of which it may be a
//! part: that of the similarity which lays it there.

use super::align::{Residual, Schedule};
use super::ambiguity::alternatives;
use super::options::{PreoperativeOptions, ScaleRule};
use super::starts::{StartSearch, search};
use super::target::{Target, extent, samples};
use crate::mesh::{Mesh, Topology};
use crate::template::scale::{Scale, ScaleError};

/// Points of the reconstruction that are laid on the metric surface.
const SAMPLES: usize = 1500;
/// What is this share of the size away may still be drawn to the surface at first.
const WIDE: f64 = 0.3;
/// Misfit, of the size of the reconstruction, above which it is another shape.
const MAX_MISFIT: f64 = 0.05;
/// Scales of poses that fit as well may differ by so much.
const SAME: f64 = 0.05;

/// Millimetres per unit of `found`, from `metric` (mm, any place, outward orientation; it may show
/// more of the organ).
///
/// # Errors
/// Surfaces that do not fit each other, or at more than one scale.
#[doc(alias = "ICP")]
pub(crate) fn scale_on_surface(found: &Mesh, metric: &Mesh) -> Result<Scale, ScaleError> {
    let options = PreoperativeOptions { scale: ScaleRule::Free, ..Default::default() };
    let found = &within_rim(found);
    let points = samples(found, SAMPLES);
    let (_, size) = extent(points.iter().map(|s| &s.point));
    let schedule = Schedule {
        cut: [WIDE * size, 3.0 * options.noise * size],
        landmark_sigma: options.landmark_sigma,
        scale: options.scale,
        steps: 30,
    };
    let how = StartSearch { landmarks: &[], schedule, step: &|_, _| () };
    let poses = search(found, &Target::new(metric), &points, &how);
    let best = poses.first().ok_or(ScaleError::NoFit { misfit: 1.0 })?;
    let factor = best.similarity.scaling();
    let placed = Residual::of(&best.distances, best.cut * factor);
    let misfit = placed.rms / (size * factor);
    if placed.overlap < options.min_overlap || misfit > MAX_MISFIT {
        return Err(ScaleError::NoFit { misfit });
    }
    let mut others = alternatives(best, &poses, &points, &[], options.landmark_sigma).into_iter();
    match others.find(|o| o.scale.ln().abs() > SAME) {
        Some(other) => Err(ScaleError::TwoScales { ratio: other.scale }),
        None => Ok(Scale { factor, each: vec![factor] }),
    }
}

/// Without the faces at its boundary, where a reconstruction bends towards what lies behind; as it
/// is where those are most of it.
fn within_rim(mesh: &Mesh) -> Mesh {
    let Topology { faces, boundary, .. } = &*mesh.topology;
    let inner = |f: &usize| !faces[*f].iter().any(|&v| boundary[v as usize]);
    let kept: Vec<usize> = (0..faces.len()).filter(inner).collect();
    if 2 * kept.len() > faces.len() { mesh.subset(&kept).0 } else { mesh.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Point3, Similarity, Vector3};
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
        let scale = scale_on_surface(&found, &metric).unwrap();
        assert!((scale.factor * 0.31 - 1.0).abs() < 1e-3, "{}", scale.factor * 0.31);
    }

    #[test]
    fn a_shape_that_fits_at_two_scales_is_refused() {
        let metric = shapes::irregular_sheet(20);
        let part = metric.with_positions(metric.positions.iter().map(|p| p * 0.2).collect());
        let error = scale_on_surface(&part, &metric).unwrap_err();
        assert!(matches!(error, ScaleError::TwoScales { .. }), "{error}");
    }

    #[test]
    fn another_shape_is_refused() {
        // A long thin tube lies on no hemisphere.
        let error = scale_on_surface(&shapes::tube(24, 80, 60.0), &bumpy()).unwrap_err();
        assert!(matches!(error, ScaleError::NoFit { .. }), "{error}");
    }
}
