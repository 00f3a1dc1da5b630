//! A preoperative surface onto a template: synthetic truth, laws, refusals.

#[path = "common/organ.rs"]
mod organ;

use dsfms::Mesh;
use dsfms::geometry::{Isometry, Point3, Similarity, Vector3};
use dsfms::preoperative::{
    Doubt, LandmarkPair, Preoperative, PreoperativeError, PreoperativeOptions, ScaleRule,
    fit_landmarks, register_preoperative,
};
use organ::{Explored, closed, organ, rms};

fn view() -> Vector3 {
    Vector3::new(0.2, 0.3, 1.0).normalize()
}

fn truth(scale: f64) -> Similarity {
    Similarity::new(Vector3::new(120.0, -40.0, 60.0), Vector3::new(0.7, -1.1, 0.4), scale)
}

fn register(
    template: &Mesh,
    ct: &Mesh,
    landmarks: &[LandmarkPair],
    options: &PreoperativeOptions,
) -> Result<Preoperative, PreoperativeError> {
    register_preoperative((template, &[]), ct, landmarks, options, &|_, _, _| {})
}

fn metric() -> PreoperativeOptions {
    PreoperativeOptions { scale: ScaleRule::Fixed, ..Default::default() }
}

/// Some points inside.
fn tumour() -> Vec<Point3> {
    let place = |k: i32| {
        let t = f64::from(k);
        Point3::new(10.0 + 8.0 * t.sin(), 5.0 + 6.0 * (1.7 * t).cos(), 8.0 + 5.0 * (2.3 * t).sin())
    };
    (0..40).map(place).collect()
}

/// Error of carried points, mm: root mean square.
fn target_error(found: &Preoperative, seen: &Explored, points: &[Point3]) -> f64 {
    let carried = found.carry(points).unwrap();
    let scale = seen.truth.scaling();
    rms(carried.iter().zip(points).map(|(c, p)| (c - seen.now(p)).norm() * scale))
}

#[test]
fn a_part_that_bent_is_found_with_its_scale_in_spite_of_a_wrong_pair() {
    let ct = organ(28, 48);
    let seen = Explored::of(&ct, view(), 6.0, 0.5, truth(9.3));
    let landmarks = seen.landmarks(&ct, 6, 3.0, &[2], 45.0);
    let found = register(&seen.template, &ct, &landmarks, &PreoperativeOptions::default()).unwrap();
    assert_eq!(found.doubts, [Doubt::WrongPairs { names: vec!["L2".into()] }]);
    assert!((found.similarity.scaling() / 9.3 - 1.0).abs() < 0.03);
    let (rigid, bent) = (found.rigid, found.bent.unwrap());
    assert!(rigid.overlap > 0.95 && bent.overlap > 0.95, "{rigid:?} {bent:?}");
    assert!(bent.rms < 0.7 && bent.rms < 0.8 * rigid.rms, "{rigid:?} {bent:?}");
    let points = tumour();
    let error = target_error(&found, &seen, &points);
    let carried = found.carry(&points).unwrap();
    let expected = rms(found.expected(&points, &carried, &seen.template).unwrap().into_iter());
    assert!(error < 2.0 && error < 1.5 * expected && expected < 6.0, "{error} {expected}");
    // Landmarks of 3 mm, each left out of the fit of the others, which have to carry a scale too.
    let left_out = &found.landmarks.as_ref().unwrap().left_out;
    assert_eq!(left_out[2], None);
    let left_out: Vec<f64> = left_out.iter().flatten().copied().collect();
    assert!(left_out.len() == 5 && left_out.iter().all(|e| (0.1..15.0).contains(e)));
}

#[test]
fn without_landmarks_an_organ_without_symmetry_is_found_and_rigid_stays_rigid() {
    let ct = organ(28, 48);
    let seen = Explored::of(&ct, view(), 3.0, 0.5, truth(9.3));
    let options = PreoperativeOptions { deform: false, ..Default::default() };
    let found = register(&seen.template, &ct, &[], &options).unwrap();
    assert!(found.doubts.is_empty(), "{:?}", found.doubts);
    assert!(target_error(&found, &seen, &tumour()) < 2.0);
    assert!(found.bent.is_none() && found.bending == [0.0; 2] && found.landmarks.is_none());
    let back = found.similarity.inverse();
    assert!(ct.positions.iter().zip(&found.vertices).all(|(p, v)| (back * p - v).norm() < 1e-9));
}

#[test]
fn the_result_moves_with_the_surfaces() {
    let ct = organ(22, 36);
    let seen = Explored::of(&ct, view(), 3.0, 0.3, truth(9.3));
    let landmarks = seen.landmarks(&ct, 5, 2.0, &[], 0.0);
    let options = PreoperativeOptions::default();
    let found = register(&seen.template, &ct, &landmarks, &options).unwrap();
    let of_ct = Isometry::new(Vector3::new(-30.0, 12.0, 5.0), Vector3::new(1.1, 0.3, -0.6));
    let of_template =
        Similarity::new(Vector3::new(4.0, 9.0, -2.0), Vector3::new(-0.5, 0.8, 0.2), 3.7);
    let moved_ct = ct.with_positions(ct.positions.iter().map(|p| of_ct * p).collect());
    let positions = seen.template.positions.iter().map(|p| of_template * p).collect();
    let moved_template = seen.template.with_positions(positions);
    let moved = |l: &LandmarkPair| LandmarkPair {
        name: l.name.clone(),
        ct: of_ct * l.ct,
        template: of_template * l.template,
    };
    let pairs: Vec<LandmarkPair> = landmarks.iter().map(moved).collect();
    let again = register(&moved_template, &moved_ct, &pairs, &options).unwrap();
    let scale = again.similarity.scaling();
    let apart =
        found.vertices.iter().zip(&again.vertices).map(|(a, b)| (of_template * a - b).norm());
    let apart = rms(apart) * scale;
    assert!(apart < 0.05, "{apart} mm");
    assert!((scale * 3.7 / found.similarity.scaling() - 1.0).abs() < 1e-3);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let ct = organ(18, 30);
    let seen = Explored::of(&ct, view(), 3.0, 0.3, truth(9.3));
    let landmarks = seen.landmarks(&ct, 4, 2.0, &[], 0.0);
    let options = PreoperativeOptions::default();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| register(&seen.template, &ct, &landmarks, &options)).unwrap()
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.similarity, three.similarity);
    assert_eq!((one.vertices, one.distances), (three.vertices, three.distances));
}

