//! The programs of `examples/` run, and what they say is true. Figures of the bounds were measured
//! on these very scenes, which come from seeds.

use dsfms::track::TrackStatus;

macro_rules! example {
    ($name:ident, $path:literal) => {
        #[allow(dead_code, reason = "`main` prints what `run` gives")]
        #[path = $path]
        mod $name;
    };
}

example!(template, "../examples/1_template.rs");
example!(reconstruct, "../examples/2_reconstruct.rs");
example!(track, "../examples/3_track.rs");
example!(own_energy_term, "../examples/4_own_energy_term.rs");

#[test]
fn each_is_under_80_lines() {
    for entry in std::fs::read_dir("examples").unwrap() {
        let path = entry.unwrap().path();
        let lines = std::fs::read_to_string(&path).unwrap().lines().count();
        assert!(lines < 80, "{}: {lines} lines", path.display());
    }
}

#[test]
fn template_lies_on_the_true_surface() {
    let median = template::run().unwrap();
    assert!(median < 1.0, "{median:.3} mm");
}

#[test]
fn shading_lowers_the_error_of_motion() {
    // 0.82, 0.83, 0.40 and 0.26 mm.
    let [rigid, dsfm, dsfms, joint] = reconstruct::run().unwrap()[..] else {
        panic!("four methods")
    };
    assert!(rigid < 1.2 && dsfm < 1.2, "rigid {rigid:.3}, eq. 3 {dsfm:.3} mm");
    assert!(dsfms < 0.7 * dsfm && joint < 0.5 * dsfm, "eq. 4 {dsfms:.3}, joint {joint:.3} mm");
}

#[test]
fn the_covered_frame_alone_is_lost() {
    for (k, track::Outcome { status, rms }) in track::run().unwrap().into_iter().enumerate() {
        assert_eq!(status == TrackStatus::Lost, k == track::COVERED, "frame {k}: {status:?}");
        assert!(rms.is_none_or(|rms| rms < 1.5), "frame {k}: {rms:?} mm");
    }
}

#[test]
fn the_range_lowers_the_error() {
    // 0.74 and 0.26 mm.
    let [without, with] = own_energy_term::run().unwrap();
    assert!(with < 0.5 * without, "{with:.3} mm with, {without:.3} mm without");
}
