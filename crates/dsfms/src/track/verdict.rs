//! Whether a tracked surface can be believed.

use super::{Surface, TrackStatus};
use crate::geometry::{Point3, align_rigid_robust};
use crate::mesh::Mesh;
use serde::{Deserialize, Serialize};

/// When a surface is believed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VerdictOptions {
    /// Fewest kept matches: below the first the frame is lost, below the second degraded.
    pub matches: [usize; 2],
    /// Least agreement of the frame with the template's look at the surface, likewise.
    pub agreement: [f64; 2],
    /// Least share of the matches that the surface explains; below, degraded.
    pub kept: f64,
    /// Largest median residual, px; above, degraded.
    pub residual_px: f64,
    /// Largest photometric residual, in medians of the good frames before; above, degraded: through
    /// smoke, out of focus or beside new glare, shading misleads.
    pub photometric: f64,
    /// Largest uncertainty of the depth, of the visible radius: two and a half times that of a
    /// surface which a rigid pose explains; above, degraded.
    pub depth: f64,
    /// Largest change of length that an edge in twenty exceeds, relative to rest: above the first
    /// degraded, above the second lost.
    pub strain: [f64; 2],
    /// Largest root mean square change of shape from one frame to the next, of the visible radius;
    /// above, degraded.
    pub jump: f64,
    /// Correlation from which a place agrees.
    pub correlation: f64,
}

impl Default for VerdictOptions {
    fn default() -> Self {
        Self {
            matches: [12, 30],
            agreement: [0.25, 0.5],
            kept: 0.5,
            residual_px: 2.5,
            photometric: 2.5,
            depth: 0.1,
            strain: [0.3, 0.8],
            jump: 0.15,
            correlation: 0.5,
        }
    }
}

/// Judge a surface; `before` is that of the frame before, where there is one, `usual` the photometric
/// residual of good frames, where it is known.
pub fn judge(
    rest: &Mesh,
    surface: &Surface,
    before: Option<&[Point3]>,
    usual: Option<f64>,
    options: &VerdictOptions,
) -> (TrackStatus, Vec<String>) {
    let mut verdict = (TrackStatus::Ok, Vec::new());
    let mut object = |status: TrackStatus, reason: String| {
        if verdict.0 != TrackStatus::Lost {
            verdict.0 = status;
        }
        verdict.1.push(reason);
    };
    let grade = |lost: bool| if lost { TrackStatus::Lost } else { TrackStatus::Degraded };
    if !surface.vertices.iter().all(|v| v.iter().all(|c| c.is_finite())) {
        object(TrackStatus::Lost, "some vertices are not finite".into());
    }
    let kept = surface.matches_kept();
    let total = surface.matches.len();
    if kept < options.matches[1] {
        object(grade(kept < options.matches[0]), format!("only {kept} matches carry the surface"));
    }
    if (kept as f64) < options.kept * total as f64 {
        let reason = format!("only {kept} of {total} matches agree with the surface");
        object(TrackStatus::Degraded, reason);
    }
    if surface.places < options.matches[1] {
        let places = surface.places;
        let reason = format!("only {places} textured places of the template can be compared");
        object(grade(places < options.matches[0]), reason);
    } else if surface.agreement < options.agreement[1] {
        let percent = 100.0 * surface.agreement;
        let reason = format!("only {percent:.0} % of the surface looks like the template");
        object(grade(surface.agreement < options.agreement[0]), reason);
    }
    if surface.residual_px > options.residual_px {
        let reason = format!("median residual {:.1} px", surface.residual_px);
        object(TrackStatus::Degraded, reason);
    }
    match (surface.photometric, usual) {
        (Some(residual), Some(usual)) if residual > options.photometric * usual => {
            let times = residual / usual;
            let reason =
                format!("brightness {times:.1} times as far off as usual (smoke, blur, glare?)");
            object(TrackStatus::Degraded, reason);
        }
        (None, Some(_)) => {
            object(TrackStatus::Degraded, "nothing could be used for shading".into());
        }
        _ => {}
    }
    if surface.depth_uncertainty > options.depth {
        let percent = 100.0 * surface.depth_uncertainty;
        let reason = format!(
            "bent so far from any rigid pose that depth is uncertain by {percent:.0} % of the radius"
        );
        object(TrackStatus::Degraded, reason);
    }
    let strain = strain(rest, &surface.vertices);
    let over = |limit: f64| strain.is_nan() || strain > limit;
    if over(options.strain[0]) {
        let reason = format!("edges change their length by {:.0} %", 100.0 * strain);
        object(grade(over(options.strain[1])), reason);
    }
    if let Some(jump) = before.and_then(|before| jump(rest, before, &surface.vertices))
        && jump > options.jump
    {
        let reason = format!("the shape jumped by {:.0} % of its radius", 100.0 * jump);
        object(TrackStatus::Degraded, reason);
    }
    verdict
}

