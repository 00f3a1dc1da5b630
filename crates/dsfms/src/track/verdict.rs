//! What a tracked surface is judged by.

use super::Surface;
use crate::camera::CameraModel;
use crate::geometry::Point3;
use crate::image::diagonal;
use crate::mesh::Mesh;
use crate::verdict::observability::distinct;
use crate::verdict::strain::{jump, strain};
use crate::verdict::{Evidence, MatchCount};

/// Gather the evidence; `before` is the surface of the frame before, where there is one, `usual` the
/// photometric residual of good frames, where it is known.
pub(super) fn evidence(
    rest: &Mesh,
    camera: &CameraModel,
    surface: &Surface,
    before: Option<&[Point3]>,
    usual: Option<f64>,
) -> Evidence {
    let diagonal = diagonal(camera.size);
    let all: Vec<_> = surface.matches.iter().map(|m| m.0).collect();
    let kept: Vec<_> = surface.matches.iter().filter(|m| m.1).map(|m| m.0).collect();
    let places = (surface.agreement * surface.places as f64).round() as usize;
    Evidence {
        finite: surface.vertices.iter().all(|v| v.iter().all(|c| c.is_finite())),
        matches: MatchCount {
            total: all.len(),
            kept: kept.len(),
            distinct: distinct(&all, diagonal).len(),
            distinct_kept: distinct(&kept, diagonal).len(),
            given: false,
        },
        residual_px: Some(surface.residual_px),
        depth_uncertainty: Some(surface.depth_uncertainty),
        places: Some([places, surface.places]),
        photometric: surface.photometric.zip(usual).map(|(residual, usual)| residual / usual),
        no_shading: surface.photometric.is_none() && usual.is_some(),
        strain: Some(strain(rest, &surface.vertices)),
        jump: before.and_then(|before| jump(rest, before, &surface.vertices)),
        ..Evidence::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;
    use crate::geometry::{Isometry, Point2};
    use crate::register::Match;
    use crate::synth::patch;
    use crate::track::Way;
    use crate::verdict::{Level, Reason, Thresholds, judge};

    fn surface(mesh: &Mesh, kept: usize, agreement: f64) -> Surface {
        let m = |i: usize| {
            let pixel = Point2::new(20.0 * (i % 10) as f64, 20.0 * (i / 10) as f64);
            Match { face: 0, barycentric: [1.0, 0.0, 0.0], pixel }
        };
        Surface {
            vertices: mesh.positions.clone(),
            visible: vec![true; mesh.positions.len()],
            pose: Isometry::identity(),
            matches: (0..100).map(|i| (m(i), i < kept)).collect(),
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
        let (size, lens) = ([720, 576], Lens::Pinhole);
        let camera = CameraModel { size, focal: [750.0; 2], centre: [359.5, 287.5], lens };
        let by = |s: &Surface, usual| {
            let found = evidence(&mesh, &camera, s, Some(&mesh.positions), usual);
            judge(&found, &Thresholds::default())
        };
        let of = |s: &Surface| by(s, Some(0.02));
        assert_eq!(of(&surface(&mesh, 90, 0.9)).reasons, []);
        let found = of(&surface(&mesh, 40, 0.9));
        assert_eq!(found.reasons, [Reason::MatchesDisagree { kept: 40, total: 100 }]);
        assert_eq!(of(&surface(&mesh, 90, 0.4)).level, Level::Degraded);
        assert_eq!(of(&surface(&mesh, 90, 0.1)).level, Level::Lost);
        assert_eq!(of(&surface(&mesh, 5, 0.4)).level, Level::Lost);
        let lit = |photometric| Surface { photometric, ..surface(&mesh, 90, 0.9) };
        assert_eq!(of(&lit(Some(0.04))).level, Level::Ok);
        assert!(matches!(of(&lit(Some(0.06))).reasons[..], [Reason::Brightness { .. }]));
        assert_eq!(of(&lit(None)).level, Level::Degraded);
        assert_eq!(by(&lit(None), None).level, Level::Ok);
        let bent = Surface { depth_uncertainty: 0.2, ..surface(&mesh, 90, 0.9) };
        assert!(matches!(of(&bent).reasons[..], [Reason::DepthUncertain { .. }]));
        let mut stretched = surface(&mesh, 90, 0.9);
        stretched.vertices.iter_mut().for_each(|v| *v *= 1.5);
        let found = of(&stretched);
        assert!(
            matches!(found.reasons[..], [Reason::Strain { .. }, Reason::Jump { .. }]),
            "{found:?}"
        );
        stretched.vertices[0].x = f64::NAN;
        assert_eq!(of(&stretched).level, Level::Lost);
    }
}
