//! A small clip of known truth: a moving camera, a growing push, a black frame and a cut; smoke,
//! blur and an organ that leaves the view.

use dsfms::camera::PosedFrame;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::image::{Frame, Mask, ToneCurve};
use dsfms::light::LightModel;
use dsfms::pipeline::{Method, Observation, ReconstructOptions, reconstruct};
use dsfms::register::find::Search;
use dsfms::sfm::{SfmOptions, detect};
use dsfms::synth::{LightKind, RenderOptions, render};
use dsfms::template::anchor::{AnchorOptions, FeatureView, anchor_features};
use dsfms::track::{Origin, TrackOptions, TrackStatus, Tracked, Tracker};
use dsfms::verdict::{Reason, Region};

#[path = "common/clip.rs"]
mod clip;

use clip::{Clip, clip};

fn track(clip: &Clip) -> Vec<Tracked> {
    let tone = ToneCurve::Srgb;
    let options = TrackOptions::default();
    let mut tracker =
        Tracker::new(&clip.template, &clip.camera, &tone, Method::Dsfm, options).unwrap();
    clip.frames.iter().map(|f| tracker.next(f, None).unwrap()).collect()
}

#[test]
fn black_and_cut_are_survived_and_no_wrong_surface_is_ok() {
    let clip = clip();
    let tracked = track(&clip);
    let status: Vec<TrackStatus> = tracked.iter().map(|t| t.status).collect();
    let reasons: Vec<_> = tracked.iter().map(|t| &t.reasons).collect();
    assert_eq!(status[4], TrackStatus::Lost);
    assert!(tracked[4].surface.is_none() && matches!(tracked[4].reasons[0], Reason::Black { .. }));
    let good = status.iter().filter(|s| **s == TrackStatus::Ok).count();
    assert!(good >= 7, "{status:?} {reasons:?}");
    let way = |k: usize| tracked[k].surface.as_ref().map(|s| s.origin);
    assert_eq!((way(0), way(1)), (Some(Origin::Found), Some(Origin::Followed)));
    assert!(way(6).is_some(), "not found after the cut: {reasons:?}");
    let error = |k: usize| -> Option<f64> {
        let (found, truth) = (tracked[k].surface.as_ref()?, clip.truth[k].as_ref()?);
        let squares = found.vertices.iter().zip(truth).map(|(a, b)| (a - b).norm_squared());
        Some((squares.sum::<f64>() / truth.len() as f64).sqrt())
    };
    let mut errors: Vec<f64> = (0..9).filter_map(error).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    assert!(median < 0.5, "{errors:?} mm");
    for k in (0..9).filter(|&k| status[k] == TrackStatus::Ok) {
        assert!(error(k).unwrap() < 2.0 * median, "frame {k}: {errors:?} mm");
    }
}

/// Largest distance of two tracked clips' surfaces, the second's divided by `unit`; every frame of
/// both has one.
fn apart(a: &[Tracked], b: &[Tracked], unit: f64) -> f64 {
    let surfaces =
        a.iter().zip(b).map(|(a, b)| [a, b].map(|t| &t.surface.as_ref().unwrap().vertices));
    let distances = surfaces.flat_map(|[a, b]| a.iter().zip(b).map(|(a, b)| (a - b / unit).norm()));
    distances.fold(0.0, f64::max)
}

/// By how much the surfaces of one clip may differ, mm, where other matches are kept; found are
/// 0.27 and 0.34.
const SAME: f64 = 0.5;

#[test]
fn unit_and_axes_of_the_template_say_nothing() {
    let mut clip = clip();
    clip.frames.truncate(4);
    let found = joint(&clip, 1);
    let rest = clip.template.mesh.clone();
    let moved = |by: &dyn Fn(&Point3) -> Point3| {
        rest.with_positions(rest.positions.iter().map(by).collect())
    };
    clip.template.mesh = moved(&|p| p * 8.0);
    assert!(apart(&found, &joint(&clip, 1), 8.0) < 1e-6);
    let motion = Isometry::new(Vector3::new(30.0, -5.0, 8.0), Vector3::new(0.4, -1.0, 2.0));
    clip.template.mesh = moved(&|p| motion * p);
    let apart = apart(&found, &joint(&clip, 1), 1.0);
    assert!(apart < SAME, "{apart} mm");
}

