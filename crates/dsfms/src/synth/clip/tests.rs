use super::*;
use crate::synth::patch;

fn clip(seed: u64) -> Clip {
    Clip::new(&patch(150, seed), &ClipOptions { frames: 100, size: [160, 90], seed })
}

#[test]
fn shape_and_camera_move_smoothly_except_at_the_cut() {
    let clip = clip(3);
    let step = |k: usize| -> f64 {
        let (a, b) = (clip.moment(k - 1).vertices, clip.moment(k).vertices);
        a.iter().zip(&b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    let cut = clip.script.cut;
    let largest = (1..100).filter(|&k| k != cut).map(step).fold(0.0, f64::max);
    assert!(largest < 3.0, "{largest} mm");
    assert!(step(cut) > 2.0 * largest, "{} against {largest} mm", step(cut));
}

#[test]
fn what_is_promised_happens() {
    let clip = clip(4);
    let events = clip.script.events(100);
    for kind in [
        EventKind::Pull,
        EventKind::Push,
        EventKind::Tool,
        EventKind::Pass,
        EventKind::Occlusion,
        EventKind::Cut,
        EventKind::Exposure,
    ] {
        assert!(events.iter().any(|e| e.event == kind), "{kind:?}");
    }
    let dark = events.iter().find(|e| e.event == EventKind::Occlusion).unwrap();
    assert_eq!(dark.last + 1 - dark.first, 10);
    let covered = clip.moment(dark.first);
    assert!(clip.shoot(dark.first, &covered).visible.iter().all(|v| !v));
    let largest = |k| clip.moment(k).displacement.into_iter().fold(0.0, f64::max);
    let peak = (0..100).map(largest).fold(0.0, f64::max);
    assert!((1.0..8.0).contains(&peak), "{peak} mm");
    assert_eq!(largest(0), 0.0);
    let gains: Vec<f64> = (0..100).map(|k| clip.script.gain(k)).collect();
    let span = gains.iter().fold([f64::MAX, 0.0], |[l, h]: [f64; 2], &g| [l.min(g), h.max(g)]);
    assert!(span[1] / span[0] > 1.5, "{span:?}");
}

#[test]
fn a_frame_is_a_function_of_seed_and_number() {
    let first = clip(5).shoot(12, &clip(5).moment(12));
    let again = clip(5);
    let other_first = again.shoot(13, &again.moment(13));
    let again = again.shoot(12, &again.moment(12));
    assert_eq!(first.frame.rgb, again.frame.rgb);
    assert_ne!(first.frame.rgb, other_first.frame.rgb);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let alone = one.install(|| clip(5).shoot(12, &clip(5).moment(12)));
    assert_eq!(first.frame.rgb, alone.frame.rgb);
    assert!(first.visible.iter().filter(|v| **v).count() > 100);
}

#[test]
fn an_instrument_hides_what_it_covers() {
    let clip = clip(6);
    let tool = clip.script.events(100).into_iter().find(|e| e.event == EventKind::Tool).unwrap();
    let middle = (tool.first + tool.last) / 2;
    let moment = clip.moment(middle);
    let shot = clip.shoot(middle, &moment);
    assert!(shot.instrument.coverage() > 0.01, "{}", shot.instrument.coverage());
    for (v, p) in moment.vertices.iter().enumerate() {
        use crate::camera::Camera;
        let Some(seen) = clip.camera.project(p) else { continue };
        let [x, y] = [seen.pixel.x.round(), seen.pixel.y.round()];
        // Well inside the instrument nothing is seen.
        let inside = (-2..=2).all(|d: i32| {
            let at = crate::geometry::Point2::new(x + f64::from(d), y + f64::from(d));
            shot.instrument.at_pixel(&at)
        });
        assert!(!(inside && shot.visible[v]), "vertex {v}");
    }
}