#[test]
fn what_is_round_or_symmetric_is_refused_without_landmarks() {
    let ball = closed(20, 32, |d| d * 40.0);
    let seen = Explored::of(&ball, view(), 0.0, 0.3, truth(1.0));
    let error = register(&seen.template, &ball, &[], &metric()).unwrap_err();
    assert!(matches!(error, PreoperativeError::Slides { motion: "a turn", .. }), "{error}");
    let egg = closed(20, 32, |d| Vector3::new(60.0 * d.x, 40.0 * d.y, 30.0 * d.z));
    let seen = Explored::of(&egg, view(), 0.0, 0.3, truth(1.0));
    let error = register(&seen.template, &egg, &[], &metric()).unwrap_err();
    let PreoperativeError::Ambiguous { others, landmarks: false } = &error else {
        panic!("{error}")
    };
    // An ellipsoid is the same after half a turn.
    assert!(others.iter().any(|o| (o.turn_deg - 180.0).abs() < 5.0), "{others:?}");
    // Landmarks tell which.
    let landmarks = seen.landmarks(&egg, 4, 1.0, &[], 0.0);
    let found = register(&seen.template, &egg, &landmarks, &metric()).unwrap();
    assert!(!found.excluded.is_empty());
    let middle = [Point3::new(5.0, 5.0, 5.0)];
    assert!(target_error(&found, &seen, &middle) < 1.5);
    // On the ball they hold what the surface leaves open, and that is said.
    let seen = Explored::of(&ball, view(), 0.0, 0.3, truth(1.0));
    let landmarks = seen.landmarks(&ball, 5, 1.0, &[], 0.0);
    let found = register(&seen.template, &ball, &landmarks, &metric()).unwrap();
    let held = |d: &Doubt| matches!(d, Doubt::HeldByLandmarks { motion: "a turn", .. });
    assert!(found.doubts.iter().any(held), "{:?}", found.doubts);
}

#[test]
fn another_organ_is_refused() {
    let ct = organ(20, 32);
    let seen = Explored::of(&ct, view(), 0.0, 0.3, truth(1.0));
    let rod = closed(20, 32, |d| Vector3::new(12.0 * d.x, 12.0 * d.y, 90.0 * d.z));
    let error = register(&seen.template, &rod, &[], &metric()).unwrap_err();
    assert!(matches!(error, PreoperativeError::Overlap { .. }), "{error}");
}

#[test]
fn landmarks_that_tell_no_pose_are_refused() {
    let ct = organ(12, 20);
    let seen = Explored::of(&ct, view(), 0.0, 0.0, truth(9.3));
    let good = seen.landmarks(&ct, 5, 1.0, &[], 0.0);
    let fit = |pairs: &[LandmarkPair]| fit_landmarks(pairs, ScaleRule::Free, 4.0, 0);
    assert!(fit(&good).is_ok());
    assert_eq!(fit(&good[..2]), Err(PreoperativeError::TooFewPairs { found: 2 }));
    let on_line = |k: usize| LandmarkPair {
        name: k.to_string(),
        ct: Point3::new(10.0 * k as f64, 0.0, 0.01 * (k % 2) as f64),
        template: Point3::new(k as f64, 1.0, 2.0),
    };
    let line: Vec<LandmarkPair> = (0..4).map(on_line).collect();
    assert_eq!(fit(&line), Err(PreoperativeError::Collinear));
    // The wrong order.
    let mut mixed = good.clone();
    for k in 0..5 {
        mixed[k].template = good[(2 * k + 1) % 5].template;
    }
    let error = fit(&mixed).unwrap_err();
    assert!(matches!(error, PreoperativeError::PairsDisagree { of: 5, .. }), "{error}");
    let none = PreoperativeOptions { max_deformation: f64::NAN, ..Default::default() };
    let error = register(&seen.template, &ct, &[], &none).unwrap_err();
    assert!(error.to_string().contains("max_deformation"), "{error}");
}

#[test]
fn many_landmarks_of_which_a_third_is_wrong() {
    let ct = organ(16, 28);
    let seen = Explored::of(&ct, view(), 0.0, 0.0, truth(9.3));
    let wrong: Vec<usize> = (0..45).filter(|k| k % 3 == 0).collect();
    let pairs = seen.landmarks(&ct, 45, 3.0, &wrong, 60.0);
    let fit = fit_landmarks(&pairs, ScaleRule::Free, 4.0, 7).unwrap();
    assert!((0..45).all(|k| fit.agree[k] != wrong.contains(&k)), "{:?}", fit.agree);
    assert!((fit.similarity.scaling() / 9.3 - 1.0).abs() < 0.05);
    // Held to mm it is as rigid as asked.
    let within = fit_landmarks(&pairs, ScaleRule::Fixed, 4.0, 7);
    assert!(matches!(within, Err(PreoperativeError::PairsDisagree { .. })));
}