#[test]
fn another_exposure_of_the_whole_clip_says_nothing() {
    let mut clip = clip();
    clip.frames.truncate(4);
    let found = joint(&clip, 1);
    for frame in &mut clip.frames {
        let darker = |v: u8| (f64::from(v) * 0.85).round() as u8;
        frame.rgb.iter_mut().for_each(|rgb| *rgb = rgb.map(darker));
    }
    let apart = apart(&found, &joint(&clip, 1), 1.0);
    assert!(apart < SAME, "{apart} mm");
}

#[test]
fn another_organ_is_never_good() {
    let mut clip = clip();
    // The template's look no longer belongs to its shape: descriptors and albedo disagree.
    if let Some(albedo) = &mut clip.template.albedo {
        albedo.value.reverse();
    }
    clip.frames.truncate(3);
    assert!(track(&clip).iter().all(|t| t.status != TrackStatus::Ok));
}

fn joint(clip: &Clip, threads: usize) -> Vec<Tracked> {
    joint_by(TrackOptions::default(), clip, threads)
}

fn joint_by(options: TrackOptions, clip: &Clip, threads: usize) -> Vec<Tracked> {
    tracked_by(Method::Joint, options, clip, threads)
}

fn tracked_by(
    method: Method,
    mut options: TrackOptions,
    clip: &Clip,
    threads: usize,
) -> Vec<Tracked> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    // The frames bend one way; what the first might be mistaken for is another test's.
    options.reconstruct.joint.mirrors = 0;
    let (template, camera, tone) = (&clip.template, &clip.camera, ToneCurve::Srgb);
    pool.install(|| {
        let mut tracker = Tracker::new(template, camera, &tone, method, options).unwrap();
        clip.frames.iter().map(|f| tracker.next(f, None).unwrap()).collect()
    })
}

#[test]
fn joint_from_the_last_shape_is_as_good_as_alone_survives_black_and_ignores_threads() {
    let mut clip = clip();
    clip.frames.truncate(6);
    let (one, two) = (joint(&clip, 1), joint(&clip, 2));
    let shapes = |all: &[Tracked]| -> Vec<Option<Vec<Point3>>> {
        all.iter().map(|t| t.surface.as_ref().map(|s| s.vertices.clone())).collect()
    };
    assert!(shapes(&one) == shapes(&two), "threads change the bits");
    let error = |k: usize, shape: &[Point3]| error(&clip, k, shape);
    let surface = |k: usize| one[k].surface.as_ref().unwrap();
    assert_eq!(surface(3).origin, Origin::Followed);
    assert!(surface(3).photometric.is_some_and(|r| r < 0.1));
    // The last before the black frame, and the first after it.
    for k in [3, 5] {
        let last = clip.frames[k].clone();
        let alone = Clip { frames: vec![last], ..clip_of(&clip) };
        let alone = joint(&alone, 2);
        let (warm, cold) = (
            error(k, &surface(k).vertices),
            error(k, &alone[0].surface.as_ref().unwrap().vertices),
        );
        assert!(warm < 1.2 * cold + 0.05, "frame {k}: {warm:.3} mm, alone {cold:.3} mm");
    }
    assert_eq!(one[4].status, TrackStatus::Lost);
}

/// A frame that is searched, one that is followed, and a black one.
#[test]
fn one_two_and_four_threads_track_to_the_same_bits() {
    let mut clip = clip();
    clip.frames.truncate(2);
    clip.frames
        .push(Frame { rgb: vec![[2; 3]; clip.frames[0].rgb.len()], ..clip.frames[0].clone() });
    for method in [Method::Dsfm, Method::Joint] {
        let on = |threads: usize| -> Vec<String> {
            let tracked = tracked_by(method, TrackOptions::default(), &clip, threads);
            tracked.iter().map(bits).collect()
        };
        let one = on(1);
        for threads in [2, 4] {
            assert!(one == on(threads), "{method:?}: {threads} threads give other bits");
        }
    }
}

