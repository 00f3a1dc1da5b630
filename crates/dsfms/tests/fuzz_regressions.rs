//! Every file of the corpus through its reader, within a time; and mutants of them, few in the
//! usual run and as many as a time allows on demand:
//!
//! `DSFMS_FUZZ_SECONDS=600 cargo test --release --test fuzz_regressions -- --ignored --nocapture`

#[path = "common/targets.rs"]
mod targets;

use dsfms::geometry::Point3;
use dsfms::image::Frame;
use dsfms::io::igtl::{Head, ImagePlacement, image as image_message, string};
use dsfms::io::images::decode_bytes;
use image::ImageFormat;
use std::path::Path;
use std::time::{Duration, Instant};
use targets::{TARGETS, Target, mp4, small_truth, template_parts};

/// For one input on a busy machine; a reader takes milliseconds.
const PATIENCE: Duration = Duration::from_secs(20);

/// Names and bytes of a target: its folder of the corpus, and seeds that are made here.
fn corpus(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus").join(target);
    let mut files: Vec<(String, Vec<u8>)> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.display().to_string(), std::fs::read(&path).unwrap()))
        .collect();
    files.extend(made(target));
    files.sort();
    assert!(!files.is_empty(), "no corpus for {target}");
    files
}

/// Names and bytes of the seeds that are written here.
fn made(target: &str) -> Vec<(String, Vec<u8>)> {
    let one = |name: &str, bytes: Vec<u8>| vec![(name.to_owned(), bytes)];
    let picture =
        image::RgbImage::from_fn(24, 16, |x, y| image::Rgb([x as u8 * 9, y as u8 * 11, 77]));
    let written = |picture: image::DynamicImage, format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let colours = |format| written(picture.clone().into(), format);
    match target {
        "image" => [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Tiff]
            .map(|format| (format.extensions_str()[0].to_owned(), colours(format)))
            .into(),
        "mask" => {
            let halves =
                image::GrayImage::from_fn(24, 16, |x, _| image::Luma([255 * (x / 12) as u8]));
            [ImageFormat::Png, ImageFormat::Tiff]
                .map(|f| (f.extensions_str()[0].to_owned(), written(halves.clone().into(), f)))
                .into()
        }
        "mjpeg" => {
            let jpeg = colours(ImageFormat::Jpeg);
            one("two.mjpeg", [&b"--boundary\r\n\r\n"[..], &jpeg, b"\r\n", &jpeg].concat())
        }
        "mp4" => one("three.mp4", clip().bytes),
        "h264" => one("three.h264", mp4::annex_b([48, 32], &clip())),
        "igtl" => {
            let frame = Frame { name: String::new(), size: [4, 3], rgb: vec![[9, 8, 7]; 12] };
            let (head, axes) = (Head { device: "a", time: None }, [[0.0; 3]; 3]);
            let image = image_message(head, &frame, &ImagePlacement { axes, centre: [0.0; 3] });
            one("two.igtl", [image, string(head, "text")].concat())
        }
        "npz" => {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.npz");
            let mut file = dsfms::track::shapes::ShapeFile::create(&path, 2).unwrap();
            file.push(Some(&[Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.0)]), &[], 0)
                .unwrap();
            file.finish().unwrap();
            one("vertices.npz", std::fs::read(path).unwrap())
        }
        "template" => template_parts(),
        "truth" => {
            let [npz, arrays] = small_truth();
            vec![("clip.npz".into(), npz), ("clip.npy".into(), arrays)]
        }
        "off" => one(
            "two.off",
            b"OFF # units mm\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0.5\n3 0 1 2\n3 0 2 3\n".into(),
        ),
        "vtk" | "vtp" => surface_of_vtk(target),
        "scene" => one("two.scene", scene_of_two()),
        "nifti" => one("two.nii.gz", volume_of_two()),
        _ => Vec::new(),
    }
}

/// Three pictures that need no other.
fn clip() -> mp4::Video {
    let grey = |k: u8| vec![[60 + 40 * k; 3]; 48 * 32];
    mp4::video([48, 32], &[grey(0), grey(1), grey(2)])
}

