//! The expected error of a vertex: unit, growth, flags, determinism, and the bound that nine of ten
//! stay below.

use dsfms::expected_error::{ExpectedErrors, Model, Solved, expected_errors, features};
use dsfms::geometry::Point3;
use dsfms::light::{Coated, LightModel};
use dsfms::mesh::Mesh;
use dsfms::mesh::paths::shortest_paths;
use dsfms::pipeline::{Method, Observation, ReconstructOptions, Reconstruction, reconstruct};
use dsfms::refine::{Photograph, RefineOptions};
use dsfms::register::{Match, Scene};
use dsfms::synth::{Case, CaseOptions, Cell, Draw, Protocol};

fn case() -> Case {
    let protocol = Protocol { vertices: 150, ..Default::default() };
    protocol.case(Cell { extension: 10.0, noise: 1.0 }, 0)
}

/// The rest shape of a case in place of a result, all lengths multiplied by `scale`.
fn judged(case: &Case, keep: impl Fn(&Match) -> bool, scale: f64, model: Model) -> ExpectedErrors {
    judged_by(case, keep, scale, model, &RefineOptions::default())
}

fn judged_by(
    case: &Case,
    keep: impl Fn(&Match) -> bool,
    scale: f64,
    model: Model,
    refine: &RefineOptions,
) -> ExpectedErrors {
    let scaled = |x: &[Point3]| x.iter().map(|p| p * scale).collect::<Vec<_>>();
    let rest =
        Mesh { positions: scaled(&case.template.mesh.positions), ..case.template.mesh.clone() };
    let vertices = scaled(&case.truth);
    let scene = Scene::new(&case.camera, &rest, vertices.clone());
    let matches: Vec<_> = case.matches.iter().map(|m| (*m, keep(m))).collect();
    let picture = dsfms::image::Picture::of(&case.frame, &case.template.tone);
    let usable = dsfms::image::Mask::filled(case.frame.size, true);
    let albedo = case.template.albedo.clone().unwrap();
    let photo = Photograph {
        camera: &case.camera,
        picture: &picture,
        usable: &usable,
        outline: None,
        light: &Coated::default(),
        albedo: &albedo,
        exposure: None,
    };
    let photo = (model != Model::Motion).then_some(&photo);
    let visible = &case.visible;
    expected_errors(
        &Solved { scene: &scene, vertices: &vertices, visible, matches: &matches, photo, refine },
        model,
    )
}

#[test]
fn the_error_has_the_unit_of_the_surface() {
    let case = case();
    let mm = judged(&case, |_| true, 1.0, Model::Joint);
    let cm = judged(&case, |_| true, 0.1, Model::Joint);
    assert_eq!(mm.observed, cm.observed);
    for (mm, cm) in mm.errors.iter().zip(&cm.errors) {
        assert!((mm - 10.0 * cm).abs() < 1e-6 * mm, "{mm} mm, {cm} cm");
    }
}

#[test]
fn it_looks_at_the_brightness_that_the_options_let_in() {
    let case = case();
    // Nothing faces the camera so squarely: no brightness counts, and far from the matches nothing
    // tells.
    let mut nothing = RefineOptions::default();
    nothing.image.grazing = 2.0;
    let left = |m: &Match| {
        let face = case.template.mesh.topology.faces[m.face as usize];
        case.template.mesh.positions[face[0] as usize].x < -8.0
    };
    let count = |c: &ExpectedErrors| c.observed.iter().filter(|seen| **seen).count();
    let with = count(&judged(&case, left, 1.0, Model::Joint));
    let without = count(&judged_by(&case, left, 1.0, Model::Joint, &nothing));
    assert!(0 < without && without < with, "{without} of {with} vertices");
}

