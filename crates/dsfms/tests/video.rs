//! Videos, whole and damaged: every frame keeps its number, a damaged one costs itself.

#[path = "common/mp4.rs"]
mod mp4;

use dsfms::pipeline::Silent;
use dsfms::pipeline::sources::{Purpose, Source, each_source, sources};
use dsfms::video::{
    SelectOptions, VideoFrame, count_frames, each_frame, frame_rate, select_frames,
};
use mp4::{Coded, Video, boxed, encode, video};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const SIZE: [usize; 2] = [48, 32];

/// A grey that says which picture it is.
fn grey(k: usize) -> u8 {
    40 + 12 * k as u8
}

fn picture(k: usize, size: [usize; 2]) -> Vec<[u8; 3]> {
    vec![[grey(k); 3]; size[0] * size[1]]
}

fn clip(count: usize) -> Video {
    let pictures: Vec<_> = (0..count).map(|k| picture(k, SIZE)).collect();
    video(SIZE, &pictures)
}

fn frames(bytes: &[u8]) -> Vec<VideoFrame> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    std::fs::write(&path, bytes).unwrap();
    let mut frames = Vec::new();
    each_frame(&path, &mut |frame| {
        frames.push(frame);
        true
    })
    .unwrap();
    frames
}

/// Number and the picture that is shown, or -1.
fn shown(bytes: &[u8]) -> Vec<(usize, i64)> {
    let which = |f: &VideoFrame| {
        let value = f.content.as_ref().map(|p| (f64::from(p.rgb[0][0]) - 40.0) / 12.0);
        value.map_or(-1, |v| v.round() as i64)
    };
    frames(bytes).iter().map(|f| (f.number, which(f))).collect()
}

#[test]
fn pictures_come_out_in_the_order_of_their_time_stamps() {
    let whole = clip(5);
    assert_eq!(shown(&whole.bytes), [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4)]);
    let first = &frames(&whole.bytes)[0];
    assert_eq!((first.total, first.rests_on), (Some(5), None));
    let frame = first.content.as_ref().unwrap();
    assert_eq!((frame.size, frame.name.as_str()), (SIZE, "frame_000"));
    // Coded as 0 2 1 3: the third is shown before the second.
    let coded = [0, 2, 1, 3].map(|k| picture(k, SIZE));
    let parts = [(SIZE, coded.iter().map(|p| Coded::Key(p)).collect())];
    let mixed = encode(&parts, &[0, 1, -1, 0]);
    assert_eq!(shown(&mixed.bytes), [(0, 0), (1, 1), (2, 2), (3, 3)]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    std::fs::write(&path, &whole.bytes).unwrap();
    assert_eq!(frame_rate(&path), Some(25.0));
}

#[test]
fn a_damaged_picture_is_lost_under_its_number() {
    let mut cut = clip(6);
    let third = cut.samples[2].clone();
    // The slice's header.
    cut.bytes[third.start + 5..third.start + 9].fill(0);
    assert_eq!(shown(&cut.bytes), [(0, 0), (1, 1), (2, -1), (3, 3), (4, 4), (5, 5)]);
    // Its length.
    let mut long = clip(6);
    long.bytes[third.start] = 0x7F;
    assert_eq!(shown(&long.bytes)[2], (2, -1));
    assert_eq!(shown(&long.bytes)[3], (3, 3));
    // A box that promises more than was copied.
    let mut more = clip(6).bytes;
    more.extend([0, 0, 1, 0]);
    more.extend(b"mdat");
    assert_eq!(shown(&more).len(), 6);
    // A copy that ends early: what is there stays.
    let mut whole = clip(6);
    let moov = whole.bytes.split_off(whole.samples[5].end);
    let stsz = moov.windows(4).position(|w| w == b"stsz").unwrap();
    let mut short = [whole.bytes, moov].concat();
    let last = short.len() - (clip(6).bytes.len() - clip(6).samples[5].end) + stsz + 16 + 5 * 4;
    short[last..last + 4].copy_from_slice(&60_000u32.to_be_bytes());
    assert_eq!(shown(&short)[4..], [(4, 4), (5, -1)]);
}