/// A packed volume of 3 x 2 x 2 voxels of 16 bits.
fn volume_of_two() -> Vec<u8> {
    use dsfms::io::nifti::{NiftiFile, write_warped};
    use dsfms::voxels::{VoxelGrid, VoxelKind, VoxelVolume};
    let map = dsfms::nalgebra::Affine3::identity();
    let grid = VoxelGrid::new([3, 2, 2], map).unwrap();
    let file = NiftiFile::new(VoxelVolume::new(grid, VoxelKind::I16, (0..24).collect()).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.nii.gz");
    write_warped(&path, &file, |k| file.volume.bytes()[12 * k..12 * k + 12].to_vec()).unwrap();
    std::fs::read(path).unwrap()
}

/// A scene of two small frames, without the head of its file.
fn scene_of_two() -> Vec<u8> {
    use dsfms::camera::{CameraModel, Lens};
    use dsfms::dense::{DepthMap, PosedFrame};
    use dsfms::geometry::Isometry;
    let size = [12, 9];
    let camera = CameraModel { size, focal: [12.0; 2], centre: [5.5, 4.0], lens: Lens::default() };
    let frame = |name: &str| Frame { name: name.into(), size, rgb: vec![[120, 60, 50]; 108] };
    let frames = ["a", "b"].map(frame);
    let map = |i: usize| DepthMap {
        camera: camera.clone(),
        pose: Isometry::translation(i as f64, 0.0, 0.0),
        depth: (0..108).map(|p| if p % 12 < 6 { 20.0 } else { 30.0 }).collect(),
        normal: vec![[0.0, 0.0, -1.0]; 108],
        sigma: vec![0.1; 108],
        confidence: vec![1.0; 108],
    };
    let maps = [0, 1].map(map);
    let organ = dsfms::image::Mask::filled(size, true);
    let view = |i: usize| PosedFrame {
        frame: &frames[i],
        camera: &camera,
        pose: maps[i].pose,
        valid: None,
        organ: (i == 1).then_some(&organ),
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.scene");
    dsfms::pipeline::OrganScene::new(&[0, 1].map(view), &maps, &camera).write(&path).unwrap();
    let bytes = std::fs::read(path).unwrap();
    bytes[dsfms::pipeline::OrganScene::HEAD..].to_vec()
}

fn surface_of_vtk(target: &str) -> Vec<(String, Vec<u8>)> {
    let mesh = dsfms::synth::patch(16, 1).mesh;
    if target == "vtp" {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtp");
        let extras = dsfms::io::vtk::VtkExtras::default();
        let unit = dsfms::LengthUnit::Millimetre;
        dsfms::io::vtk::write_vtp(&path, &mesh.topology, &mesh.positions, unit, &extras).unwrap();
        return vec![("packed.vtp".into(), std::fs::read(path).unwrap())];
    }
    let head = |kind| {
        format!("# vtk DataFile Version 3.0\nunits mm\n{kind}\nDATASET POLYDATA\nPOINTS 4 float\n")
    };
    let text = head("ASCII") + "0 0 0 1 0 0 1 1 0 0 1 0.5\nPOLYGONS 1 5\n4 0 1 2 3\n";
    let mut binary = head("BINARY").into_bytes();
    let points = [0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.5f32];
    binary.extend(points.iter().flat_map(|v| v.to_be_bytes()));
    binary.extend(b"\nPOLYGONS 3 6\nOFFSETS vtktypeint64\n");
    binary.extend([0i64, 3, 6].iter().flat_map(|v| v.to_be_bytes()));
    binary.extend(b"\nCONNECTIVITY vtktypeint64\n");
    binary.extend([0i64, 1, 2, 0, 2, 3].iter().flat_map(|v| v.to_be_bytes()));
    vec![("text.vtk".into(), text.into_bytes()), ("binary.vtk".into(), binary)]
}

/// The seeds that are written here, as files for the targets of `fuzz/`.
#[test]
#[ignore = "writes them into DSFMS_FUZZ_SEEDS"]
fn seeds_for_other_fuzzers() {
    let folder = std::env::var_os("DSFMS_FUZZ_SEEDS").expect("DSFMS_FUZZ_SEEDS names a folder");
    for (target, _, _) in TARGETS {
        for (name, bytes) in made(target) {
            let to = Path::new(&folder).join(target);
            std::fs::create_dir_all(&to).unwrap();
            std::fs::write(to.join(name), bytes).unwrap();
        }
    }
}

fn timed(name: &str, target: Target, bytes: &[u8]) -> bool {
    let start = Instant::now();
    let accepted = target(bytes);
    if start.elapsed() > PATIENCE {
        let path = std::env::temp_dir().join("dsfms-fuzz-slow");
        std::fs::write(&path, bytes).unwrap();
        panic!("{name}: {:?}, see {}", start.elapsed(), path.display());
    }
    accepted
}

#[test]
fn every_file_of_the_corpus_ends_in_time() {
    dsfms::guard::quiet_hook();
    for (name, _, target) in TARGETS {
        let files = corpus(name);
        let accepted = files.iter().filter(|(file, bytes)| timed(file, target, bytes)).count();
        assert!(accepted > 0, "{name}: no seed is accepted");
    }
}

/// `fuzz/` has a program of every target, and no other.
#[test]
fn every_target_is_one_of_the_fuzzer() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz");
    let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
    for (name, _, _) in TARGETS {
        let program = folder.join("fuzz_targets").join(format!("{name}.rs"));
        let text = std::fs::read_to_string(&program).unwrap_or_else(|_| panic!("no {name}.rs"));
        assert!(text.contains(&format!("run(\"{name}\"")), "{text}");
        assert!(manifest.contains(&format!("name = \"{name}\"\n")), "{name} in fuzz/Cargo.toml");
    }
    let programs = std::fs::read_dir(folder.join("fuzz_targets")).unwrap().count();
    assert_eq!(programs, TARGETS.len());
}

/// Few bytes must not cost a decoder much: pixels that they cannot hold, scans without end.
#[test]
fn a_jpeg_of_more_pixels_or_scans_than_its_bytes_can_hold_is_refused() {
    // One colour, the least that a picture needs.
    let flat = image::RgbImage::from_pixel(1600, 1200, image::Rgb([90, 60, 50]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    flat.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
    let good = bytes.into_inner();
    assert!(decode_bytes(&good).is_ok(), "{} bytes", good.len());
    let marker = |kind: u8| good.windows(2).position(|w| w == [0xff, kind]).unwrap();
    // Height and width lie behind the start of the frame.
    let (frame, mut lies) = (marker(0xc0), good.clone());
    lies[frame + 5..frame + 9].copy_from_slice(&[0x1f, 0x40, 0x1f, 0x40]);
    let reason = decode_bytes(&lies).unwrap_err();
    assert!(reason.contains("states 8000x8000 px"), "{reason}");
    let (scan, mut scans) = (marker(0xda), good.clone());
    scans.splice(scan..scan, good[scan..scan + 14].repeat(64));
    let reason = decode_bytes(&scans).unwrap_err();
    assert!(reason.contains("65 scans"), "{reason}");
}

/// xorshift64*.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) as usize % n.max(1)
    }
}

/// Values that readers trip over.
const WORDS: [&[u8]; 16] = [
    b"\xFF\xFF\xFF\xFF",
    b"\0\0\0\0",
    b"\x7F\xFF\xFF\xFF",
    b"\xFF\xFF\xFF\x7F",
    b"\x80\0\0\0",
    b"nan",
    b"-1",
    b"1e308",
    b"18446744073709551615",
    b"[",
    b"{",
    b",",
    b"\n",
    b"\"",
    b"moof",
    b"0",
];

fn mutate(random: &mut Random, seeds: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].1.clone();
    for _ in 0..=random.below(6) {
        let at = random.below(bytes.len());
        match random.below(8) {
            _ if bytes.is_empty() => bytes.push(0),
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.below(256) as u8,
            2 => bytes.truncate(at),
            3 => {
                let word = WORDS[random.below(WORDS.len())];
                let end = (at + word.len()).min(bytes.len());
                bytes[at..end].copy_from_slice(&word[..end - at]);
            }
            4 => {
                let word = WORDS[random.below(WORDS.len())];
                bytes.splice(at..at, word.iter().copied());
            }
            5 => {
                let end = (at + 1 + random.below(64)).min(bytes.len());
                bytes.drain(at..end);
            }
            6 => {
                let end = (at + 1 + random.below(64)).min(bytes.len());
                let part = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, part);
            }
            _ => {
                let other = &seeds[random.below(seeds.len())].1;
                let from = random.below(other.len());
                let part = other[from..(from + random.below(128)).min(other.len())].to_vec();
                bytes.splice(at..at, part);
            }
        }
    }
    bytes
}

