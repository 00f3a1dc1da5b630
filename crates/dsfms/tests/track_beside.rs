//! Searches on a thread of their own.

#[path = "common/clip.rs"]
mod clip;

use clip::{Clip, clip};
use dsfms::image::ToneCurve;
use dsfms::pipeline::Method;
use dsfms::track::{Origin, TrackOptions, TrackStatus, Tracked, Tracker};
use dsfms::verdict::{NoSurface, Reason};

/// Frames of the clip, searched on another thread; `true` where the answer to a question is taken,
/// and waited for.
fn searched_beside(clip: &Clip, method: Method, frames: &[(usize, bool)]) -> Vec<Tracked> {
    let options = TrackOptions { search_beside: true, patience: 1, ..TrackOptions::default() };
    let mut tracker =
        Tracker::new(&clip.template, &clip.camera, &ToneCurve::Srgb, method, options).unwrap();
    let searcher = tracker.searcher().unwrap();
    let mut preparation = tracker.preparation();
    std::thread::scope(|scope| {
        scope.spawn(move || searcher.run());
        let mut tracker = tracker;
        let next = |&(k, answered): &(usize, bool)| {
            let prepared = preparation.prepare(clip.frames[k].clone(), None).unwrap();
            tracker.solve_again(&prepared, answered)
        };
        frames.iter().map(next).collect()
    })
}

/// Frame 4 is black; of the searches in the first and in 2 the answers are taken in the frames
/// after them.
const BLACK: [(usize, bool); 5] = [(0, false), (1, true), (4, false), (2, false), (3, true)];

#[test]
fn a_late_answer_is_followed_into_the_frame_at_hand() {
    let clip = clip();
    let tracked = searched_beside(&clip, Method::Dsfm, &BLACK);
    let origin = |k: usize| tracked[k].surface.as_ref().map(|s| s.origin);
    assert_eq!((origin(0), origin(1)), (None, Some(Origin::Found)));
    for lost in [0, 3] {
        let reasons = &tracked[lost].reasons;
        assert!(matches!(&reasons[..], [Reason::NoSurface { why: NoSurface::SearchedElsewhere }]));
    }
    let searched = |t: &Tracked| t.stages.iter().any(|stage| stage.0 == "find");
    assert!(!tracked.iter().any(searched), "no frame waits for a search");
    let answered: Vec<bool> = tracked.iter().map(|t| t.answered).collect();
    assert_eq!(answered, [false, true, false, false, true]);
    assert_eq!((tracked[4].status, origin(4)), (TrackStatus::Ok, Some(Origin::Found)));
    let vertices = |t: &Tracked| t.surface.as_ref().map(|s| s.vertices.clone()).unwrap();
    let pairs: Vec<_> =
        vertices(&tracked[4]).into_iter().zip(clip.truth[3].clone().unwrap()).collect();
    let squares: f64 = pairs.iter().map(|(a, b)| (a - b).norm_squared()).sum();
    let error = (squares / pairs.len() as f64).sqrt();
    assert!(error < 0.5, "{error} mm from the frame at hand, not the one that was searched");
    assert_eq!(vertices(&tracked[4]), vertices(&searched_beside(&clip, Method::Dsfm, &BLACK)[4]));
}

#[test]
fn where_nobody_searches_beside_the_tracker_does() {
    let clip = clip();
    let options = TrackOptions { search_beside: true, ..TrackOptions::default() };
    let mut tracker =
        Tracker::new(&clip.template, &clip.camera, &ToneCurve::Srgb, Method::Dsfm, options)
            .unwrap();
    drop(tracker.searcher().unwrap());
    assert_eq!(tracker.next(&clip.frames[0], None).unwrap().status, TrackStatus::Ok);
    let options = TrackOptions::default();
    let mut usual =
        Tracker::new(&clip.template, &clip.camera, &ToneCurve::Srgb, Method::Dsfm, options)
            .unwrap();
    assert!(usual.searcher().is_none());
}

#[test]
fn frames_are_followed_while_another_is_searched() {
    let clip = clip();
    // The jump from 0 to 5 makes the template be sought, though the surface holds.
    let frames = [(0, false), (0, true), (5, false), (5, false), (5, true)];
    let tracked = searched_beside(&clip, Method::Joint, &frames);
    let ways: Vec<_> = tracked.iter().map(|t| t.surface.as_ref().map(|s| s.origin)).collect();
    let followed = Some(Origin::Followed);
    assert_eq!(ways, [None, Some(Origin::Found), followed, followed, followed]);
    assert!(tracked[4].answered, "nothing was sought");
}
