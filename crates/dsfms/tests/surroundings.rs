//! The camera followed on what lies around an organ that is pushed and pulled.

use dsfms::camera::PosedFrame;
use dsfms::geometry::{Isometry, Point3};
use dsfms::image::{Mask, ToneCurve};
use dsfms::pipeline::{CameraSight, template_from_posed_frames};
use dsfms::raster::rasterize;
use dsfms::sfm::{SfmOptions, detect};
use dsfms::synth::ClipOptions;
use dsfms::synth::clip::{Clip, ClipFrame, ClipMoment};
use dsfms::synth::patch;
use dsfms::template::anchor::{AnchorOptions, FeatureView, anchor_features};
use dsfms::template::{LengthUnit, Surroundings};
use dsfms::track::Regions;
use dsfms::{Exploration, Mesh, Method, Silent, Template, TemplateOptions, TrackOptions, Tracker};

/// Exploration frames that are looked at.
const EXPLORED: [usize; 4] = [0, 6, 12, 18];

fn made() -> Clip {
    let options = ClipOptions { frames: 500, size: [640, 360], seed: 4 };
    Clip::new(&patch(400, 4), &options)
}

/// `true` where the organ is not seen.
fn beside_organ(clip: &Clip, moment: &ClipMoment) -> Mask {
    let raster = rasterize(&clip.camera, &clip.rest.topology, &moment.vertices);
    let organ = raster.depth.iter().map(|depth| depth.is_finite()).collect();
    Mask { size: clip.camera.size, data: organ }.dilate(4.0).complement()
}

/// The template of an exploration of known poses, with the wall behind its organ.
fn template(clip: &Clip) -> Template {
    let explored: Vec<(ClipMoment, ClipFrame)> = EXPLORED.map(|i| clip.explore(i)).into();
    let frames: Vec<_> = explored.iter().map(|e| e.1.frame.clone()).collect();
    let poses: Vec<_> = explored.iter().map(|e| Some(e.0.pose)).collect();
    let exploration = Exploration::new(&frames, &clip.camera);
    let (mesh, unit, options) =
        (clip.rest.clone(), LengthUnit::Millimetre, TemplateOptions::default());
    let built =
        template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent).unwrap();
    let found: Vec<_> = explored
        .iter()
        .map(|(moment, shot)| {
            let beside = beside_organ(clip, moment);
            (detect(&shot.frame, Some(&beside), &SfmOptions::default()), beside)
        })
        .collect();
    let views = explored.iter().zip(&found).map(|((moment, shot), (features, beside))| {
        let posed = PosedFrame {
            frame: &shot.frame,
            camera: &clip.camera,
            pose: moment.pose,
            valid: Some(beside),
            organ: None,
        };
        FeatureView { posed, points: &features.points, descriptors: &features.descriptors }
    });
    let wall = clip.wall();
    let features = anchor_features(&wall, &views.collect::<Vec<_>>(), &AnchorOptions::default());
    Template { surroundings: Some(Surroundings { mesh: wall, features }), ..built.template }
}

/// How far a pose puts the organ at rest from where another has it, mm.
fn apart(rest: &Mesh, a: &Isometry, b: &Isometry) -> f64 {
    let all = rest.positions.iter().map(|p: &Point3| (a * p - b * p).norm());
    all.sum::<f64>() / rest.positions.len() as f64
}

/// The camera in frames of the clip, with organ masks or without.
fn followed(
    clip: &Clip,
    template: &Template,
    frames: &[usize],
    options: TrackOptions,
    masks: bool,
) -> Vec<Option<CameraSight>> {
    let tone = ToneCurve::Srgb;
    let mut tracker = Tracker::new(template, &clip.camera, &tone, Method::Dsfm, options).unwrap();
    let next = |&k: &usize| {
        let (moment, shot) = (clip.moment(k), clip.shoot(k, &clip.moment(k)));
        let organ = masks.then(|| beside_organ(clip, &moment).complement());
        let regions =
            Regions { instrument: Some(&shot.instrument), organ: organ.as_ref(), valid: None };
        tracker.next(&shot.frame, regions).unwrap().camera
    };
    frames.iter().map(next).collect()
}

/// The camera is told in most of the frames, and no further off than stated.
fn check(clip: &Clip, frames: &[usize], seen: &[Option<CameraSight>]) {
    let found: Vec<(usize, CameraSight)> =
        frames.iter().zip(seen).filter_map(|(&k, sight)| Some((k, (*sight)?))).collect();
    assert!(5 * found.len() >= 3 * frames.len(), "{} of {}", found.len(), frames.len());
    assert!(seen.last().unwrap().is_some());
    for (k, sight) in &found {
        let off = apart(&clip.rest, &sight.pose, &clip.moment(*k).pose);
        println!("{k}: {off:.3} mm, stated {:.3}, {} places", sight.uncertainty, sight.matches);
        assert!(off < 0.5 && off < 4.0 * sight.uncertainty, "frame {k}: {off} mm, {sight:?}");
    }
}

#[test]
fn the_camera_is_followed_on_the_wall_while_the_organ_deforms() {
    let clip = made();
    let template = template(&clip);
    // The organ is pulled.
    let frames: Vec<usize> = (30..60).collect();
    let largest = clip.moment(59).displacement.into_iter().fold(0.0, f64::max);
    assert!(largest > 1.0, "{largest} mm");
    let on = TrackOptions::default;
    let seen = followed(&clip, &template, &frames, on(), false);
    check(&clip, &frames, &seen);
    assert_eq!(seen[..8], followed(&clip, &template, &frames[..8], on(), false));
    let off = TrackOptions { surroundings: false, ..on() };
    let off = followed(&clip, &template, &frames[..12], off, false);
    assert!(off.iter().all(Option::is_none));
    // A mask says where the organ is: around it the wall is followed all the same.
    let masked = followed(&clip, &template, &frames, on(), true);
    check(&clip, &frames, &masked);
}