/// All that a frame is told to be, but for the times it took; the text of a float is exact.
fn bits(tracked: &Tracked) -> String {
    format!("{:?} {:?} {:?}", tracked.status, tracked.reasons, tracked.surface)
}

/// Nothing but the matches holds the distance of motion alone: a shape that is held to its own last
/// one drifts.
#[test]
fn motion_alone_does_not_drift_off_in_depth() {
    let mut clip = clip();
    // Motion alone does not look at brightness, whatever a light could tell of distance.
    clip.template.light = Some(LightKind::Near.model());
    let there_and_back = [0, 1, 2, 3, 2, 1];
    clip.frames =
        there_and_back.repeat(8).iter().map(|&k: &usize| clip.frames[k].clone()).collect();
    let tracked = track(&clip);
    let errors: Vec<f64> = tracked
        .iter()
        .zip(there_and_back.repeat(8))
        .map(|(t, k)| error(&clip, k, &t.surface.as_ref().unwrap().vertices))
        .collect();
    let worst = |errors: &[f64]| errors.iter().copied().fold(0.0, f64::max);
    let [first, last] = [worst(&errors[..6]), worst(&errors[42..])];
    assert!(last < 1.5 * first + 0.05, "{first:.3} mm at first, {last:.3} mm at last");
}

/// Root mean square distance from the truth of a frame, mm.
fn error(clip: &Clip, frame: usize, shape: &[Point3]) -> f64 {
    let truth = clip.truth[frame].as_ref().unwrap();
    let squares = shape.iter().zip(truth).map(|(a, b)| (a - b).norm_squared());
    (squares.sum::<f64>() / truth.len() as f64).sqrt()
}

#[test]
fn a_brief_search_and_the_frames_after_it_are_nearly_as_good_as_the_solve_of_single_frames() {
    let mut clip = clip();
    clip.frames.truncate(4);
    let options = TrackOptions { awake: false, ..TrackOptions::realtime() };
    assert!(options.brief_search);
    let (brief, whole) = (joint_by(options, &clip, 2), joint(&clip, 2));
    for (k, (brief, whole)) in brief.iter().zip(&whole).enumerate() {
        let [brief, whole] =
            [brief, whole].map(|t| error(&clip, k, &t.surface.as_ref().unwrap().vertices));
        assert!(brief < 1.3 * whole + 0.05, "frame {k}: {brief:.3} mm, whole {whole:.3} mm");
    }
}

/// The frame through smoke that is denser to the right.
fn veiled(frame: &Frame) -> Frame {
    let width = frame.size[0];
    let veil = |(i, p): (usize, &[u8; 3])| {
        let dense = 0.2 + 0.4 * (i % width) as f64 / width as f64;
        p.map(|v| (f64::from(v) * (1.0 - dense) + 170.0 * dense) as u8)
    };
    Frame { rgb: frame.rgb.iter().enumerate().map(veil).collect(), ..frame.clone() }
}

/// The mean of the frame moved sideways by up to so many pixels.
fn smeared(frame: &Frame, by: usize) -> Frame {
    let mean = |i: usize| {
        let row = &frame.rgb[i.saturating_sub(by)..(i + by + 1).min(frame.rgb.len())];
        [0, 1, 2].map(|c| (row.iter().map(|p| usize::from(p[c])).sum::<usize>() / row.len()) as u8)
    };
    Frame { rgb: (0..frame.rgb.len()).map(mean).collect(), ..frame.clone() }
}

/// The frame turned away until a corner of the organ is left, on a dim background.
fn turned_away(frame: &Frame) -> Frame {
    let [w, h] = frame.size;
    let at = |i: usize| match (i % w + w * 7 / 10, i / w + h * 7 / 10) {
        (x, y) if x < w && y < h => frame.rgb[y * w + x],
        _ => [20, 12, 10],
    };
    Frame { rgb: (0..w * h).map(at).collect(), ..frame.clone() }
}

