//! Each doubt has its reason and its level.

use super::*;
use crate::verdict::evidence::EXPECTED;
use observability::PoseUncertainty;

fn good() -> Evidence {
    Evidence {
        matches: MatchCount { total: 100, kept: 90, distinct: 95, distinct_kept: 88, given: false },
        ..Evidence::default()
    }
}

fn of(evidence: &Evidence) -> Verdict {
    judge(evidence, &Thresholds::default())
}

fn with(change: impl FnOnce(&mut Evidence)) -> Verdict {
    let mut evidence = good();
    change(&mut evidence);
    of(&evidence)
}

#[test]
fn what_is_not_known_does_not_speak() {
    assert_eq!(of(&good()), Verdict::default());
}

#[test]
fn each_doubt_has_its_level() {
    let found = with(|e| e.matches.kept = 40);
    assert_eq!(found.level, Level::Degraded);
    assert_eq!(found.reasons, [Reason::MatchesDisagree { kept: 40, total: 100 }]);
    let share = |kept, given| with(|e| (e.matches.kept, e.matches.given) = (kept, given)).level;
    assert_eq!([share(60, false), share(60, true)], [Level::Ok, Level::Degraded]);
    let few =
        |kept, given| with(|e| (e.matches.distinct_kept, e.matches.given) = (kept, given)).level;
    assert_eq!(
        [few(40, false), few(20, false), few(5, false)],
        [Level::Ok, Level::Degraded, Level::Lost]
    );
    assert_eq!(
        [few(20, true), few(5, true), few(3, true)],
        [Level::Ok, Level::Degraded, Level::Lost]
    );
    let places = |agreeing| with(|e| e.places = Some([agreeing, 100])).level;
    assert_eq!([places(90), places(40), places(10)], [Level::Ok, Level::Degraded, Level::Lost]);
    let lit = |times| with(|e| e.photometric = Some(times)).level;
    assert_eq!([lit(2.0), lit(3.0)], [Level::Ok, Level::Degraded]);
    let strain = |share| with(|e| e.strain = Some(share)).level;
    assert_eq!(
        [strain(0.1), strain(0.5), strain(f64::NAN)],
        [Level::Ok, Level::Degraded, Level::Lost]
    );
    let depth = |depth| with(|e| e.depth = Some((depth, [60.0, 100.0]))).level;
    assert_eq!(
        [depth(80.0), depth(250.0), depth(4900.0), depth(5.0)],
        [Level::Ok, Level::Degraded, Level::Lost, Level::Lost]
    );
    let camera = |own| with(|e| e.camera = Some((40.0, [1.0, own]))).level;
    assert_eq!([camera(2.0), camera(1.0), camera(0.5)], [Level::Ok, Level::Degraded, Level::Lost]);
}

#[test]
fn what_is_no_number_or_could_not_be_looked_at_is_never_ok() {
    let nan = f64::NAN;
    let part = Part { share: nan, centre_px: [0.0; 2], radius_px: 0.0 };
    let looked = |change: fn(&mut Appearance)| {
        let mut seen = EXPECTED;
        change(&mut seen);
        with(|e| e.appearance = Some(seen))
    };
    let doubted = [
        with(|e| e.residual_px = Some(nan)),
        with(|e| e.rigid_px = Some([nan, 640.0])),
        with(|e| e.depth_uncertainty = Some(nan)),
        with(|e| e.camera = Some((1.0, [1.0, nan]))),
        with(|e| e.photometric = Some(nan)),
        with(|e| e.contradicted = Some(part)),
        with(|e| e.unobserved = Some(part)),
        with(|e| e.folded = Some((3, nan))),
        with(|e| e.jump = Some(nan)),
        with(|e| e.gain = Some(nan)),
        looked(|seen| seen.residual = f64::NAN),
        looked(|seen| seen.compared = f64::NAN),
        looked(|seen| seen.contrast = Some(f64::NAN)),
    ];
    for (k, found) in doubted.iter().enumerate() {
        assert_eq!(found.level, Level::Degraded, "{k}: {found:?}");
    }
    assert_eq!(looked(|_| ()).level, Level::Ok);
    let uncompared = with(|e| e.uncompared = true);
    assert_eq!(uncompared.reasons, [Reason::Uncompared { share: 0.0 }]);
    let folded = with(|e| e.folded = Some((3, 0.5)));
    assert_eq!(folded.reasons, [Reason::Folded { faces: 3, share: 0.5 }]);
    let part = Part { share: 0.5, ..part };
    let unobserved = with(|e| e.unobserved = Some(part));
    assert_eq!(unobserved.reasons, [Reason::RegionUnobserved(part)]);
}

#[test]
fn an_open_pose_is_lost_whatever_the_matches_agree_on() {
    let open = PoseUncertainty { length: f64::INFINITY, degrees: f64::INFINITY };
    let found = with(|e| (e.pose, e.radius) = (Some(open), 20.0));
    assert_eq!(found.level, Level::Lost);
    assert!(matches!(found.reasons[0], Reason::PoseUncertain { .. }));
}

#[test]
fn the_most_serious_reason_comes_first() {
    let found = with(|e| (e.matches.kept, e.strain) = (40, Some(2.0)));
    assert_eq!(found.level, Level::Lost);
    assert!(matches!(found.reasons[0], Reason::Strain { .. }), "{found:?}");
    assert_eq!(found.reasons.len(), 2);
}

#[test]
fn a_frame_is_held_against_its_own_template() {
    let seen = Appearance {
        correlation: Some(0.6),
        contrast: Some(0.9),
        residual: 0.06,
        shown: 0.95,
        compared: 0.8,
    };
    let beside = |usual| {
        with(|e| (e.appearance, e.usual) = (Some(seen), Appearance { correlation: usual, ..seen }))
    };
    assert_eq!(beside(Some(0.65)).level, Level::Ok);
    assert!(matches!(beside(Some(0.95)).reasons[..], [Reason::Structure { .. }]));
    let part = Part { share: 0.2, centre_px: [10.0, 20.0], radius_px: 5.0 };
    assert_eq!(with(|e| e.contradicted = Some(part)).reasons, [Reason::RegionContradicted(part)]);
}

use crate::template::usual::Appearance;
