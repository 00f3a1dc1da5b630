//! `dsfms track` with masks and another prior, and what it says of the vertices that are seen.

mod clip;

use clip::{FRAMES, SIZE, Text, assert_as_files, column, track};
use dsfms::track::shapes::read_shapes;
use image::{GrayImage, Luma};
use std::path::Path;

/// A mask, white in columns below `until`.
fn mask(path: &Path, until: u32) {
    let [w, h] = SIZE.map(|n| n as u32);
    let white = |x: u32| Luma([if x < until { 255 } else { 0 }]);
    GrayImage::from_fn(w, h, |x, _| white(x)).save(path).unwrap();
}

#[test]
fn nothing_is_followed_outside_of_the_masks() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, option: &str, until: u32| {
        let (path, out) = (folder.path().join(format!("{name}.png")), folder.path().join(name));
        mask(&path, until);
        track(&out, "frames", &[option, path.to_str().unwrap()]).said();
        out
    };
    // All of it: as without.
    for option in ["--masks", "--organ-masks"] {
        let out = run(&option[2..], option, SIZE[0] as u32);
        let (shapes, status) = read_shapes(&out.join("vertices.npz")).unwrap();
        assert_as_files(&shapes, &status);
    }
    let matches = |out: &Path| -> Vec<usize> {
        column(out, "matches").iter().map(|n| n.parse().unwrap_or(0)).collect()
    };
    let all = matches(&clip::CLIP.path().join("files"));
    for option in ["--masks", "--organ-masks"] {
        let part = matches(&run("part", option, SIZE[0] as u32 * 6 / 10));
        let fewer = part.iter().zip(&all).filter(|(part, all)| part < all).count();
        assert!(fewer > FRAMES / 2, "{option}: {part:?} of {all:?}");
        let none = run("none", option, 0);
        assert!(column(&none, "status").iter().all(|s| s == "lost"), "{option}");
    }
    let said = track(&folder.path().join("out"), "frames", &["--organ-masks", "nowhere"]).said();
    assert!(said.contains("--organ-masks") && said.contains("nowhere"), "{said}");
}

#[test]
fn masks_are_outlined_on_the_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("left.png"), folder.path().join("out"));
    mask(&path, 100);
    let masks = ["--instrument-masks", path.to_str().unwrap()];
    track(&out, "frames", &[&["--overlay", "--stride", "6"], &masks[..]].concat()).said();
    let picture = image::open(out.join("overlay/frame_006.png")).unwrap().to_rgb8();
    // Orange down the mask's last column, and not within it.
    let orange = |x: u32| {
        let near = |[r, g, b]: [u8; 3]| r > 220 && (100..190).contains(&g) && b < 80;
        (20..160).filter(|&y| near(picture.get_pixel(x, y).0)).count()
    };
    assert!(orange(99) > 130 && orange(90) < 10, "{} {}", orange(99), orange(90));
}

#[test]
fn a_source_without_a_frame_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [out, record] = ["out", "record"].map(|name| folder.path().join(name));
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("dsfms.json"), "{}").unwrap();
    std::fs::write(out.join("summary.csv"), "of an older run").unwrap();
    for input in [&["-", "--size", "320x180"][..], &["igtl://127.0.0.1:9"]] {
        let done = assert_cmd::Command::cargo_bin("dsfms")
            .unwrap()
            .current_dir(clip::CLIP.path().join("clip"))
            .args(["track", "organ.template", "--camera", "camera.json"])
            .args(input)
            .arg("--record")
            .arg(&record)
            .arg("-o")
            .arg(&out)
            .write_stdin("")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(1), "{input:?}: {said}");
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2, "{input:?}: {said}");
        assert!(out.join("summary.csv").is_file() && !record.exists(), "{input:?}: {said}");
    }
}

#[test]
fn what_fits_no_camera_or_is_no_mask_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["small", "texts", "photographs"] {
        std::fs::create_dir(at(name)).unwrap();
    }
    for k in 0..4 {
        GrayImage::from_pixel(80, 60, Luma([120])).save(at(&format!("small/{k}.png"))).unwrap();
        std::fs::write(at(&format!("texts/{k}.png")), "no image").unwrap();
    }
    let grey = |x: u32, y: u32| Luma([(x + y) as u8]);
    GrayImage::from_fn(320, 180, grey).save(at("photographs/frame_000.png")).unwrap();
    let [small, texts, masks] =
        ["small", "texts", "photographs"].map(|n| at(n).display().to_string());
    for (input, more, word) in [
        (small.as_str(), &[][..], "80x60"),
        (texts.as_str(), &[][..], "neither a video nor an image"),
        ("frames/frame_000.png", &["--organ-masks", masks.as_str()][..], "not a mask"),
        ("frames", &["--structures", "none.ply"][..], "none.ply"),
    ] {
        let said = track(&at("out"), input, more).said();
        assert!(said.contains(word) && !at("out").exists(), "{input} {more:?}: {said}");
    }
}

#[test]
fn the_prior_is_heeded_and_what_is_seen_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    track(&out, "frames", &["--prior", "arap", "--ply"]).said();
    let (shapes, status) = read_shapes(&out.join("vertices.npz")).unwrap();
    let (conformal, _) = read_shapes(&clip::CLIP.path().join("files/vertices.npz")).unwrap();
    let found: Vec<usize> = (0..FRAMES).filter(|k| status[*k] < 2).collect();
    assert!(found.len() >= FRAMES / 2, "{status:?}");
    assert!(found.iter().any(|k| shapes[*k] != conformal[*k]), "another prior, another shape");
    let ply = std::fs::read(out.join(format!("frame_{:03}.ply", found[0]))).unwrap();
    assert!(String::from_utf8_lossy(&ply).contains("property uchar visible"));
}
