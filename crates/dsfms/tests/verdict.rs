//! Nothing wrong is shown as good: degenerate matches, covered frames, another camera.

use dsfms::camera::{Camera, CameraModel};
use dsfms::geometry::{Isometry, Point2, point_at};
use dsfms::image::Frame;
use dsfms::light::LightModel;
use dsfms::pipeline::{
    Exploration, Method, Observation, ReconstructError, ReconstructOptions, Reconstruction, Silent,
    TemplateOptions, reconstruct, template_from_posed_frames,
};
use dsfms::register::Match;
use dsfms::synth::{Case, CaseOptions, Draw};
use dsfms::template::LengthUnit;
use dsfms::verdict::{Level, Reason, Region};

fn case(count: usize) -> Case {
    let options = CaseOptions {
        vertices: 300,
        extension: 0.03,
        light: LightModel::Collinear,
        draw: Draw { count, sigma_px: 0.5 },
        pull: true,
    };
    Case::new(&options, 41)
}

struct Given<'a> {
    frame: &'a Frame,
    camera: &'a CameraModel,
    matches: &'a [Match],
}

fn solved(
    case: &Case,
    given: Given,
    method: Method,
) -> Result<Reconstruction, (Level, Vec<Reason>)> {
    let observation = Observation::new(given.frame, given.camera).matches(given.matches);
    match reconstruct(&case.template, &observation, method, &ReconstructOptions::default()) {
        Ok(found) if found.verdict.level == Level::Ok => Ok(found),
        Ok(found) => Err((found.verdict.level, found.verdict.reasons)),
        Err(ReconstructError::Refused(found)) => Err((found.verdict.level, found.verdict.reasons)),
        Err(error) => Err((Level::Lost, vec![Reason::NoSurface { why: error.to_string().into() }])),
    }
}

fn with_matches(case: &Case, matches: &[Match], method: Method) -> Option<(Level, Vec<Reason>)> {
    solved(case, Given { frame: &case.frame, camera: &case.camera, matches }, method).err()
}

/// Exact matches of the true surface whose pixel is wanted.
fn true_matches(case: &Case, wanted: impl Fn(&Point2) -> bool) -> Vec<Match> {
    let faces = &case.template.mesh.topology.faces;
    let barycentric = [1.0 / 3.0; 3];
    (0..faces.len())
        .filter(|&f| faces[f].iter().all(|&v| case.visible[v as usize]))
        .filter_map(|f| {
            let point = point_at(faces[f].map(|v| &case.truth[v as usize]), barycentric);
            let pixel = case.camera.project(&point)?.pixel;
            wanted(&pixel).then_some(Match { face: f as u32, barycentric, pixel })
        })
        .collect()
}

#[test]
fn an_undisturbed_case_is_good() {
    let case = case(60);
    for method in [Method::Rigid, Method::Dsfm, Method::Joint] {
        let given = Given { frame: &case.frame, camera: &case.camera, matches: &case.matches };
        let found = solved(&case, given, method);
        if method == Method::Joint {
            let found = found.unwrap();
            assert_eq!(found.regions.len(), case.truth.len());
            let seen = found.regions.iter().filter(|r| **r != Region::Hidden).count();
            let observed = found.regions.iter().filter(|r| **r == Region::Observed).count();
            assert!(observed * 10 > seen * 8, "{observed} of {seen}");
        }
    }
}

#[test]
fn given_matches_that_the_surface_leaves_aside_are_told() {
    let case = case(60);
    let mut matches = case.matches.clone();
    // To either side, so that no surface goes with them, and by too little to be thrown out as
    // wrong.
    for (i, m) in matches.iter_mut().enumerate().filter(|(i, _)| i % 5 < 2) {
        m.pixel.x += if i % 2 == 0 { 11.0 } else { -11.0 };
    }
    let given = Given { frame: &case.frame, camera: &case.camera, matches: &matches };
    let (level, reasons) = solved(&case, given, Method::Joint).err().unwrap();
    assert_eq!(level, Level::Degraded);
    let told = |r: &Reason| matches!(r, Reason::MatchesDisagree { .. });
    assert!(reasons.iter().any(told), "{reasons:?}");
}