#[test]
fn smoke_and_blur_are_told_and_an_organ_out_of_view_is_lost_and_found() {
    let clip = clip();
    let good = &clip.frames[1];
    // So many tell what is usual.
    let mut frames = vec![good.clone(); 4];
    frames.extend([veiled(good), smeared(good, 6), turned_away(good), good.clone()]);
    let clip = Clip { frames, ..clip_of(&clip) };
    let found = joint(&clip, 2);
    let told: Vec<_> = found.iter().map(|t| (t.status, &t.reasons)).collect();
    assert!(told[..4].iter().all(|t| t.0 == TrackStatus::Ok), "{told:?}");
    for k in [4, 5] {
        let veil = |r: &Reason| matches!(r, Reason::Brightness { .. } | Reason::Faint { .. });
        assert!(told[k].0 != TrackStatus::Ok, "frame {k}: {told:?}");
        assert!(told[k].1.iter().any(veil), "frame {k}: {told:?}");
    }
    assert_eq!(told[6].0, TrackStatus::Lost, "{told:?}");
    assert_eq!(told[7].0, TrackStatus::Ok, "{told:?}");
}

#[test]
fn what_covers_a_part_is_named_with_its_vertices_and_another_camera_is_never_good() {
    let clip = clip();
    let good = &clip.frames[1];
    let [w, h] = good.size;
    let covered = |(i, p): (usize, &[u8; 3])| {
        let off = (i % w).abs_diff(w / 2).pow(2) + (i / w).abs_diff(h / 2).pow(2);
        if off < (h / 4).pow(2) { [120; 3] } else { *p }
    };
    let rgb = good.rgb.iter().enumerate().map(covered).collect();
    let frames = vec![good.clone(), Frame { rgb, ..good.clone() }];
    let mut clip = Clip { frames, ..clip_of(&clip) };
    let found = joint(&clip, 2);
    let part = |r: &Reason| matches!(r, Reason::RegionContradicted(_));
    assert_eq!(found[0].status, TrackStatus::Ok, "{:?}", found[0].reasons);
    assert!(found[1].reasons.iter().any(part), "{:?}", found[1].reasons);
    let regions = &found[1].surface.as_ref().unwrap().regions;
    assert!(regions.contains(&Region::Contradicted));
    clip.template.camera = Some(clip.camera.clone());
    clip.camera.focal = clip.camera.focal.map(|f| 1.3 * f);
    clip.frames.truncate(1);
    let told = &joint(&clip, 2)[0];
    let camera = |r: &Reason| {
        matches!(r, Reason::CameraContradicted { .. } | Reason::CameraUnconfirmed { .. })
    };
    assert!(told.reasons.iter().any(camera), "{:?}", told.reasons);
}

/// Camera, template and truth of a clip.
fn clip_of(clip: &Clip) -> Clip {
    let (camera, template) = (clip.camera.clone(), clip.template.clone());
    Clip { camera, template, frames: Vec::new(), truth: clip.truth.clone() }
}