#[test]
fn it_grows_with_the_distance_from_evidence() {
    for model in Model::ALL {
        assert!(model.weights()[1..].iter().all(|&w| w >= 0.0));
    }
    let case = case();
    let left = |m: &Match| {
        let face = case.template.mesh.topology.faces[m.face as usize];
        case.template.mesh.positions[face[0] as usize].x < -8.0
    };
    let found = judged(&case, left, 1.0, Model::Motion);
    let all = judged(&case, |_| true, 1.0, Model::Motion);
    let faces = case.matches.iter().filter(|m| left(m)).map(|m| m.face as usize);
    let sources: Vec<u32> = faces.flat_map(|f| case.template.mesh.topology.faces[f]).collect();
    let mesh = &case.template.mesh;
    let away = shortest_paths(&mesh.topology, &mesh.edge_lengths(), &sources).distance;
    // Times the error with all matches: what else tells of a vertex is the same with both.
    let mean = |from: f64, to: f64| {
        let inside: Vec<usize> =
            (0..away.len()).filter(|&v| (from..to).contains(&away[v])).collect();
        inside.iter().map(|&v| found.errors[v] / all.errors[v]).sum::<f64>() / inside.len() as f64
    };
    let steps = [mean(0.0, 5.0), mean(8.0, 14.0), mean(20.0, 30.0)];
    assert!(steps[1] > 1.1 * steps[0] && steps[2] > 1.1 * steps[1], "{steps:?}");
    let radius = (2000.0 / std::f64::consts::PI).sqrt();
    for (v, &far) in away.iter().enumerate() {
        if far > 1.2 * features::REACH * radius || !case.visible[v] {
            assert!(!found.observed[v], "vertex {v} at {far} mm");
        } else if far < 0.8 * features::REACH * radius {
            assert!(found.observed[v], "vertex {v} at {far} mm");
        }
    }
}

#[test]
fn without_any_evidence_it_stays_finite() {
    let mut case = case();
    case.visible.fill(false);
    let found = judged(&case, |_| false, 1.0, Model::Motion);
    assert!(found.observed.iter().all(|o| !o));
    assert!(found.errors.iter().all(|e| e.is_finite() && *e > 1.0));
}

#[test]
fn the_same_on_any_number_of_threads() {
    let case = case();
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| judged(&case, |_| true, 1.0, Model::Shading))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn a_wrong_shape_is_expected_to_be_worse() {
    let options = CaseOptions {
        vertices: 150,
        extension: 0.15,
        light: LightModel::Collinear,
        draw: Draw { count: 25, sigma_px: 1.0 },
        pull: true,
    };
    let case = Case::new(&options, 3);
    let right = judged(&case, |_| true, 1.0, Model::Shading);
    let mut wrong = case.clone();
    // The surface waves by a millimetre, which the image does not show.
    wrong.truth.iter_mut().for_each(|p| p.z += (0.6 * p.x).sin());
    let wrong = judged(&wrong, |_| true, 1.0, Model::Shading);
    let mean = |c: &ExpectedErrors| c.errors.iter().sum::<f64>();
    assert!(mean(&wrong) > 1.1 * mean(&right), "{} {}", mean(&wrong), mean(&right));
}

/// The true error over the expected one of every visible vertex, on cases that nothing was fitted
/// on.
fn true_over_expected(method: Method, bound: Option<f64>) -> Vec<f64> {
    let protocol = Protocol { vertices: 150, seed: 77, ..Default::default() };
    let case = |i: usize| protocol.case(Cell { extension: 5.0 * (i % 4) as f64, noise: 1.0 }, i);
    let ratios = (0..8).map(case).flat_map(|case| {
        let seen = Observation::new(&case.frame, &case.camera).matches(&case.matches);
        let options = ReconstructOptions::default();
        let found = reconstruct(&case.template, &seen, method, &options);
        let found = Reconstruction::even_refused(found).unwrap();
        assert_eq!(found.error_bound, bound, "{method:?}");
        let expected = found.expected_error.unwrap_or_default();
        let error = |v: usize| (found.vertices[v] - case.truth[v]).norm() / expected[v];
        (0..expected.len()).filter(|&v| case.visible[v]).map(error).collect::<Vec<_>>()
    });
    ratios.collect()
}

#[test]
fn about_nine_errors_of_ten_stay_below_the_bound() {
    for (method, model) in [(Method::Dsfm, Model::MotionSeen), (Method::Joint, Model::Joint)] {
        let ratios = true_over_expected(method, Some(model.bound()));
        let below =
            |most: f64| ratios.iter().filter(|r| **r < most).count() as f64 / ratios.len() as f64;
        let [tight, share] = [below(0.5 * model.bound()), below(model.bound())];
        // 0.95 and 0.93 are measured, 0.77 and 0.69 below half of the bound: these patches are
        // easier than what the bound is fitted on, and it is that of zones for eq. 3.
        assert!(share > 0.8, "{method:?}: {share} below the bound");
        // A bound that everything stays below would say nothing.
        assert!(tight < 0.85, "{method:?}: {tight} below half of the bound");
    }
    assert!(true_over_expected(Method::Rigid, None).is_empty());
}

#[test]
fn the_bound_is_one_number_of_the_model_without_a_unit() {
    let case = case();
    for model in Model::ALL {
        let [mm, cm] = [1.0, 0.1].map(|scale| judged(&case, |_| true, scale, model).bound);
        assert!(mm == model.bound() && cm == mm && mm > 1.0, "{model:?}: {mm}, {cm}");
    }
}