#[test]
fn what_is_predicted_from_a_lost_picture_says_so() {
    let pictures: Vec<_> = (0..3).map(|k| picture(k, SIZE)).collect();
    let coded = || {
        vec![
            Coded::Key(&pictures[0]),
            Coded::Repeat,
            Coded::Repeat,
            Coded::Repeat,
            Coded::Key(&pictures[2]),
            Coded::Repeat,
        ]
    };
    let whole = encode(&[(SIZE, coded())], &[]);
    let expected = [(0, 0), (1, 0), (2, 0), (3, 0), (4, 2), (5, 2)];
    assert_eq!(shown(&whole.bytes), expected);
    let mut cut = encode(&[(SIZE, coded())], &[]);
    let second = cut.samples[1].clone();
    cut.bytes[second.start + 5..second.end].fill(0);
    let frames = frames(&cut.bytes);
    assert!(frames[1].content.is_err());
    let rests: Vec<_> = frames.iter().map(|f| f.rests_on).collect();
    assert_eq!(rests, [None, None, Some(1), Some(1), None, None]);
    // A template takes none of them.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    std::fs::write(&path, &cut.bytes).unwrap();
    let options = SelectOptions { min_motion: 0.0, ..Default::default() };
    let names: Vec<_> =
        select_frames(&path, &options).unwrap().into_iter().map(|f| f.name).collect();
    assert_eq!(names, ["frame_000", "frame_004", "frame_005"]);
}

/// Name and grey value of what a list of sources gives; -1 where it is lost.
fn given(sources: &[Source]) -> Vec<(usize, String, i64)> {
    let mut given = Vec::new();
    each_source(sources, &mut |place, source| {
        let value = source.frame().map(|f| (f64::from(f.rgb[0][0]) - 40.0) / 12.0);
        given.push((place, source.name(), value.map_or(-1, |v| v.round() as i64)));
        true
    });
    given
}

#[test]
fn a_video_is_listed_without_its_pictures_and_decoded_once_more() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let mut cut = clip(6);
    let third = cut.samples[2].clone();
    cut.bytes[third.start + 5..third.start + 9].fill(0);
    std::fs::write(&path, &cut.bytes).unwrap();
    let listed = sources(&[path.clone(), path.clone()], Purpose::Reconstruct, &Silent).unwrap();
    assert!(listed.iter().all(|s| matches!(s, Source::Video(_) | Source::Lost(..))));
    assert_eq!(listed[1].size().unwrap(), SIZE);
    let expected = |k: usize| (k, format!("frame_{:03}", k % 6), [0, 1, -1, 3, 4, 5][k % 6]);
    assert_eq!(given(&listed), (0..12).map(expected).collect::<Vec<_>>());
    // Some of them, one alone, and no more than is asked for.
    let some: Vec<Source> = listed[..6].iter().skip(1).step_by(2).cloned().collect();
    assert_eq!(given(&some).iter().map(|g| g.2).collect::<Vec<_>>(), [1, 3, 5]);
    assert_eq!(listed[4].frame().unwrap().name, "frame_004");
    let mut asked = 0;
    each_source(&listed, &mut |_, _| {
        asked += 1;
        asked < 4
    });
    assert_eq!(asked, 4);
    // A video that became shorter in between, and one that is gone.
    let whole = listed.iter().map(Source::name).collect::<Vec<_>>();
    std::fs::write(&path, clip(4).bytes).unwrap();
    let short = given(&listed);
    assert_eq!(short.iter().map(|g| g.1.clone()).collect::<Vec<_>>(), whole);
    assert_eq!(short.iter().map(|g| g.2).take(6).collect::<Vec<_>>(), [0, 1, -1, 3, -1, -1]);
    std::fs::remove_file(&path).unwrap();
    assert!(given(&listed).iter().all(|g| g.2 == -1));
}

#[test]
fn a_change_of_size_within_the_stream_keeps_every_frame() {
    let other = [32, 48];
    let (a, b) = (picture(1, SIZE), picture(2, other));
    let parts = [(SIZE, vec![Coded::Key(&a), Coded::Repeat]), (other, vec![Coded::Key(&b)])];
    let mixed = frames(&encode(&parts, &[]).bytes);
    let sizes: Vec<_> = mixed.iter().map(|f| f.content.as_ref().unwrap().size).collect();
    assert_eq!(sizes, [SIZE, SIZE, other]);
}

