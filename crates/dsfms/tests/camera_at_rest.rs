//! Tissue that stretches before a camera at rest.

use dsfms::camera::CameraModel;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::image::{Frame, ToneCurve};
use dsfms::pipeline::{ReconstructError, template_from_posed_frames};
use dsfms::register::{CameraMotion, Match, RegisterError};
use dsfms::synth::{Case, Draw, Random, correspond, patch};
use dsfms::template::{LengthUnit, TemplateView};
use dsfms::track::TrackStatus;
use dsfms::verdict::Reason;
use dsfms::{
    Exploration, Method, Observation, ReconstructOptions, Silent, Template, TemplateOptions,
    TrackOptions, Tracker, reconstruct,
};

/// An organ seen once, whose surface then stretches by 3 % from `fixed` (x, mm) on and rises a
/// little.
struct Beat {
    camera: CameraModel,
    template: Template,
    /// Vertices in camera axes.
    truth: Vec<Point3>,
    matches: Vec<Match>,
}

/// Where the camera stands.
fn view() -> Isometry {
    Isometry::new(Vector3::new(2.0, -1.0, 70.0), Vector3::new(0.15, -0.2, 0.05))
}

/// `lift`: by how much it rises, mm; `moved`: what the camera does afterwards.
fn beat(fixed: f64, lift: f64, moved: Isometry) -> Beat {
    let camera = CameraModel::pinhole([640, 480], [600.0; 2], [319.5, 239.5]);
    let mesh = patch(600, 3).mesh;
    let at = |p: &Point3| {
        let grown =
            if p.x > fixed { Vector3::new(p.x - fixed, p.y, 0.0) * 0.03 } else { Vector3::zeros() };
        let lift = lift * (-((p.x - 10.0).powi(2) + p.y * p.y) / 150.0).exp();
        moved * (view() * (p + grown - Vector3::z() * lift))
    };
    let truth: Vec<Point3> = mesh.positions.iter().map(at).collect();
    let draw = Draw { count: 120, sigma_px: 0.5 };
    let all = vec![true; truth.len()];
    let matches = correspond(&camera, &mesh, &truth, &all, draw, &mut Random::new(1, 2));
    let view = TemplateView {
        name: "first".into(),
        camera_from_template: view(),
        gain: 1.0,
        reprojection_px: 0.0,
    };
    let template = Template { mesh, albedo: None, views: vec![view], ..Case::example(1).template };
    Beat { camera, template, truth, matches }
}

impl Beat {
    /// Mean distance from the truth, mm.
    fn error(&self, shape: &[Point3]) -> f64 {
        let off: f64 = shape.iter().zip(&self.truth).map(|(a, b)| (a - b).norm()).sum();
        off / self.truth.len() as f64
    }

    /// Mean error of eq. 3, and the share of vertices within the stated bound.
    fn solved(&self, motion: CameraMotion) -> Result<(f64, f64), ReconstructError> {
        let size = self.camera.size;
        let frame = Frame { name: "grey".into(), size, rgb: vec![[90; 3]; size[0] * size[1]] };
        let observation = Observation::new(&frame, &self.camera).matches(&self.matches);
        let mut options = ReconstructOptions::default();
        options.register.camera_motion = motion;
        let found = reconstruct(&self.template, &observation, Method::Dsfm, &options)?;
        let (stated, bound) = (found.expected_error.unwrap(), found.error_bound.unwrap());
        let pairs = found.vertices.iter().zip(&self.truth).zip(&stated);
        let within = pairs.filter(|((a, b), e)| (*a - *b).norm() <= bound * **e).count();
        Ok((self.error(&found.vertices), within as f64 / stated.len() as f64))
    }
}

#[test]
fn a_stretch_before_a_camera_at_rest_is_no_change_of_distance() {
    for (fixed, lift) in [-40.0, -10.0, 0.0].map(|x| [(x, 0.6), (x, 3.0)]).concat() {
        let beat = beat(fixed, lift, Isometry::identity());
        let still: Vec<Point3> = beat.template.mesh.positions.iter().map(|p| view() * p).collect();
        let nothing = beat.error(&still);
        let (moving, covered) = beat.solved(CameraMotion::Moving).unwrap();
        let (rest, within) = beat.solved(CameraMotion::AtRest).unwrap();
        println!(
            "from {fixed}, rise {lift}: rest shape {nothing:.2}, moving {moving:.2} ({covered:.2} within the bound), \
             at rest {rest:.2} mm ({within:.2})"
        );
        if lift > 1.0 {
            // A rise towards the camera hardly shows in the matches of one view.
            assert!(rest < nothing && rest < 0.5 * moving, "{nothing} {moving} {rest}");
            continue;
        }
        assert!(rest < 0.7 * nothing && rest < 0.3 * moving, "{nothing} {moving} {rest}");
        assert!(within >= 0.8, "{within}");
        // Where all moves, a single frame does not tell that the camera stands.
        let (auto, _) = beat.solved(CameraMotion::Auto).unwrap();
        assert_eq!(auto, if fixed < -25.0 { moving } else { rest });
    }
}