/// Mutants of a target's corpus until a count or a time is reached; executions, accepted, the
/// slowest.
fn fuzz(name: &str, target: Target, most: usize, time: Duration) -> (usize, usize, Duration) {
    let seeds = corpus(name);
    let mut random = Random(0x9E37_79B9_7F4A_7C15 ^ name.len() as u64);
    let (start, mut accepted, mut slowest) = (Instant::now(), 0, Duration::ZERO);
    for count in 0..most {
        if start.elapsed() > time {
            return (count, accepted, slowest);
        }
        let bytes = mutate(&mut random, &seeds);
        // What kills the process is found here afterwards.
        let last = std::env::temp_dir().join(format!("dsfms-fuzz-{name}-last"));
        if std::env::var_os("DSFMS_FUZZ_KEEP").is_some() {
            std::fs::write(&last, &bytes).unwrap();
        }
        let begin = Instant::now();
        let run = std::panic::AssertUnwindSafe(|| timed(name, target, &bytes));
        match std::panic::catch_unwind(run) {
            Ok(yes) => accepted += usize::from(yes),
            Err(panic) => {
                std::fs::write(&last, &bytes).unwrap();
                eprintln!("{name}: mutant {count} panics, see {}", last.display());
                std::panic::resume_unwind(panic);
            }
        }
        slowest = slowest.max(begin.elapsed());
    }
    (most, accepted, slowest)
}

#[test]
fn few_mutants_of_every_target() {
    dsfms::guard::quiet_hook();
    for (name, _, target) in TARGETS {
        fuzz(name, target, 300, Duration::from_secs(3));
    }
}

#[test]
#[ignore = "as long as DSFMS_FUZZ_SECONDS says, for each target"]
fn many_mutants_of_every_target() {
    dsfms::guard::quiet_hook();
    let number = |name| std::env::var(name).ok().and_then(|v| v.parse().ok());
    let seconds = Duration::from_secs(number("DSFMS_FUZZ_SECONDS").unwrap_or(10));
    let only = std::env::var("DSFMS_FUZZ_TARGET").ok();
    for (name, _, target) in TARGETS {
        if only.as_deref().is_none_or(|only| only == name) {
            let (count, accepted, slowest) = fuzz(name, target, usize::MAX, seconds);
            println!(
                "{name:<10}{count:>10} executions {accepted:>9} accepted, slowest {slowest:.1?}"
            );
        }
    }
}
