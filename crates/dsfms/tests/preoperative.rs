//! A preoperative surface onto a template: synthetic truth.

#[path = "common/organ.rs"]
mod organ;

use dsfms::Mesh;
use dsfms::geometry::{Isometry, Point3, Similarity, Vector3};
use dsfms::preoperative::{
    Doubt, LandmarkPair, Preoperative, PreoperativeError, PreoperativeOptions, ScaleRule,
    register_preoperative,
};
use organ::{Explored, closed, organ, rms};

fn silent(_: &str, _: usize, _: usize) {}

fn view() -> Vector3 {
    Vector3::new(0.2, 0.3, 1.0).normalize()
}

fn truth(scale: f64) -> Similarity {
    Similarity::new(Vector3::new(120.0, -40.0, 60.0), Vector3::new(0.7, -1.1, 0.4), scale)
}

fn register(
    seen: &Explored,
    ct: &Mesh,
    landmarks: &[LandmarkPair],
    options: &PreoperativeOptions,
) -> Result<Preoperative, PreoperativeError> {
    register_preoperative((&seen.template, &[]), ct, landmarks, options, &silent)
}

/// A tumour of some points inside.
fn tumour() -> Vec<Point3> {
    (0..40)
        .map(|k| {
            let t = f64::from(k);
            Point3::new(
                10.0 + 8.0 * t.sin(),
                5.0 + 6.0 * (1.7 * t).cos(),
                8.0 + 5.0 * (2.3 * t).sin(),
            )
        })
        .collect()
}

/// Error of carried points, mm: root mean square.
fn target_error(found: &Preoperative, seen: &Explored, points: &[Point3]) -> f64 {
    let carried = found.carry(points).unwrap();
    let scale = seen.truth.scaling();
    rms(carried.iter().zip(points).map(|(c, p)| (c - seen.now(p)).norm() * scale))
}

#[test]
fn a_part_that_bent_is_found_with_its_scale_in_spite_of_a_wrong_pair() {
    let ct = organ(32, 56);
    let seen = Explored::of(&ct, view(), 6.0, 0.5, truth(9.3));
    let landmarks = seen.landmarks(&ct, 6, 3.0, &[2], 45.0);
    let options = PreoperativeOptions::default();
    let found = register(&seen, &ct, &landmarks, &options).unwrap();
    let wrong = Doubt::WrongPairs { names: vec!["L2".into()] };
    assert_eq!(found.doubts, [wrong]);
    let rigid = register(&seen, &ct, &landmarks, &PreoperativeOptions { deform: false, ..options });
    let rigid = rigid.unwrap();
    let (bent, unbent) = (found.bent.unwrap(), rigid.rigid);
    println!("scale {} residual {bent:?} of {unbent:?}", found.similarity.scaling() / 9.3);
    println!("condition {}", found.uncertainty.condition);
    let points = tumour();
    let errors = [&found, &rigid].map(|f| target_error(f, &seen, &points));
    let expected = found.expected(&points, &found.carry(&points).unwrap(), &seen.template);
    println!("errors {errors:?} expected {}", rms(expected.into_iter()));
}

#[test]
fn without_landmarks_an_organ_without_symmetry_is_found() {
    let ct = organ(32, 56);
    let seen = Explored::of(&ct, view(), 3.0, 0.5, truth(9.3));
    let found = register(&seen, &ct, &[], &PreoperativeOptions::default());
    match &found {
        Ok(found) => println!(
            "{} {:?} {:?}",
            target_error(found, &seen, &tumour()),
            found.bent,
            found.doubts
        ),
        Err(error) => println!("{error}"),
    }
}

#[test]
fn symmetric() {
    let ball = closed(24, 40, |d| d * 40.0);
    let seen = Explored::of(&ball, view(), 0.0, 0.3, truth(1.0));
    let options = PreoperativeOptions { scale: ScaleRule::Fixed, ..Default::default() };
    println!("{}", register(&seen, &ball, &[], &options).unwrap_err());
    let egg = closed(24, 40, |d| Vector3::new(60.0 * d.x, 40.0 * d.y, 30.0 * d.z));
    let seen = Explored::of(&egg, view(), 0.0, 0.3, truth(1.0));
    println!("{}", register(&seen, &egg, &[], &options).unwrap_err());
    let _ = Isometry::identity();
}