/// The patch with its tissue strewn with white spots, pale between them, in a picture that is
/// exposed so that the spots are as white as highlights: it turns in the image back and forth while
/// it moves.
fn pale_clip() -> Clip {
    let mut clip = clip();
    let mut albedo = clip.template.albedo.clone().unwrap();
    for value in &mut albedo.value {
        *value = value.map(|v| 0.45 + 0.5 * v);
    }
    for face in (0..albedo.resolution.len()).step_by(2) {
        let centres: Vec<[f64; 3]> = albedo.centres(face).collect();
        let at = albedo.offset[face] as usize;
        for (k, b) in centres.iter().enumerate() {
            if b.iter().all(|&c| c > 0.22) {
                albedo.value[at + k] = [1.6; 3];
            }
        }
    }
    let rest = clip.template.mesh.clone();
    let shape = |k: usize| {
        let turn = [0.0, 0.12, 0.3, 0.1, -0.15, 0.05][k];
        let shift = Vector3::new(1.5 * k as f64 - 3.0, 1.0 - 0.8 * k as f64, 75.0);
        let pose = Isometry::new(shift, Vector3::new(0.0, 0.05 * k as f64, turn));
        rest.with_positions(rest.positions.iter().map(|p| pose * p).collect())
    };
    let seen = |k: usize| {
        let options = RenderOptions { gain: 1.0, seed: k as u64, ..Default::default() };
        render(&clip.camera, &LightModel::Collinear, &shape(k), &albedo, &options)
    };
    let first = seen(0);
    let found = detect(&first, None, &SfmOptions::default());
    let (points, descriptors) = (&found.points[..], &found.descriptors[..]);
    let pose = Isometry::new(Vector3::new(-3.0, 1.0, 75.0), Vector3::zeros());
    let posed = PosedFrame::new(&first, &clip.camera, pose);
    let view = FeatureView { posed, points, descriptors };
    clip.template.features = Some(anchor_features(&rest, &[view], &AnchorOptions::default()));
    clip.frames = (0..6).map(seen).collect();
    // What is white in every frame is never observed, as in an exploration.
    for (value, views) in albedo.value.iter().zip(&mut albedo.views) {
        *views = u16::from(value[0] < 1.5) * (*views).max(1);
    }
    clip.truth = (0..6).map(|k| Some(shape(k).positions)).collect();
    clip.template.albedo = Some(albedo);
    clip
}

#[test]
fn matches_found_again_about_the_shape_are_no_fewer() {
    let clip = pale_clip();
    let frame = Observation::new(&clip.frames[5], &clip.camera);
    let kept = |look_again: usize| {
        let mut options = ReconstructOptions::default();
        options.joint.look_again = look_again;
        let found = reconstruct(&clip.template, &frame, Method::Joint, &options).unwrap();
        let off: Vec<f64> = (found.vertices.iter().zip(clip.truth[5].as_ref().unwrap()))
            .map(|(v, truth)| (v - truth).norm())
            .collect();
        let kept = found.matches.iter().filter(|m| m.1).count();
        (kept, off.iter().sum::<f64>() / off.len() as f64)
    };
    let [once, again] = [0, 2].map(kept);
    assert!(again.0 >= once.0, "{again:?} matches and mm, {once:?} without");
    assert!(again.1 < 0.2 && once.1 < 0.2, "{again:?} matches and mm, {once:?} without");
}

#[test]
fn a_followed_frame_has_no_fewer_matches_than_a_fresh_look() {
    let clip = pale_clip();
    let usable = Mask::filled(clip.camera.size, true);
    let features = clip.template.features.as_ref().unwrap();
    let (camera, rest) = (&clip.camera, &clip.template.mesh);
    let register = TrackOptions::default().reconstruct.register;
    let search = Search::new(rest, features);
    let fresh = |frame| {
        let seen = detect(frame, Some(&usable), &SfmOptions::default());
        search.matches(camera, &seen, &register, 0).map_or(0, |m| m.len())
    };
    let tracked = track(&clip);
    let figures: Vec<_> = (tracked.iter().zip(&clip.frames))
        .map(|(t, frame)| {
            let surface = t.surface.as_ref();
            let kept = surface.map_or(0, dsfms::track::Surface::matches_kept);
            (t.status, surface.map(|s| s.origin), kept, fresh(frame))
        })
        .collect();
    println!("{figures:?}");
    for (k, (status, origin, kept, fresh)) in figures.iter().enumerate().skip(1) {
        assert_ne!(*status, TrackStatus::Lost, "frame {k}: {figures:?}");
        assert!(k > 2 || *origin == Some(Origin::Followed), "frame {k}: {figures:?}");
        assert!(*fresh >= 60 && 10 * kept >= 9 * fresh, "frame {k}: {figures:?}");
    }
}
