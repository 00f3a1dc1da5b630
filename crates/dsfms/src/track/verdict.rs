//! What a tracked surface is judged by.

use super::Surface;
use crate::camera::CameraModel;
use crate::geometry::Point3;
use crate::image::diagonal;
use crate::mesh::Mesh;
use crate::template::usual::Appearance;
use crate::verdict::evidence::EXPECTED;
use crate::verdict::observability::distinct;
use crate::verdict::regions::{largest_part, share};
use crate::verdict::strain::{jump, strain};
use crate::verdict::{Evidence, MatchCount, Region};

/// What is known beside a surface itself.
#[derive(Default)]
pub(super) struct Known<'a> {
    /// The surface of the previous frame, where there is one.
    pub before: Option<&'a [Point3]>,
    /// The photometric residual of good frames before, where it is known.
    pub residual: Option<f64>,
    /// See [`crate::verdict::intrinsics::other_camera`].
    pub camera: Option<(f64, [f64; 2])>,
    /// Image beside prediction.
    pub appearance: Option<Appearance>,
    /// The same of the exploration frames.
    pub usual: Option<Appearance>,
    /// Number of faces that are folded over.
    pub folds: usize,
}

/// Gather the evidence.
pub(super) fn evidence(
    rest: &Mesh,
    camera: &CameraModel,
    surface: &Surface,
    known: &Known,
) -> Evidence {
    let (shape, diagonal) = (&surface.vertices, diagonal(camera.size));
    let finite = shape.iter().all(|v| v.iter().all(|c| c.is_finite()));
    if !finite {
        return Evidence { finite, ..Evidence::default() };
    }
    let all: Vec<_> = surface.matches.iter().map(|m| m.0).collect();
    let kept: Vec<_> = surface.matches.iter().filter(|m| m.1).map(|m| m.0).collect();
    let places = (surface.agreement * surface.places as f64).round() as usize;
    let folded = || (known.folds, share(rest, &surface.regions, Region::Folded));
    Evidence {
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
        camera: known.camera,
        appearance: known.appearance,
        usual: known.usual.unwrap_or(EXPECTED),
        photometric: surface.photometric.zip(known.residual).map(|(own, usual)| own / usual),
        no_shading: surface.photometric.is_none() && known.residual.is_some(),
        contradicted: largest_part(rest, camera, shape, &surface.regions, Region::Contradicted),
        folded: (known.folds > 0).then(folded),
        strain: Some(strain(rest, shape)),
        jump: known.before.and_then(|before| jump(rest, before, shape)),
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
    use crate::track::Origin;
    use crate::verdict::{Level, Reason, Thresholds, judge};

    fn surface(mesh: &Mesh, kept: usize, agreement: f64) -> Surface {
        let m = |i: usize| {
            let pixel = Point2::new(20.0 * (i % 10) as f64, 20.0 * (i / 10) as f64);
            Match { face: 0, barycentric: [1.0, 0.0, 0.0], pixel }
        };
        Surface {
            vertices: mesh.positions.clone(),
            visible: vec![true; mesh.positions.len()],
            regions: vec![Region::Observed; mesh.positions.len()],
            pose: Isometry::identity(),
            matches: (0..100).map(|i| (m(i), i < kept)).collect(),
            residual_px: 0.5,
            reprojection_px: 0.6,
            photometric: Some(0.03),
            depth_uncertainty: 0.04,
            agreement,
            places: 100,
            origin: Origin::Followed,
        }
    }

    #[test]
    fn each_doubt_has_its_reason() {
        let mesh = patch(100, 1).mesh;
        let (size, lens) = ([720, 576], Lens::Pinhole);
        let camera = CameraModel { size, focal: [750.0; 2], centre: [359.5, 287.5], lens };
        let by = |s: &Surface, residual, appearance| {
            let before = Some(mesh.positions.as_slice());
            let known = Known { before, residual, appearance, ..Known::default() };
            judge(&evidence(&mesh, &camera, s, &known), &Thresholds::default())
        };
        let of = |s: &Surface| by(s, Some(0.02), Some(EXPECTED));
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
        assert_eq!(by(&lit(None), None, None).level, Level::Ok);
        let faint = Some(Appearance { contrast: Some(0.3), ..EXPECTED });
        let found = by(&surface(&mesh, 90, 0.9), Some(0.02), faint);
        assert!(matches!(found.reasons[..], [Reason::Faint { .. }]), "{found:?}");
        let mut covered = surface(&mesh, 90, 0.9);
        covered.regions[..20].fill(Region::Contradicted);
        assert!(matches!(of(&covered).reasons[..], [Reason::RegionContradicted(_)]));
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