/// Each of them would be a file of the output.
#[test]
fn a_million_pictures_of_one_byte_are_one_loss() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let start = Instant::now();
    let given = |first: Option<&[[u8; 3]]>| {
        std::fs::write(&path, mp4::tiny_samples(SIZE, first, 1 << 20)).unwrap();
        let mut given = 0;
        let read = each_frame(&path, &mut |_| {
            given += 1;
            true
        });
        (given, read.unwrap_err().to_string())
    };
    let (none, why) = given(None);
    assert!(none == 0 && why.contains("a.mp4: more than 3000 pictures in a row"), "{none}: {why}");
    assert!(select_frames(&path, &SelectOptions::default()).is_err());
    // What is there before them is given, and serves a template.
    assert_eq!(given(Some(&picture(1, SIZE))).0, 3001);
    let chosen = select_frames(&path, &SelectOptions::default()).unwrap();
    assert_eq!((chosen.len(), chosen[0].name.as_str()), (1, "frame_000"));
    assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
}

/// The corpus holds files on which the decoder once ran for ever.
#[test]
fn damaged_files_end_at_once() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/mp4");
    let files: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(files.len() >= 4);
    for path in files {
        let start = Instant::now();
        // Files whose pictures are whole decode; what matters is that there is an end.
        let _ = count_frames(&std::fs::read(&path).unwrap());
        assert!(start.elapsed() < Duration::from_secs(10), "{}", path.display());
    }
}

#[test]
fn four_hundred_damaged_bytes_lose_one_frame_of_fifteen() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/mp4/damaged-400-bytes.mp4");
    let mut lost = Vec::new();
    let mut numbers = Vec::new();
    each_frame(&path, &mut |frame| {
        numbers.push(frame.number);
        lost.extend(frame.content.is_err().then_some(frame.number));
        true
    })
    .unwrap();
    assert_eq!(numbers, (0..15).collect::<Vec<_>>());
    assert_eq!(lost.len(), 1, "{lost:?}");
}

/// A file with nothing but the sample table of a video.
fn sample_table(tables: [(&[u8; 4], Vec<u32>); 3]) -> Vec<u8> {
    let table = |(kind, words): (&[u8; 4], Vec<u32>)| {
        let words: Vec<u8> = words.iter().flat_map(|w| w.to_be_bytes()).collect();
        boxed(kind, &[&[0; 4], &words])
    };
    let [sizes, runs, chunks] = tables.map(table);
    let coding = boxed(b"stsd", &[&[0; 4], &1u32.to_be_bytes(), &boxed(b"avc1", &[&[0; 78]])]);
    let stbl = boxed(b"stbl", &[&coding, &sizes, &runs, &chunks]);
    let hdlr = boxed(b"hdlr", &[&[0; 8], b"vide", &[0; 13]]);
    let mdia = boxed(b"mdia", &[&hdlr, &boxed(b"minf", &[&stbl])]);
    boxed(b"moov", &[&boxed(b"trak", &[&mdia])])
}

#[test]
fn samples_that_lie_over_each_other_are_refused() {
    // Fifty pictures of a hundred bytes, all at the same place.
    let chunks = [50].into_iter().chain([8; 50]).collect();
    let file =
        sample_table([(b"stsz", vec![100, 50]), (b"stsc", vec![1, 1, 1, 1]), (b"stco", chunks)]);
    let error = count_frames(&file).unwrap_err();
    assert!(error.contains("50 frames take 5000 of its"), "{error}");
}

#[test]
fn descriptions_that_promise_too_much_are_refused() {
    // 4294967295 samples of one size, in one chunk.
    let file = sample_table([
        (b"stsz", vec![1, u32::MAX]),
        (b"stsc", vec![1, 1, u32::MAX, 1]),
        (b"stco", vec![1, 0]),
    ]);
    let error = count_frames(&file).unwrap_err();
    assert!(error.contains("4294967295 frames"), "{error}");
    for (bytes, word) in [
        (b"text, no video".to_vec(), "no mp4 file"),
        (boxed(b"moov", &[]), "no video track"),
        (boxed(b"free", &[]), "moov"),
    ] {
        let error = count_frames(&bytes).unwrap_err();
        assert!(error.contains(word), "{error}");
    }
}