/// Relative change of length that one edge in twenty exceeds.
fn strain(rest: &Mesh, shape: &[Point3]) -> f64 {
    let length = |x: &[Point3], e: &[u32; 2]| (x[e[0] as usize] - x[e[1] as usize]).norm();
    let edges = rest.topology.edges.iter();
    let mut changes: Vec<f64> =
        edges.map(|e| (length(shape, e) / length(&rest.positions, e) - 1.0).abs()).collect();
    let place = changes.len() * 19 / 20;
    if changes.is_empty() { 0.0 } else { *changes.select_nth_unstable_by(place, f64::total_cmp).1 }
}

/// Root mean square distance between two shapes after the best rigid motion, of the radius of a disc
/// of the organ's area.
fn jump(rest: &Mesh, before: &[Point3], now: &[Point3]) -> Option<f64> {
    let motion = align_rigid_robust(before, now)?;
    let squares = before.iter().zip(now).map(|(a, b)| (motion * a - b).norm_squared());
    let rms = (squares.sum::<f64>() / now.len().max(1) as f64).sqrt();
    let area: f64 = rest.face_areas().iter().sum();
    Some(rms / (area / std::f64::consts::PI).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Isometry, Point2};
    use crate::register::Match;
    use crate::synth::patch;
    use crate::track::Way;

    fn surface(mesh: &Mesh, kept: usize, agreement: f64) -> Surface {
        let m = Match { face: 0, barycentric: [1.0, 0.0, 0.0], pixel: Point2::origin() };
        Surface {
            vertices: mesh.positions.clone(),
            visible: vec![true; mesh.positions.len()],
            pose: Isometry::identity(),
            matches: (0..100).map(|i| (m, i < kept)).collect(),
            residual_px: 0.5,
            reprojection_px: 0.6,
            photometric: Some(0.03),
            depth_uncertainty: 0.04,
            agreement,
            places: 100,
            way: Way::Followed,
        }
    }

    #[test]
    fn each_doubt_has_its_reason() {
        let mesh = patch(100, 1).mesh;
        let options = VerdictOptions::default();
        let of = |s: &Surface| judge(&mesh, s, Some(&mesh.positions), Some(0.02), &options);
        let unshaded = |s: &Surface| judge(&mesh, s, Some(&mesh.positions), None, &options);
        assert_eq!(of(&surface(&mesh, 90, 0.9)), (TrackStatus::Ok, vec![]));
        let (status, reasons) = of(&surface(&mesh, 40, 0.9));
        assert!(status == TrackStatus::Degraded && reasons[0].contains("40 of 100"));
        assert_eq!(of(&surface(&mesh, 90, 0.4)).0, TrackStatus::Degraded);
        assert_eq!(of(&surface(&mesh, 90, 0.1)).0, TrackStatus::Lost);
        assert_eq!(of(&surface(&mesh, 5, 0.4)).0, TrackStatus::Lost);
        let lit = |photometric| Surface { photometric, ..surface(&mesh, 90, 0.9) };
        assert_eq!(of(&lit(Some(0.04))).0, TrackStatus::Ok);
        let (status, reasons) = of(&lit(Some(0.06)));
        assert!(status == TrackStatus::Degraded && reasons[0].contains("3.0 times"), "{reasons:?}");
        assert_eq!(of(&lit(None)).0, TrackStatus::Degraded);
        assert_eq!(unshaded(&lit(None)).0, TrackStatus::Ok);
        let bent = Surface { depth_uncertainty: 0.2, ..surface(&mesh, 90, 0.9) };
        assert!(of(&bent).1[0].contains("20 %"));
        let mut stretched = surface(&mesh, 90, 0.9);
        stretched.vertices.iter_mut().for_each(|v| *v *= 1.5);
        let (status, reasons) = of(&stretched);
        assert!(status == TrackStatus::Degraded && reasons[0].contains("50 %"), "{reasons:?}");
        assert!(reasons[1].contains("jumped"), "{reasons:?}");
        stretched.vertices[0].x = f64::NAN;
        assert_eq!(of(&stretched).0, TrackStatus::Lost);
    }
}