/// The inputs of the review that found surfaces metres away shown as `ok`.
#[test]
fn degenerate_matches_are_never_good() {
    let case = case(60);
    let on_a_line = |(i, m): (usize, &Match)| Match {
        pixel: Point2::new(50.0 + i as f64, 50.0 + i as f64),
        ..*m
    };
    let line: Vec<Match> = case.matches.iter().take(25).enumerate().map(on_a_line).collect();
    let four: Vec<Match> = (0..500).map(|i| case.matches[13 * (i % 4)]).collect();
    let centre = Point2::new(360.0, 288.0);
    let small = true_matches(&case, |p| (p - centre).norm() < 45.0);
    assert!(small.len() >= 8, "{}", small.len());
    for (name, matches) in [("line", line), ("four", four), ("small", small)] {
        for method in [Method::Rigid, Method::Dsfm, Method::Joint] {
            let doubt = with_matches(&case, &matches, method);
            let (_, reasons) = doubt.unwrap_or_else(|| panic!("{name} {method:?} is ok"));
            assert!(!reasons.is_empty());
        }
    }
}

/// Exact matches in a narrow band of the frame can hold a pose: an organ is no plane. What is `ok`
/// then is right.
#[test]
fn true_matches_in_a_band_are_good_where_the_surface_is() {
    let case = case(60);
    let band = true_matches(&case, |p| (p.y - 288.0).abs() < 6.0);
    assert!(band.len() >= 8, "{}", band.len());
    let zone = |matches: &[Match], method| {
        let given = Given { frame: &case.frame, camera: &case.camera, matches };
        solved(&case, given, method).map(|found| case.zone_rms(&found.vertices))
    };
    let whole = true_matches(&case, |_| true);
    for method in [Method::Dsfm, Method::Joint] {
        let usual = zone(&whole, method).unwrap();
        if let Ok(error) = zone(&band, method) {
            assert!(error < 3.0 * usual, "{method:?}: {error:.2} mm, usually {usual:.2}");
        }
    }
}

#[test]
fn a_covered_frame_names_what_it_covers() {
    let case = case(60);
    let size = case.frame.size;
    for part in [0.5, 0.7] {
        for colour in [[120, 120, 120], [18, 12, 12]] {
            let mut frame = case.frame.clone();
            for y in ((1.0 - part) * size[1] as f64) as usize..size[1] {
                frame.rgb[y * size[0]..(y + 1) * size[0]].fill(colour);
            }
            let given = Given { frame: &frame, camera: &case.camera, matches: &case.matches };
            let (_, reasons) = solved(&case, given, Method::Joint).err().unwrap();
            let region = |r: &Reason| {
                matches!(
                    r,
                    Reason::RegionContradicted(_)
                        | Reason::RegionUnobserved(_)
                        | Reason::Covered { .. }
                        | Reason::Uncompared { .. }
                        | Reason::NoShading
                )
            };
            assert!(reasons.iter().any(region), "{part} {colour:?} {reasons:?}");
        }
    }
}

#[test]
fn another_camera_is_refused_where_the_matches_contradict_it() {
    let case = case(60);
    let mut camera = case.camera.clone();
    camera.focal = camera.focal.map(|f| 1.5 * f);
    let matches = true_matches(&case, |_| true);
    let given = Given { frame: &case.frame, camera: &camera, matches: &matches };
    let (_, reasons) = solved(&case, given, Method::Dsfm).err().unwrap();
    let named = |r: &Reason| {
        matches!(r, Reason::CameraContradicted { .. } | Reason::CameraUnconfirmed { .. })
    };
    assert!(reasons.iter().any(named), "{reasons:?}");
}

/// Nothing but the look of the frames tells that a given mesh does not lie where given poses say.
#[test]
fn frames_do_not_look_like_a_template_of_wrong_poses() {
    let case = Case::example(1);
    let (frames, poses) = case.explore(4);
    let exploration = Exploration::new(&frames, &case.camera).light(case.template.light.as_ref());
    let options = TemplateOptions::default();
    let unlike = |change: &dyn Fn(Isometry) -> Isometry| {
        let poses: Vec<_> = poses.iter().map(|pose| Some(change(*pose))).collect();
        let (mesh, unit) = (case.template.mesh.clone(), LengthUnit::Millimetre);
        let built = template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent);
        built.unwrap().template.usual.unwrap().unlike()
    };
    assert_eq!(unlike(&|pose| pose), None);
    assert!(unlike(&|pose| Isometry::translation(10.0, 0.0, 0.0) * pose).is_some());
    let transposed =
        |pose: Isometry| Isometry::from_parts(pose.translation, pose.rotation.inverse());
    assert!(unlike(&transposed).is_some());
}