#[test]
fn a_camera_that_moved_is_not_taken_to_stand() {
    let gone = Isometry::new(Vector3::new(3.0, 1.0, 4.0), Vector3::new(0.02, 0.05, 0.0));
    let beat = beat(0.0, 0.6, gone);
    let moving = beat.solved(CameraMotion::Moving).unwrap();
    assert_eq!(beat.solved(CameraMotion::Auto).unwrap(), moving);
    let error = beat.solved(CameraMotion::AtRest).unwrap_err();
    let ReconstructError::Register(RegisterError::NoView { views: 1, found: 120, .. }) = error
    else {
        panic!("{error}")
    };
}

/// Shifts, retreats, rolls and a turn about the organ: the pose that the matches give is off
/// because tissue stretches, that of the view because the camera has moved, and which is nearer is
/// found from the matches.
#[test]
fn a_camera_that_hardly_moves_is_posed_no_worse_than_by_its_matches() {
    let moves = [
        ("0", [0.0; 3], [0.0; 3]),
        ("0.1 mm aside", [0.1, 0.0, 0.0], [0.0; 3]),
        ("1 mm aside", [1.0, 0.0, 0.0], [0.0; 3]),
        ("0.3 mm back", [0.0, 0.0, 0.3], [0.0; 3]),
        ("1 mm back", [0.0, 0.0, 1.0], [0.0; 3]),
        ("3 mm back", [0.0, 0.0, 3.0], [0.0; 3]),
        ("1 degree of roll", [0.0; 3], [0.0, 0.0, 0.02]),
        ("2 degrees about the organ", [-2.4, 0.0, 0.04], [0.0, 0.035, 0.0]),
    ];
    for (fixed, lift) in [(-10.0, 0.6), (0.0, 3.0), (8.0, 0.6)] {
        println!("stretched from {fixed} mm, rise {lift} mm; mean error, mm");
        for (name, shift, turn) in moves {
            let beat = beat(fixed, lift, Isometry::new(Vector3::from(shift), Vector3::from(turn)));
            let [moving, auto, rest] =
                [CameraMotion::Moving, CameraMotion::Auto, CameraMotion::AtRest]
                    .map(|motion| beat.solved(motion).unwrap().0);
            println!("  {name:<26} moving {moving:.2}, auto {auto:.2}, at rest {rest:.2}");
            assert!(auto <= 1.05 * moving, "{name}: {auto} {moving}");
        }
    }
}

#[test]
fn a_tracker_is_told_where_its_camera_stands() {
    let case = Case::example(1);
    let (frames, poses) = case.explore(2);
    let poses: Vec<_> = poses.into_iter().map(Some).collect();
    let exploration = Exploration::new(&frames, &case.camera);
    let (mesh, unit) = (case.template.mesh.clone(), LengthUnit::Millimetre);
    let options = TemplateOptions::default();
    let template =
        template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent).unwrap();
    let tone = ToneCurve::Srgb;
    let mut options = TrackOptions::default();
    options.reconstruct.register.camera_motion = CameraMotion::AtRest;
    let template = &template.template;
    let mut tracker = Tracker::new(template, &case.camera, &tone, Method::Dsfm, options).unwrap();
    // The case is seen from elsewhere than its exploration.
    let tracked = tracker.next(&case.frame, None).unwrap();
    assert_eq!(tracked.status, TrackStatus::Lost);
    let [Reason::NoSurface { why }] = &tracked.reasons[..] else { panic!("{:?}", tracked.reasons) };
    assert!(why.to_string().contains("said to be at rest"), "{why}");
    // From a view of the exploration the surface is where that view has it.
    let tracked = tracker.next(&frames[0], None).unwrap();
    let surface = tracked.surface.unwrap();
    assert_eq!(surface.pose, template.views[0].camera_from_template);
}
